"""Swings of the tripod's feet, by three models that share nothing, and the poses from which they are best done."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.modes.legged.tripod import (
    LockPoseOptions,
    Swing,
    SwingState,
    WalkingTripod,
    check_foot_way,
    find_lock_pose,
    fit_platform,
    follow_swing,
    lock_names,
    smallest_from_tilt,
    tilt_frame,
    tripod_model,
)
from tripods import FEET, GEOMETRY, HOME, TILTED, best_lock, checked_swing, walker

MODEL = tripod_model(GEOMETRY)
S = np.linspace(0, 1, 41)
FOOT_NAMES = [f"foot {i} {c}" for i in (1, 2, 3) for c in ("x", "y", "z", "alpha", "beta", "gamma")]


# --- The checked swing of models.md §7


def test_the_checked_swing() -> None:
    """From (0, 0, 320) mm tilted by 0.3 rad, 80 mm lifted by 30 mm: it ends at (51.411, 0, 383.487, 0, 0.3, 0)."""
    poses = follow_swing(MODEL, checked_swing(), TILTED)
    assert_allclose(poses[-1], (0.051411, 0, 0.383487, 0, 0.3, 0), atol=6e-7)  # half of the last printed digit
    active = walker().configurations(poses, checked_swing().all_frames(S))[:, :6]
    assert walker().robot.mechanism.names[:6] == walker().robot.mechanism.active
    assert (np.min(active), np.max(active)) == pytest.approx((0.3089, 0.4427), abs=6e-5)
    locked = MODEL.locks(1, poses, checked_swing().all_frames(S)).b
    assert np.max(np.abs(locked - locked[0])) < 1e-12


def test_the_checked_cycle_of_three_legs() -> None:
    """Steps of 60 mm with all legs from the rest pose over the feet tilted by 0.3 rad: actuators from 276 to 426 mm."""
    feet, lengths = FEET, []
    for leg in (1, 2, 3):
        swing = Swing(leg, feet, feet[leg - 1] + [0.06, 0, 0, 0, 0, 0], 0.03)
        start = tilt_frame(GEOMETRY.rest_pose(feet), GEOMETRY.azimuth(leg), 0.3)
        poses = follow_swing(MODEL, swing, start)
        lengths.append(walker().configurations(poses, swing.all_frames(S))[:, :6])
        feet = swing.feet_after
    # the printed numbers do not say from which pose each leg begins: a millimetre is left to that
    assert (np.min(lengths), np.max(lengths)) == pytest.approx((0.276, 0.426), abs=1e-3)


def test_the_general_kinematics_and_both_fits_agree() -> None:
    """Newton on all closures, XFKM of the general kinematics, and `min |b(x) - b|` of the source."""
    poses, frames = follow_swing(MODEL, checked_swing(), TILTED), checked_swing().all_frames(S)
    X = walker().configurations(poses, frames)
    kinematics = walker().robot.kinematics
    names = [*lock_names(1), *FOOT_NAMES]
    values = X[:, kinematics.mechanism.indices(names)]
    here = X[0]
    for k in range(41):  # each from the one before
        closed = kinematics.solve_batch(names, values[k : k + 1], here[None])
        assert closed.converged[0]
        here = closed.X[0]
        assert_allclose(here, X[k], atol=1e-9)
    fitted = kinematics.fit(dict(zip(names, values[-1].tolist(), strict=True)), X[20])
    assert fitted.status is po.Status.CONVERGED
    assert_allclose(fitted.X, X[-1], atol=1e-9)
    found, left = fit_platform(MODEL, 1, MODEL.locks(1, TILTED, FEET).b[0], frames[-1], TILTED)
    assert left[0] < 1e-12
    assert_allclose(found[0], poses[-1], atol=1e-12)


def test_a_swing_goes_where_it_is_told() -> None:
    goal = FEET[1] + [0.02, -0.05, 0.01, 0.1, -0.1, 2 * np.pi + 0.3]
    swing = Swing(2, FEET, goal, 0.05)
    frames = swing.frames([0.0, 0.5, 1.0])
    assert_allclose(frames[0], FEET[1], atol=1e-15)
    assert_allclose(frames[2], goal - [0, 0, 0, 0, 0, 2 * np.pi], atol=1e-12)  # the short way round
    middle = 0.5 * (FEET[1] + goal)[:3]
    assert_allclose(frames[1, :3], middle + 0.05 * swing.normal, atol=1e-12)
    assert_allclose(swing.feet_after[[0, 2]], FEET[[0, 2]], atol=0)
    assert swing.normal[2] < 1.0


def test_swings_that_cannot_be_are_refused() -> None:
    with pytest.raises(po.SolveError, match=r"foot 1 cannot follow its swing .* they let go of the platform") as caught:
        follow_swing(MODEL, checked_swing(), HOME)  # level
    assert caught.value.evidence["share"] < 0.2
    for wrong, words in (
        ({"leg": 4}, "leg is 4"),
        ({"lift": -0.01}, "lift of foot 1 is -0.01 m"),
        ({"feet": FEET[:2]}, r"feet have shape \(2, 6\)"),
        ({"goal": FEET[0] * np.nan}, "new frame of foot 1"),
    ):
        with pytest.raises(po.DefinitionError, match=words):
            replace(checked_swing(), **wrong)


# --- The pose to lock at


def test_derivatives_along_a_swing() -> None:
    state = SwingState.at(walker(), checked_swing(), TILTED + np.array([0, 0.005, 0, 0.02, 0, 0.03]), 9)
    sigma, slopes = state.singular_slopes()
    margins, steep = state.standing_margins()
    distances, gradients, pairs = state.distances(0.05)
    assert pairs.size > 3
    h, rng = 1e-6, np.random.default_rng(0)
    for _ in range(4):
        d = rng.normal(size=6)
        plus, minus = (state.moved(s * h * d) for s in (1, -1))
        assert plus is not None
        assert minus is not None

        def slope(f, plus=plus, minus=minus):  # type: ignore[no-untyped-def]
            return (f(plus) - f(minus)) / (2 * h)

        assert_allclose(slope(lambda c: c.singular_slopes()[0]), slopes @ d, atol=1e-7)
        assert_allclose(slope(lambda c: c.X), state.motions @ d, atol=1e-7)
        assert_allclose(slope(lambda c: c.standing_margins()[0]), steep @ d, atol=1e-7)
        found = slope(lambda c: walker().scene.distances(c.X, pairs, c.motions).values)
        assert_allclose(found, gradients @ d, atol=1e-3)  # distances between curved solids are found to 1e-9 m
    assert_allclose(sigma[:, 0], state.singular_values[:, -1], atol=0)
    assert margins.shape == (2,)
    assert distances.shape == (9, pairs.size)


def test_the_best_lock_pose_beats_the_tilt_of_the_source() -> None:
    """Over the whole swing of 80 mm: 0.0614 from the tilt of 0.3 rad, 0.215 from the best pose."""
    tilt = SwingState.at(walker(), checked_swing(), TILTED, 41)
    assert tilt.smallest == pytest.approx(0.0614, abs=5e-5)
    assert smallest_from_tilt(walker(), checked_swing()) == pytest.approx(tilt.smallest, rel=1e-9)
    assert smallest_from_tilt(walker(), checked_swing(), 0.0) == 0.0
    best = SwingState.at(walker(), checked_swing(), best_lock().pose, 41)
    assert best.smallest == pytest.approx(0.2148, abs=2e-4)
    assert best.smallest > 3.4 * tilt.smallest
    # and it holds what was asked, between the instants of the search too
    options, (low, high) = LockPoseOptions(), walker().ranges
    room = np.minimum(best.X - low, high - best.X)
    strokes = walker().robot.mechanism.indices(walker().robot.mechanism.active)
    assert np.min(room[:, strokes]) > options.stroke_margin - 5e-5
    assert np.min(room) > 0
    assert best.clearance > options.clearance - 5e-5
    assert np.min(best.standing_margins()[0]) > options.standing_margin - 1e-5
    assert np.min(best.swing_margins()) > options.swing_margin
    assert best_lock().active  # it is the ranges that keep it from being better
    assert all("at its" in what or "clearance" in what or "margin" in what for what in best_lock().active)


def test_no_pose_near_the_best_is_better() -> None:
    """A pose aside either is worse or breaks a bound by more than the search leaves open."""
    state, options = best_lock().state, LockPoseOptions()
    low, high = walker().ranges
    angle = np.array([v.kind == "angle" for v in walker().robot.mechanism.variables])
    margin = np.where(angle, options.angle_margin, options.stroke_margin)
    rng = np.random.default_rng(1)
    tried = 0
    for size in (1e-3, 1e-2, 5e-2):
        for d in rng.normal(size=(60, 6)):
            moved = state.moved(size * d / np.linalg.norm(d))
            if moved is None:
                continue
            tried += 1
            room = np.min(np.minimum(moved.X - low, high - moved.X) - margin)
            holds = room > -1e-6 and moved.clearance > options.clearance - 1e-6
            assert not (holds and moved.smallest > best_lock().smallest + 1e-4)
    assert tried > 150


def test_other_random_starts_lead_to_the_same_value() -> None:
    found = [find_lock_pose(walker(), checked_swing(), HOME, LockPoseOptions(seed=s, starts=2)) for s in (1, 2)]
    assert [f.smallest for f in found] == pytest.approx([best_lock().smallest] * 2, abs=1e-4)
    again = find_lock_pose(walker(), checked_swing(), HOME)
    assert_allclose(again.pose, best_lock().pose, atol=0)


def test_faults_name_phase_foot_and_margin() -> None:
    far = replace(checked_swing(), goal=FEET[0] + [0.5, 0, 0, 0, 0, 0])
    with pytest.raises(
        po.InfeasibleError, match=r"phase 'swing of foot 1': foot 1 cannot reach .* its greatest is"
    ) as c:
        find_lock_pose(walker(), far, HOME, phase="swing of foot 1")
    assert c.value.evidence["margin"] < -0.05
    with pytest.raises(
        po.InfeasibleError, match=r"foot 1 cannot come off: .* singular value of 0\.21\d, asked 0\.3"
    ) as c:
        find_lock_pose(walker(), checked_swing(), HOME, LockPoseOptions(lock_margin=0.3, starts=1))
    assert c.value.evidence["margin"] == pytest.approx(0.2148, abs=2e-3)
    with pytest.raises(po.InfeasibleError, match=r"cannot be led by the actuators .* asked 0\.5"):
        find_lock_pose(walker(), checked_swing(), HOME, LockPoseOptions(swing_margin=0.5, starts=1))
    with pytest.raises(po.InfeasibleError, match=r"from any of 2 poses: the locks let go .* 80 mm before at best"):
        find_lock_pose(walker(), checked_swing(), HOME, LockPoseOptions(starts=2, tilt=0.0, spread=(0.02, 0.0)))
    with pytest.raises(po.DefinitionError, match="clearance of a lock pose is -1"):
        LockPoseOptions(clearance=-1)
    with pytest.raises(po.DefinitionError, match="starts of a lock pose is 0"):
        LockPoseOptions(starts=0)


def test_an_obstacle_is_stepped_over_or_told() -> None:
    """A bar 30 mm high across the way: the foot passes lifted by 90 mm, not by 30; the leg keeps off it, too."""
    bar = po.Box(name="bar", size=(0.02, 0.1, 0.03), pose=po.transform((0.31, 0, walker().sole[2] + 0.015)))
    over = WalkingTripod(GEOMETRY, po.Scene(walker().robot, [bar]), walker().sole)
    swing = replace(checked_swing(), goal=FEET[0] + [0.1, 0, 0, 0, 0, 0])
    with pytest.raises(po.InfeasibleError, match=r"foot 1, lifted by 30 mm, comes as near as -.* mm to foot 1 / bar"):
        find_lock_pose(over, swing, HOME)
    check_foot_way(walker(), swing, 0.005)
    high = replace(swing, lift=0.09)
    lock = find_lock_pose(over, high, HOME)
    free = find_lock_pose(walker(), high, HOME)
    state = SwingState.at(over, high, lock.pose, 81)
    assert state.clearance > 0.006 - 2e-4  # asked at 13 instants, looked at between them
    assert 0.1 < lock.smallest <= free.smallest + 1e-6  # an obstacle leaves less choice
