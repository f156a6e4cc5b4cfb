"""Motion: from a problem to a seed, a refined path, a timed trajectory, and the certificate that proves it."""

from paraopt.planning.condition import PathBound, PathCondition
from paraopt.planning.law import TimeLaw
from paraopt.planning.nlp import Nlp, build_nlp, solve_nlp
from paraopt.planning.nlp_options import NlpOptions
from paraopt.planning.nlp_spline import ToolPath, Waypoint
from paraopt.planning.objective import Objective
from paraopt.planning.path import Path, PathPoints
from paraopt.planning.problem import Margins, Problem
from paraopt.planning.refine import Refined, SplineRefiner
from paraopt.planning.refine_time import MinimumTime
from paraopt.planning.retime_base import PathConstraint, PathRows, Retimer, RowConstraint
from paraopt.planning.retime_ruckig import JerkLimited, JointMove
from paraopt.planning.retime_toppra import TimeOptimal
from paraopt.planning.seed import FirstSuccess, GrownRoadmap, MixedSearch, Roadmap, RRTConnect, Seed, Seeder
from paraopt.planning.trajectory import State, Trajectory
from paraopt.planning.validity import Validity, Verdict, check_ends
from paraopt.planning.verify import Certificate, Check, Tolerances, verify

__all__ = [
    "Certificate",
    "Check",
    "FirstSuccess",
    "GrownRoadmap",
    "JerkLimited",
    "JointMove",
    "Margins",
    "MinimumTime",
    "MixedSearch",
    "Nlp",
    "NlpOptions",
    "Objective",
    "Path",
    "PathBound",
    "PathCondition",
    "PathConstraint",
    "PathPoints",
    "PathRows",
    "Problem",
    "RRTConnect",
    "Refined",
    "Retimer",
    "Roadmap",
    "RowConstraint",
    "Seed",
    "Seeder",
    "SplineRefiner",
    "State",
    "TimeLaw",
    "TimeOptimal",
    "Tolerances",
    "ToolPath",
    "Trajectory",
    "Validity",
    "Verdict",
    "Waypoint",
    "build_nlp",
    "check_ends",
    "solve_nlp",
    "verify",
]
