"""What the retimers share: what bounds the motion along a path, and how much of it a time law uses."""

from paraopt.planning.retime_base.fastest import find_fastest, refine_grid, spread_grid
from paraopt.planning.retime_base.limited import LimitedPath, limit_path, third_derivatives
from paraopt.planning.retime_base.parts import find_stops, retime_parts
from paraopt.planning.retime_base.platform import PlatformMotion
from paraopt.planning.retime_base.retimer import Retimer
from paraopt.planning.retime_base.rows import PathConstraint, PathRows, RowConstraint
from paraopt.planning.retime_base.use import LimitUse, choose_times, measure_use

__all__ = [
    "LimitUse",
    "LimitedPath",
    "PathConstraint",
    "PathRows",
    "PlatformMotion",
    "Retimer",
    "RowConstraint",
    "choose_times",
    "find_fastest",
    "find_stops",
    "limit_path",
    "measure_use",
    "refine_grid",
    "retime_parts",
    "spread_grid",
    "third_derivatives",
]
