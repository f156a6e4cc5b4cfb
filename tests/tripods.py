"""Tripods that several tests share, built once."""

from __future__ import annotations

import functools

import numpy as np

import paraopt as po
from paraopt.modes.legged.tripod import LockPose, Swing, TripodGeometry, WalkingTripod, find_lock_pose, move_frames

Array = np.ndarray
GEOMETRY = TripodGeometry()
HOME, FEET = GEOMETRY.home_pose, GEOMETRY.home_feet
TILTED = np.array([0.0, 0.0, 0.32, 0.0, 0.3, 0.0])  # the source's manner: 0.3 rad about P_L P_R of leg 1


@functools.cache
def walker() -> WalkingTripod:
    """Give the tripod with free feet on a plate that is large enough to walk on."""
    return po.robots.walking_tripod(GEOMETRY)


def checked_swing() -> Swing:
    """Give the swing of models.md §7: leg 1, 80 mm outwards, lifted by 30 mm."""
    return Swing(1, FEET, FEET[0] + [0.08, 0, 0, 0, 0, 0], 0.03)


@functools.cache
def best_lock() -> LockPose:
    """Give the best lock pose for that swing."""
    return find_lock_pose(walker(), checked_swing(), HOME)


def random_stances(n: int, seed: int) -> tuple[Array, Array]:
    """Give poses (n, 6) and feet (n, 3, 6) around home: uneven ground, turned feet."""
    rng = np.random.default_rng(seed)
    poses = HOME + rng.uniform(-1, 1, (n, 6)) * (0.05, 0.05, 0.05, 0.35, 0.35, 0.35)
    return poses, FEET + rng.uniform(-1, 1, (n, 3, 6)) * (0.03, 0.03, 0.03, 0.2, 0.2, 0.4)


def ahead(distance: float = 0.06) -> Array:
    """Give the feet moved along x [m]."""
    return move_frames(FEET, (distance, 0, 0))
