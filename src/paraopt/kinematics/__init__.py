"""Numbers: compiled functions of the closure graph, solves, and the state of the mechanism."""

from paraopt.kinematics.assembly_modes import AssemblyMode, AssemblyModes, AssemblyOptions
from paraopt.kinematics.batch import BatchSolution
from paraopt.kinematics.codegen import CompiledFunction, find_compiler
from paraopt.kinematics.conditioning import Isotropy, IsotropyOptions, condition_numbers, find_isotropic
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.continuation import FollowOptions, follow
from paraopt.kinematics.elimination import VelocityModel, eliminate_passives
from paraopt.kinematics.followed import BranchSingularity, Followed, StopReason
from paraopt.kinematics.free_motion import FreeMotion
from paraopt.kinematics.legs import Leg, find_legs
from paraopt.kinematics.margins import Determinants, Margins, MotionSpace
from paraopt.kinematics.model import Jacobians, Kinematics
from paraopt.kinematics.multistart import Search, SearchOptions
from paraopt.kinematics.ranks import Rank, compute_rank, independent_rows, null_space
from paraopt.kinematics.samples import GeneralState, SampleOptions, find_general_state, sample_configurations
from paraopt.kinematics.singularity import Singularity, SingularityReport, report_singularities
from paraopt.kinematics.solution import Solution
from paraopt.kinematics.solve import ClosureSolution, SolveOptions, Status
from paraopt.kinematics.state import Condition, StateReport, report_state
from paraopt.kinematics.tracked import Tracked, TrackStatus, TrackStep
from paraopt.kinematics.tracking import Twist, VelocityTracker, track
from paraopt.kinematics.working_modes import LegPostures, WorkingModeOptions, WorkingModes

__all__ = [
    "AssemblyMode",
    "AssemblyModes",
    "AssemblyOptions",
    "BatchSolution",
    "BranchSingularity",
    "ClosureSolution",
    "CompiledFunction",
    "Condition",
    "Configuration",
    "Determinants",
    "FollowOptions",
    "Followed",
    "FreeMotion",
    "GeneralState",
    "Isotropy",
    "IsotropyOptions",
    "Jacobians",
    "Kinematics",
    "Leg",
    "LegPostures",
    "Margins",
    "MotionSpace",
    "Rank",
    "SampleOptions",
    "Search",
    "SearchOptions",
    "Singularity",
    "SingularityReport",
    "Solution",
    "SolveOptions",
    "StateReport",
    "Status",
    "StopReason",
    "TrackStatus",
    "TrackStep",
    "Tracked",
    "Twist",
    "VelocityModel",
    "VelocityTracker",
    "WorkingModeOptions",
    "WorkingModes",
    "compute_rank",
    "condition_numbers",
    "eliminate_passives",
    "find_compiler",
    "find_general_state",
    "find_isotropic",
    "find_legs",
    "follow",
    "independent_rows",
    "null_space",
    "report_singularities",
    "report_state",
    "sample_configurations",
    "track",
]
