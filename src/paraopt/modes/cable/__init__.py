"""Robots held by cables: the model, tensions, wrench-feasible poses, and their margins along motions."""

from paraopt.modes.cable.balance import build_hanging, name_tension, read_hanging
from paraopt.modes.cable.certificate import CableCertificate, CableTolerances, verify_cables
from paraopt.modes.cable.chain import MotionChain
from paraopt.modes.cable.conditions import SquareConditions
from paraopt.modes.cable.distribution import TensionBatch, distribute_batch, dynamic_tensions
from paraopt.modes.cable.equilibrium import find_equilibria, find_equilibrium, judge_stability
from paraopt.modes.cable.facets import (
    FacetOptions,
    Facets,
    capacity_gradients,
    capacity_margins,
    compute_facets,
    has_wrench_closure,
    is_wrench_feasible,
)
from paraopt.modes.cable.hanging import Equilibria, EquilibriumOptions, HangingPose, Stability
from paraopt.modes.cable.margin import TensionMargin
from paraopt.modes.cable.model import PLATFORM, CableRobot
from paraopt.modes.cable.sag import Sag, estimate_sag
from paraopt.modes.cable.singularity import CableState, StateOptions, report_cable_state
from paraopt.modes.cable.statics import Feasibility, Tensions, check_feasibility, distribute
from paraopt.modes.cable.sway import measure_sway
from paraopt.modes.cable.timing import SwayLimits, TensionLimits, WinchLimits
from paraopt.modes.cable.winch import Drum, Pulley
from paraopt.modes.cable.winding import WinchMotion, name_paid_out
from paraopt.modes.cable.workspace import CableWorkspace, map_workspace
from paraopt.modes.cable.wrench import CableFunctions, cable_functions

__all__ = [
    "PLATFORM",
    "CableCertificate",
    "CableFunctions",
    "CableRobot",
    "CableState",
    "CableTolerances",
    "CableWorkspace",
    "Drum",
    "Equilibria",
    "EquilibriumOptions",
    "FacetOptions",
    "Facets",
    "Feasibility",
    "HangingPose",
    "MotionChain",
    "Pulley",
    "Sag",
    "SquareConditions",
    "Stability",
    "StateOptions",
    "SwayLimits",
    "TensionBatch",
    "TensionLimits",
    "TensionMargin",
    "Tensions",
    "WinchLimits",
    "WinchMotion",
    "build_hanging",
    "cable_functions",
    "capacity_gradients",
    "capacity_margins",
    "check_feasibility",
    "compute_facets",
    "distribute",
    "distribute_batch",
    "dynamic_tensions",
    "estimate_sag",
    "find_equilibria",
    "find_equilibrium",
    "has_wrench_closure",
    "is_wrench_feasible",
    "judge_stability",
    "map_workspace",
    "measure_sway",
    "name_paid_out",
    "name_tension",
    "read_hanging",
    "report_cable_state",
    "verify_cables",
]
