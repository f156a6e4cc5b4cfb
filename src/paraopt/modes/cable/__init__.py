"""Robots held by cables: the model, tensions, wrench-feasible poses, and their margins along motions."""

from paraopt.modes.cable.conditions import SquareConditions
from paraopt.modes.cable.distribution import TensionBatch, distribute_batch, dynamic_tensions
from paraopt.modes.cable.facets import (
    FacetOptions,
    Facets,
    capacity_gradients,
    capacity_margins,
    compute_facets,
    has_wrench_closure,
    is_wrench_feasible,
)
from paraopt.modes.cable.margin import TensionMargin
from paraopt.modes.cable.model import PLATFORM, CableRobot
from paraopt.modes.cable.sag import Sag, estimate_sag
from paraopt.modes.cable.singularity import CableState, StateOptions, report_cable_state
from paraopt.modes.cable.statics import Feasibility, Tensions, check_feasibility, distribute
from paraopt.modes.cable.timing import TensionLimits, WinchLimits
from paraopt.modes.cable.winch import Drum, Pulley
from paraopt.modes.cable.workspace import CableWorkspace, map_workspace
from paraopt.modes.cable.wrench import CableFunctions, cable_functions

__all__ = [
    "PLATFORM",
    "CableFunctions",
    "CableRobot",
    "CableState",
    "CableWorkspace",
    "Drum",
    "FacetOptions",
    "Facets",
    "Feasibility",
    "Pulley",
    "Sag",
    "SquareConditions",
    "StateOptions",
    "TensionBatch",
    "TensionLimits",
    "TensionMargin",
    "Tensions",
    "WinchLimits",
    "cable_functions",
    "capacity_gradients",
    "capacity_margins",
    "check_feasibility",
    "compute_facets",
    "distribute",
    "distribute_batch",
    "dynamic_tensions",
    "estimate_sag",
    "has_wrench_closure",
    "is_wrench_feasible",
    "map_workspace",
    "report_cable_state",
]
