"""Numbers: compiled functions of the closure graph, solves, and the state of the mechanism."""

from paraopt.kinematics.codegen import CompiledFunction, find_compiler
from paraopt.kinematics.conditioning import Isotropy, IsotropyOptions, condition_numbers, find_isotropic
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.elimination import VelocityModel, eliminate_passives
from paraopt.kinematics.legs import Leg, find_legs
from paraopt.kinematics.margins import Determinants, Margins, MotionSpace
from paraopt.kinematics.model import Jacobians, Kinematics
from paraopt.kinematics.ranks import Rank, compute_rank, independent_rows, null_space
from paraopt.kinematics.samples import GeneralState, SampleOptions, find_general_state, sample_configurations
from paraopt.kinematics.singularity import FreeMotion, Singularity, SingularityReport, report_singularities
from paraopt.kinematics.solution import Solution
from paraopt.kinematics.solve import ClosureSolution, SolveOptions, Status
from paraopt.kinematics.state import Condition, StateReport, report_state

__all__ = [
    "ClosureSolution",
    "CompiledFunction",
    "Condition",
    "Configuration",
    "Determinants",
    "FreeMotion",
    "GeneralState",
    "Isotropy",
    "IsotropyOptions",
    "Jacobians",
    "Kinematics",
    "Leg",
    "Margins",
    "MotionSpace",
    "Rank",
    "SampleOptions",
    "Singularity",
    "SingularityReport",
    "Solution",
    "SolveOptions",
    "StateReport",
    "Status",
    "VelocityModel",
    "compute_rank",
    "condition_numbers",
    "eliminate_passives",
    "find_compiler",
    "find_general_state",
    "find_isotropic",
    "find_legs",
    "independent_rows",
    "null_space",
    "report_singularities",
    "report_state",
    "sample_configurations",
]
