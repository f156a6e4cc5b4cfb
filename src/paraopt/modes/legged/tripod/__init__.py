"""The tripod that walks and machines: closed forms, locks, lock poses, swings, steps."""

from paraopt.modes.legged.tripod.chain import LockState, TripodModel, build_chain, tripod_model
from paraopt.modes.legged.tripod.geometry import (
    LEGS,
    POSE,
    TripodGeometry,
    foot_names,
    leg_names,
    lock_names,
)
from paraopt.modes.legged.tripod.locks import (
    LockReport,
    check_locks,
    lock_matrix,
    report_locks,
    smallest_of_columns,
)
from paraopt.modes.legged.tripod.swing import Swing, fit_platform, follow_swing, hold_locks
from paraopt.modes.legged.tripod.walker import WalkingTripod

__all__ = [
    "LEGS",
    "POSE",
    "LockReport",
    "LockState",
    "Swing",
    "TripodGeometry",
    "TripodModel",
    "WalkingTripod",
    "build_chain",
    "check_locks",
    "fit_platform",
    "follow_swing",
    "foot_names",
    "hold_locks",
    "leg_names",
    "lock_matrix",
    "lock_names",
    "report_locks",
    "smallest_of_columns",
    "tripod_model",
]
