"""Numbers: compiled functions of the closure graph, solves, and the state of the mechanism."""

from paraopt.kinematics.codegen import CompiledFunction, find_compiler
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.model import Jacobians, Kinematics, Solution
from paraopt.kinematics.ranks import Rank, compute_rank, independent_rows
from paraopt.kinematics.solve import ClosureSolution, SolveOptions, Status
from paraopt.kinematics.state import Determinants, Margins, MotionSpace, StateReport, report_state

__all__ = [
    "ClosureSolution",
    "CompiledFunction",
    "Configuration",
    "Determinants",
    "Jacobians",
    "Kinematics",
    "Margins",
    "MotionSpace",
    "Rank",
    "Solution",
    "SolveOptions",
    "StateReport",
    "Status",
    "compute_rank",
    "find_compiler",
    "independent_rows",
    "report_state",
]
