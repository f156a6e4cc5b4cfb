"""Can a Gough-Stewart platform bring a tool from one side of two posts to the other, turning it on the way?

A motion in all six coordinates: the tool, a pin that stands on the platform, leans one way at the start and the other
way at the goal, and the platform turns about it. The posts hang from above in the way of the pin. The machine is that
of the library (Lahouar, II.3 and annex B give the structure); its dimensions, the tool, the posts and the poses are
ours.

Expected: the straight motion is blocked by the tool and a post; a certified motion of about 0.34 m in the metric in
which a radian counts as 0.4 m. The search is that of the boundary in the grid's main directions; where it does not find
a way within its budget, random trees follow, the same ones at every run.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import tyro

import paraopt as po

Pose = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Parameters:
    """Plan a motion of the Stewart platform."""

    start: Pose = (-0.12, 0.0, 0.6, 0.0, -0.15, -0.2)
    """Platform at the start: x, y, z [m], alpha, beta, gamma [rad]."""
    goal: Pose = (0.12, 0.0, 0.6, 0.0, 0.15, 0.2)
    """Platform at the goal."""
    tool: tuple[float, float] = (0.02, 0.25)
    """Radius and height of the pin on the platform [m]."""
    posts: tuple[tuple[float, float], ...] = ((0.0, -0.01), (0.03, 0.09))
    """Where the posts hang, x and y [m]."""
    bottom: float = 0.78
    """Lower end of the posts [m]."""
    margins: po.Margins = field(default_factory=lambda: po.Margins(clearance=0.005, singularity=0.05))
    """Clearance [m] and distance to singularities."""
    output: Path | None = None
    """Folder of the results; none are written when not given."""


def build_problem(p: Parameters) -> po.Problem:
    """Place the tool, the posts, and both ends."""
    robot = po.robots.stewart()
    radius, height = p.tool
    pin = po.Cylinder.between((0, 0, 0), (0, 0, height), radius, "tool")
    robot = replace(robot, shapes={**robot.shapes, "platform": [*robot.shapes["platform"], pin]})
    posts = [
        po.Cylinder.between((x, y, p.bottom), (x, y, 2.0), 0.03, f"post {i}") for i, (x, y) in enumerate(p.posts, 1)
    ]
    names = robot.mechanism.operational
    start, goal = (dict(zip(names, pose, strict=True)) for pose in (p.start, p.goal))
    return po.Problem(po.Scene(robot, posts), start, goal, margins=p.margins)


def main(p: Parameters) -> int:
    """Plan, and say what came out."""
    try:
        plan = po.plan(build_problem(p))
        files = plan.save(p.output) if p.output else {}
    except (po.ParaoptError, OSError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    print(plan.summary)
    print(f"files: {', '.join(str(f) for f in files.values()) or 'none'}")
    return 0 if plan.certificate.passed else 1


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Parameters, description=__doc__)))
