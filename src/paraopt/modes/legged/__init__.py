"""Legged machines: parallel robots whose feet stand on a support, come off it, and stand elsewhere."""

from paraopt.modes.legged import tripod
from paraopt.modes.legged.balance import (
    SupportPolygon,
    build_centre,
    build_polygon,
    differentiate_centre,
    measure_centre,
    measure_support,
    measure_worst_support,
)
from paraopt.modes.legged.certificate import LeggedCertificate, LeggedTolerances, verify_legged
from paraopt.modes.legged.conditions import HeightCondition, StabilityCondition
from paraopt.modes.legged.gait import GaitAim, find_gait, list_orders
from paraopt.modes.legged.gait_build import hold_trunk
from paraopt.modes.legged.gait_model import GaitModel
from paraopt.modes.legged.gait_motion import Gait, GaitPhase, PhaseSamples
from paraopt.modes.legged.gait_options import GaitOptions
from paraopt.modes.legged.gait_search import GaitChoice, compare_orders, measure_mass_margin
from paraopt.modes.legged.gait_steps import Footfalls, Lift, build_turn, build_walk, tilt_gravity
from paraopt.modes.legged.gait_task import build_gait_task
from paraopt.modes.legged.machine import Foot, LeggedMachine
from paraopt.modes.legged.phases import PhaseTolerances, build_problems
from paraopt.modes.legged.plan import LeggedPlan, PhasePlan, plan_legged
from paraopt.modes.legged.supports import FrameSupport, PlaneSupport, Support, drop_onto, measure_height
from paraopt.modes.legged.task import LeggedTask, Phase
from paraopt.modes.legged.tipping import TippingConstraint, measure_tipping
from paraopt.modes.legged.trajectory import LeggedTrajectory, PhaseMark

__all__ = [
    "Foot",
    "Footfalls",
    "FrameSupport",
    "Gait",
    "GaitAim",
    "GaitChoice",
    "GaitModel",
    "GaitOptions",
    "GaitPhase",
    "HeightCondition",
    "LeggedCertificate",
    "LeggedMachine",
    "LeggedPlan",
    "LeggedTask",
    "LeggedTolerances",
    "LeggedTrajectory",
    "Lift",
    "Phase",
    "PhaseMark",
    "PhasePlan",
    "PhaseSamples",
    "PhaseTolerances",
    "PlaneSupport",
    "StabilityCondition",
    "Support",
    "SupportPolygon",
    "TippingConstraint",
    "build_centre",
    "build_gait_task",
    "build_polygon",
    "build_problems",
    "build_turn",
    "build_walk",
    "compare_orders",
    "differentiate_centre",
    "drop_onto",
    "find_gait",
    "hold_trunk",
    "list_orders",
    "measure_centre",
    "measure_height",
    "measure_mass_margin",
    "measure_support",
    "measure_tipping",
    "measure_worst_support",
    "plan_legged",
    "tilt_gravity",
    "tripod",
    "verify_legged",
]
