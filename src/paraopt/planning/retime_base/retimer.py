"""What every retimer offers."""

from __future__ import annotations

from typing import ClassVar, Protocol

from paraopt.planning.path import Path
from paraopt.planning.problem import Problem
from paraopt.planning.trajectory import Trajectory


class Retimer(Protocol):
    """Give a path its time law.

    Attributes:
        bounds_jerk: Whether the jerk limits hold too.
    """

    bounds_jerk: ClassVar[bool]

    def retime(self, problem: Problem, path: Path) -> Trajectory:
        """Time a path within the limits, or raise an error that names the cause."""
        ...
