"""Can a robot move from one pose to another without meeting a singularity or an obstacle, and how fast?

For any machine: one of the library (`--robot five_bar`), or a TOML file (`--robot problems/five_bar.toml`, see
docs/file-format.md); obstacles come from a TOML file, too (`--scene`). A pose states operational variables, such as
"x=0.1 y=0.2" [m or rad]; those that it leaves out stay at home.

Expected: for the five-bar (Chablat1998) from its home, "x=6 y=7", to "x=5 y=8": a certified straight motion of 1.414 m.
"""

from __future__ import annotations

import inspect
import sys
import webbrowser
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro

import paraopt as po

# those that need no arguments
LIBRARY = {
    name: build
    for name, build in inspect.getmembers(po.robots, inspect.isfunction)
    if all(p.default is not p.empty for p in inspect.signature(build).parameters.values())
}


@dataclass(frozen=True)
class Parameters:
    """Plan a motion of any robot."""

    robot: str
    """A name of the library, such as raf, or a TOML file."""
    goal: str
    """Where to, such as "x=0.1 y=0.2" [m or rad]."""
    start: str = ""
    """Where from; the robot's home when not given."""
    scene: Path | None = None
    """TOML file of the obstacles; none when not given."""
    margins: po.Margins = field(default_factory=po.Margins)
    """Clearance [m] and distance to singularities."""
    retimer: Literal["toppra", "ruckig"] = "toppra"
    """Time-optimal, or jerk-limited."""
    period: float = 1e-3
    """Time between the rows of the trajectory file [s]."""
    output: Path = Path("out/move")
    """Folder of the results."""
    view: bool = False
    """Open the moving robot in the browser."""


def build_problem(p: Parameters) -> po.Problem:
    """Find the robot, place the obstacles, and read the poses."""
    if p.robot not in LIBRARY and not Path(p.robot).is_file():
        raise po.DefinitionError(f"robot {p.robot!r} is neither a file nor one of {', '.join(LIBRARY)}")
    robot = LIBRARY[p.robot]() if p.robot in LIBRARY else po.load_robot(p.robot)
    obstacles = po.load_obstacles(p.scene) if p.scene else ()
    home = {name: robot.home[name] for name in robot.mechanism.operational}
    start, goal = (home | read_pose(pose, label) for pose, label in ((p.start, "start"), (p.goal, "goal")))
    return po.Problem(po.Scene(robot, obstacles), start, goal, margins=p.margins)


def read_pose(text: str, label: str) -> dict[str, float]:
    """Read "x=0.1 y=0.2"; a name with blanks is possible: "left x=1, right x=2" has commas."""
    pose: dict[str, float] = {}
    for word in text.split(",") if "," in text else text.split():
        name, _, value = (part.strip() for part in word.partition("="))
        try:
            pose[name] = float(value)
        except ValueError as error:
            raise po.DefinitionError(f"{label} has {word!r}; it must read like 'x=0.1 y=0.2'") from error
    return pose


def main(p: Parameters) -> int:
    """Plan, save, and say what came out."""
    retimer = po.TimeOptimal() if p.retimer == "toppra" else po.JerkLimited()
    try:
        plan = po.plan(build_problem(p), retimer=retimer)  # raises if the certificate fails
        files = plan.save(p.output, period=p.period)
    except (po.ParaoptError, OSError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    print(plan.summary)
    print(f"files: {p.output.resolve()} ({', '.join(f.name for f in files.values())})")
    if p.view and "page" in files:
        webbrowser.open(files["page"].resolve().as_uri())
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Parameters, description=__doc__)))
