"""Numbers: compiled functions of the closure graph, solves, and the state of the mechanism."""

from paraopt.kinematics.codegen import CompiledFunction, find_compiler
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.margins import Determinants, Margins, MotionSpace
from paraopt.kinematics.model import Jacobians, Kinematics, Solution
from paraopt.kinematics.ranks import Rank, compute_rank, independent_rows, null_space
from paraopt.kinematics.samples import GeneralState, SampleOptions, find_general_state, sample_configurations
from paraopt.kinematics.solve import ClosureSolution, SolveOptions, Status
from paraopt.kinematics.state import Condition, StateReport, report_state

__all__ = [
    "ClosureSolution",
    "CompiledFunction",
    "Condition",
    "Configuration",
    "Determinants",
    "GeneralState",
    "Jacobians",
    "Kinematics",
    "Margins",
    "MotionSpace",
    "Rank",
    "SampleOptions",
    "Solution",
    "SolveOptions",
    "StateReport",
    "Status",
    "compute_rank",
    "find_compiler",
    "find_general_state",
    "independent_rows",
    "null_space",
    "report_state",
    "sample_configurations",
]
