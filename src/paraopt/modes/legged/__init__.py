"""Legged machines: parallel robots whose feet stand on a support, come off it, and stand elsewhere."""

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
from paraopt.modes.legged.machine import Foot, LeggedMachine
from paraopt.modes.legged.phases import PhaseTolerances, build_problems
from paraopt.modes.legged.plan import LeggedPlan, PhasePlan, plan_legged
from paraopt.modes.legged.supports import FrameSupport, PlaneSupport, Support, drop_onto, measure_height
from paraopt.modes.legged.task import LeggedTask, Phase
from paraopt.modes.legged.trajectory import LeggedTrajectory, PhaseMark

__all__ = [
    "Foot",
    "FrameSupport",
    "HeightCondition",
    "LeggedCertificate",
    "LeggedMachine",
    "LeggedPlan",
    "LeggedTask",
    "LeggedTolerances",
    "LeggedTrajectory",
    "Phase",
    "PhaseMark",
    "PhasePlan",
    "PhaseTolerances",
    "PlaneSupport",
    "StabilityCondition",
    "Support",
    "SupportPolygon",
    "build_centre",
    "build_polygon",
    "build_problems",
    "differentiate_centre",
    "drop_onto",
    "measure_centre",
    "measure_height",
    "measure_support",
    "measure_worst_support",
    "plan_legged",
    "verify_legged",
]
