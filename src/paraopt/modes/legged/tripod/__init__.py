"""The tripod that walks and machines: closed forms, locks, lock poses, swings, steps, ways of the tool."""

from paraopt.modes.legged.tripod.chain import LockState, TripodModel, build_chain, tripod_model
from paraopt.modes.legged.tripod.foot_way import check_foot_way
from paraopt.modes.legged.tripod.frames import move_frames, tilt_frame
from paraopt.modes.legged.tripod.geometry import (
    LEGS,
    POSE,
    TripodGeometry,
    foot_names,
    leg_names,
    lock_names,
)
from paraopt.modes.legged.tripod.lock_pose import LockPose, LockPoseOptions, find_lock_pose
from paraopt.modes.legged.tripod.locks import (
    LockReport,
    check_locks,
    lock_matrix,
    report_locks,
    smallest_of_columns,
)
from paraopt.modes.legged.tripod.machining import check_machining, follow_tool, lean_round
from paraopt.modes.legged.tripod.scenario import build_scenario, build_step_task, machine_curve
from paraopt.modes.legged.tripod.step import LegStep, TripodStep, tripod_step
from paraopt.modes.legged.tripod.swing import Swing, fit_platform, follow_swing, hold_locks
from paraopt.modes.legged.tripod.swing_state import SwingState, smallest_from_tilt
from paraopt.modes.legged.tripod.walker import WalkingTripod

__all__ = [
    "LEGS",
    "POSE",
    "LegStep",
    "LockPose",
    "LockPoseOptions",
    "LockReport",
    "LockState",
    "Swing",
    "SwingState",
    "TripodGeometry",
    "TripodModel",
    "TripodStep",
    "WalkingTripod",
    "build_chain",
    "build_scenario",
    "build_step_task",
    "check_foot_way",
    "check_locks",
    "check_machining",
    "find_lock_pose",
    "fit_platform",
    "follow_swing",
    "follow_tool",
    "foot_names",
    "hold_locks",
    "lean_round",
    "leg_names",
    "lock_matrix",
    "lock_names",
    "machine_curve",
    "move_frames",
    "report_locks",
    "smallest_from_tilt",
    "smallest_of_columns",
    "tilt_frame",
    "tripod_model",
    "tripod_step",
]
