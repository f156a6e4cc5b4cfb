"""How does a Delta carry a part from one side of a box to the other, over it?

Pick and place: the gripper below the platform goes down beside a box, and may touch neither it nor the table. The
straight motion between the two places leads through the box. Lengths of the machine are those of Chablat (Chablat1998,
3.4.7), without unit there and called metres; the gripper, the box, the table and the places are ours.

Expected: the straight motion is blocked by the gripper and the box; a certified motion of about 1.87 m that rises by
about 0.35 m over the box, in both directions. Exit code 0 only if both are certified.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import tyro

import paraopt as po


@dataclass(frozen=True)
class Parameters:
    """Plan a pick and a return of the Delta."""

    pick: tuple[float, float, float] = (-0.8, -0.2, -3.6)
    """Platform where the part is taken [m]."""
    place: tuple[float, float, float] = (0.8, 0.2, -3.6)
    """Platform where the part is left [m]."""
    gripper: tuple[float, float] = (0.08, 0.5)
    """Radius and length of the gripper [m]."""
    box: tuple[float, float, float] = (0.6, 2.5, 0.5)
    """Sizes of the box along x, y, z [m]; it stands on the table."""
    table: float = -4.3
    """Height of the table [m]."""
    margins: po.Margins = field(default_factory=lambda: po.Margins(clearance=0.02, singularity=0.05))
    """Clearance [m] and distance to singularities."""
    output: Path | None = None
    """Folder of the results; none are written when not given."""


def build_scene(p: Parameters) -> po.Scene:
    """Place the robot with its gripper, the box and the table."""
    robot = po.robots.delta()
    radius, length = p.gripper
    gripper = po.Cylinder.between((0, 0, -length), (0, 0, 0), radius, "gripper")
    robot = replace(robot, shapes={**robot.shapes, "platform": [*robot.shapes["platform"], gripper]})
    box = po.Box(name="box", size=p.box, pose=po.transform((0.0, 0.0, p.table + 0.5 * p.box[2])))
    table = po.Box(name="table", size=(6.0, 6.0, 0.1), pose=po.transform((0.0, 0.0, p.table - 0.05)))
    return po.Scene(robot, [box, table])


def main(p: Parameters) -> int:
    """Plan there and back, and say what came out."""
    scene = build_scene(p)
    pick, place = (dict(zip("xyz", pose, strict=True)) for pose in (p.pick, p.place))
    try:
        for name, start, goal in (("there", pick, place), ("back", place, pick)):
            plan = po.plan(po.Problem(scene, start, goal, margins=p.margins))  # raises if the certificate fails
            files = plan.save(p.output / name) if p.output else {}
            index = scene.robot.mechanism.index("z")
            rise = max(plan.trajectory(plan.trajectory.duration * k / 500)[index] for k in range(501)) - p.pick[2]
            print(f"{name}: rises by {rise:.3f} m\n{plan.summary}")
            print(f"files: {', '.join(str(f) for f in files.values()) or 'none'}")
    except (po.ParaoptError, OSError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Parameters, description=__doc__)))
