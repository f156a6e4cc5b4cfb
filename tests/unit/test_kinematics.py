"""Evaluation of a mechanism: residuals, Jacobians, poses, and the motions that keep the loops closed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import paraopt as po
from paraopt.kinematics import find_compiler
from support import (
    assert_derivative,
    five_bar_robot,
    raf_configurations,
    raf_robot,
    two_rpr,
    two_rpr_values,
    vector,
)

INDEPENDENT = [("x", "y", "z"), ("q1", "q2", "q3"), ("q1", "arm A", "z")]


def test_residual_and_its_scaled_form() -> None:
    kinematics = po.Kinematics(two_rpr(characteristic_length=2.0), "virtual machine")
    values = two_rpr_values(1.3, 2.1)
    X = vector(kinematics.mechanism, values)
    assert_allclose(kinematics.residual(X), 0, atol=1e-15)
    values["x"] += 0.25  # opens both loops by as much along x
    X = vector(kinematics.mechanism, values)
    assert_allclose(kinematics.residual(X), [-0.25, 0, -0.25, 0], atol=1e-15)
    assert_allclose(kinematics.scaled_residual(np.stack([X, X])), [0.125, 0.125], atol=1e-15)


def test_jacobians_annihilate_every_motion() -> None:
    """M qdot_a + N qdot_p + K xdot = 0 with the velocities of a known motion of the 2-RPR."""
    kinematics = po.Kinematics(two_rpr(), "virtual machine")
    x, y, vx, vy = 1.3, 2.1, 0.7, -0.4
    values = two_rpr_values(x, y)
    M, N, K = kinematics.jacobians(vector(kinematics.mechanism, values))
    assert (M.shape, N.shape, K.shape) == ((4, 2), (4, 2), (4, 2))
    r1, r2, dx = values["rho1"], values["rho2"], x - 4.0
    q_a = np.array([(x * vx + y * vy) / r1, (dx * vx + y * vy) / r2])
    q_p = np.array([(x * vy - y * vx) / r1**2, (dx * vy - y * vx) / r2**2])
    assert_allclose(M @ q_a + N @ q_p + K @ (vx, vy), 0, atol=1e-14)


def test_batches_equal_single_points() -> None:
    kinematics = raf_robot().kinematics
    X = np.array([c.X for c in raf_configurations()])
    whole = kinematics.jacobians_batch(X)
    for i, x in enumerate(X):
        for single, batch in zip(kinematics.jacobians(x), whole, strict=True):
            assert_array_equal(single, batch[i])
        assert_array_equal(kinematics.poses(x)[0], kinematics.poses(X)[i])
    assert kinematics.poses(X).shape == (len(X), 22, 4, 4)


def test_poses_are_rigid_and_tie_the_points() -> None:
    robot = raf_robot()
    mechanism, place = robot.mechanism, [link.name for link in robot.mechanism.links].index
    poses = robot.kinematics.poses(raf_configurations()[3].X)[0]
    R = poses[:, :3, :3]
    assert_allclose(R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=1e-14)
    assert_array_equal(poses[:, 3], np.broadcast_to((0, 0, 0, 1), (22, 4)))
    for closure in mechanism.closures:
        p_A = poses[place(closure.link_A)] @ [*closure.point_A, 1]
        p_B = poses[place(closure.link_B)] @ [*closure.point_B, 1]
        assert_allclose(p_A, p_B, atol=1e-12)  # the solve's tolerance, scaled by a length below 1 m


@pytest.mark.parametrize("independent", INDEPENDENT, ids=" ".join)
@pytest.mark.parametrize("which", [0, 5])
def test_tangent_is_the_derivative_of_the_solve(independent: tuple[str, ...], which: int) -> None:
    kinematics, configuration = raf_robot().kinematics, raf_configurations()[which]

    def solve(values: np.ndarray) -> np.ndarray:
        return kinematics.solve(dict(zip(independent, values.tolist(), strict=True)), configuration).configuration.X

    at = np.array([configuration[n] for n in independent])
    T = kinematics.tangent(configuration.X, independent)[0]
    # closures hold to 1e-12, which a step of 1e-4 turns into some 1e-8; the third choice is strongly curved, and has
    # a truncation of as much
    assert_derivative(T, solve, at, step=1e-4, tolerance=1e-7)
    assert_allclose(T[kinematics.mechanism.indices(independent)], np.eye(len(independent)), atol=1e-12)
    for idle in ("jack 1.z", "jack 2.z", "jack 3.z"):
        assert_array_equal(T[kinematics.mechanism.index(idle)], 0)


@pytest.mark.parametrize("independent", INDEPENDENT, ids=" ".join)
def test_tangent_keeps_the_loops_closed(independent: tuple[str, ...]) -> None:
    kinematics = raf_robot().kinematics
    X = np.array([c.X for c in raf_configurations()])
    T = kinematics.tangent(X, independent)
    E = np.concatenate(kinematics.jacobians_batch(X), axis=2)
    # velocities up to some 50 per unit, in double precision, after two refinements of the solve
    assert_allclose(E @ T, 0, atol=1e-12)


@pytest.mark.parametrize("independent", INDEPENDENT[:2], ids=" ".join)
def test_curvature_is_the_derivative_of_the_tangent(independent: tuple[str, ...]) -> None:
    kinematics, configuration = raf_robot().kinematics, raf_configurations()[2]
    at = np.array([configuration[n] for n in independent])
    T = kinematics.tangent(configuration.X, independent)
    k, j = np.indices((3, 3)).reshape(2, -1)
    h = kinematics.curvature(configuration.X, T[:, :, k], T[:, :, j], independent)[0].reshape(-1, 3, 3)

    def tangent(values: np.ndarray) -> np.ndarray:
        solution = kinematics.solve(dict(zip(independent, values.tolist(), strict=True)), configuration)
        return kinematics.tangent(solution.configuration.X, independent)[0]

    # second derivatives reach some 100 per square unit; the tangent's own noise is 1e-12 over a step of 1e-3
    assert_derivative(h, tangent, at, step=1e-3, tolerance=1e-7)
    assert_allclose(h, h.transpose(0, 2, 1), atol=1e-9 * np.abs(h).max())


def test_pose_velocity_is_the_derivative_of_the_poses() -> None:
    kinematics = raf_robot().kinematics
    random = np.random.default_rng(3)
    X, V = random.uniform(-1, 1, 32), random.normal(size=(32, 3))
    claimed = kinematics.pose_velocity(X, V[None])[0]
    # move along the columns of V, from X
    assert_derivative(
        np.moveaxis(claimed, 0, -1), lambda s: kinematics.poses(X + V @ s)[0, :, :3], np.zeros(3), tolerance=1e-9
    )


def test_idle_variables_are_named() -> None:
    assert raf_robot().kinematics.idle == ("jack 1.z", "jack 2.z", "jack 3.z")
    assert five_bar_robot().kinematics.idle == ()


def test_prepare_makes_every_function_of_a_path(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PARAOPT_CACHE", str(tmp_path))
    kinematics = po.Kinematics(two_rpr())
    kinematics.prepare()
    made = {path.name for path in tmp_path.iterdir()}
    X = vector(kinematics.mechanism, two_rpr_values(1.3, 2.1))[None]
    space = po.MotionSpace(kinematics)
    space.margin_gradients(X, space.tangent(X))
    kinematics.inverse({"x": 1.0, "y": 2.0}, X[0])
    kinematics.poses(X), kinematics.jacobians(X[0]), kinematics.residual(X[0])
    kinematics.pose_velocity(X, space.tangent(X))
    assert {path.name for path in tmp_path.iterdir()} == made
    assert bool(made) == (find_compiler() is not None)


def test_a_mechanism_without_closures_moves_freely() -> None:
    chain = po.Mechanism(
        "chain", [po.Base(), po.Series("arm", "base", joint=po.Universal("a"))], (), ("a.x",), ("a.y",)
    )
    kinematics = po.Kinematics(chain, "virtual machine")
    solution = kinematics.solve({"a.x": 0.4, "a.y": 0.3})
    assert_allclose(solution.configuration.X, [0.4, 0.3], atol=0)
    assert (solution.residual, solution.rank.value) == (0.0, 0)
    assert kinematics.idle == ("a.x", "a.y")
