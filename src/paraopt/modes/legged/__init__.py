"""Legged machines: parallel robots whose feet stand on a support, come off it, and stand elsewhere."""

from paraopt.modes.legged.balance import (
    StabilityCondition,
    SupportPolygon,
    build_centre,
    build_polygon,
    differentiate_centre,
    measure_centre,
    measure_support,
)
from paraopt.modes.legged.machine import Foot, LeggedMachine
from paraopt.modes.legged.supports import FrameSupport, PlaneSupport, Support, drop_onto, measure_height
from paraopt.modes.legged.task import LeggedTask, Phase

__all__ = [
    "Foot",
    "FrameSupport",
    "LeggedMachine",
    "LeggedTask",
    "Phase",
    "PlaneSupport",
    "StabilityCondition",
    "Support",
    "SupportPolygon",
    "build_centre",
    "build_polygon",
    "differentiate_centre",
    "drop_onto",
    "measure_centre",
    "measure_height",
    "measure_support",
]
