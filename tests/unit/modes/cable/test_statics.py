"""Tensions at poses: exact, within limits, best of their kind, or refused with the reason."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

from cable_robots import draw_poses, hanging, ipanema, planar
from paraopt.errors import DefinitionError, InfeasibleError
from paraopt.modes.cable import (
    CableRobot,
    cable_functions,
    capacity_margins,
    check_feasibility,
    distribute,
    distribute_batch,
)
from paraopt.modes.cable.statics import AIMS, Aim

Array = NDArray[np.float64]
ROBOTS = {"spatial": ipanema(t_min=10.0), "planar": planar(t_min=1.0, gravity=(0, -9.81))}


def feasible_poses(robot: CableRobot, count: int, seed: int) -> Array:
    poses = draw_poses(robot, 40 * count, seed)
    return poses[capacity_margins(robot, poses) > 0.0][:count]


@pytest.mark.parametrize("aim", AIMS)
@pytest.mark.parametrize("name", ROBOTS)
def test_tensions_balance_and_keep_their_limits_exactly(name: str, aim: Aim) -> None:
    robot = ROBOTS[name]
    for pose in feasible_poses(robot, 40, seed=30):
        tensions = distribute(robot, pose, aim=aim)
        W, w = (v[0] for v in cable_functions(robot).both(pose))
        left = (W @ tensions.values + w) / np.array([1, 1, 1, *[robot.length_scale] * 3] if robot.dof == 6 else
                                                    [1, 1, robot.length_scale])  # fmt: skip
        assert np.linalg.norm(left) <= 1e-9 * robot.weight
        assert tensions.residual == pytest.approx(np.linalg.norm(left), abs=1e-12)
        assert np.all(tensions.values >= robot.t_min)
        assert np.all(tensions.values <= robot.t_max)
        assert tensions["q1"] == tensions.values[0]


@pytest.mark.parametrize("name", ROBOTS)
def test_no_other_tensions_are_nearer(name: str) -> None:
    """Optimality by its conditions: what is left beyond a combination of W's rows points out of active limits."""
    robot = ROBOTS[name]
    middle = 0.5 * (robot.t_min + robot.t_max)
    for pose in feasible_poses(robot, 20, seed=31):
        W = cable_functions(robot).wrench_matrix(pose)[0]
        for aim, wanted in (("least norm", 0.0 * middle), ("closest", middle)):
            t = distribute(robot, pose, aim=aim).values  # type: ignore[arg-type]
            free = (t > robot.t_min + 1e-7) & (t < robot.t_max - 1e-7)
            y = np.linalg.lstsq(W[:, free].T, (t - wanted)[free], rcond=None)[0]
            slope = (t - wanted) - W.T @ y
            assert slope[free] == pytest.approx(np.zeros(np.sum(free)), abs=1e-6)
            if np.sum(free) >= robot.dof:  # else the multipliers are not unique
                assert np.all(slope[t <= robot.t_min + 1e-7] >= -1e-6)
                assert np.all(slope[t >= robot.t_max - 1e-7] <= 1e-6)


def test_least_norm_against_another_solver() -> None:
    robot = ROBOTS["planar"]
    for pose in feasible_poses(robot, 5, seed=32):
        W, w = (v[0] for v in cable_functions(robot).both(pose))
        solved = minimize(
            lambda t: t @ t, np.full(4, 20.0), jac=lambda t: 2 * t, method="SLSQP",
            bounds=list(zip(robot.t_min, robot.t_max, strict=True)),
            constraints={"type": "eq", "fun": lambda t, W=W, w=w: W @ t + w, "jac": lambda t, W=W: W},
            options={"ftol": 1e-14, "maxiter": 500},
        )  # fmt: skip
        assert distribute(robot, pose).values == pytest.approx(solved.x, abs=1e-5)


@pytest.mark.parametrize(("force", "length"), [(1e9, 1e3), (1e-9, 1e-3)])
def test_units_do_not_matter(force: float, length: float) -> None:
    """A ship's and a needle's robot: solvers have absolute tolerances, which must not show."""
    robot = ROBOTS["spatial"]
    other = ipanema(
        exits=length * robot.exits, attachments=length * robot.attachments, mass=25.0 * force, t_min=10.0 * force,
        t_max=720.0 * force, home={"z": length},
    )  # fmt: skip
    poses = draw_poses(robot, 12, seed=38)
    scaled = poses * np.array([length, length, length, 1, 1, 1])
    assert capacity_margins(other, scaled) / force == pytest.approx(capacity_margins(robot, poses), abs=1e-9)
    one, two = distribute_batch(robot, poses), distribute_batch(other, scaled)
    assert np.array_equal(one.feasible, two.feasible)
    assert two.values[one.feasible] / force == pytest.approx(one.values[one.feasible], abs=1e-8)
    for pose, there, feasible in zip(poses, scaled, one.feasible, strict=True):
        verdict, wanted = check_feasibility(other, there), check_feasibility(robot, pose)
        assert verdict.margin / force == pytest.approx(wanted.margin, abs=1e-6)
        assert verdict.cables == wanted.cables
        if feasible:
            for aim in AIMS:
                assert distribute(other, there, aim=aim).margin / force == pytest.approx(
                    distribute(robot, pose, aim=aim).margin, abs=1e-6
                )


def test_tensions_of_a_hanging_robot_stay_within_their_limits() -> None:
    """Where the platform asks for more than the limits allow, what cannot be given is left unbalanced, and said."""
    robot = hanging(t_max=2.0)
    batch = distribute_batch(robot, robot.home_pose)
    assert not batch.feasible[0]
    assert np.all((batch.values >= 0.0) & (batch.values <= 2.0))
    assert batch.residual[0] > 0.1
    with pytest.raises(InfeasibleError, match="hangs elsewhere"):
        batch.check()


def test_batches_refuse_what_does_not_fit() -> None:
    robot = ROBOTS["planar"]
    poses = [[0.5, 0.5, 0.0]] * 2
    for wrench in ([1.0, 2.0], [[1.0, 2.0, 3.0]] * 3, [1.0], [np.nan, 0.0, 0.0], "heavy"):
        with pytest.raises(DefinitionError, match="wrenches"):
            distribute_batch(robot, poses, wrench)
        with pytest.raises(DefinitionError, match="wrenches"):
            capacity_margins(robot, poses, wrench)
    for reference in ([1.0, 2.0], np.inf, "many"):
        with pytest.raises(DefinitionError, match="reference tensions"):
            distribute_batch(robot, poses, aim="closest", reference=reference)
    with pytest.raises(DefinitionError, match="must be numbers"):
        capacity_margins(robot, "here")
    assert np.array_equal(
        distribute_batch(robot, poses, [0.0, -5.0, 0.0]).values,
        distribute_batch(robot, poses, [[0.0, -5.0, 0.0]] * 2).values,
    )


def test_aims_are_what_they_say() -> None:
    robot = ROBOTS["spatial"]
    pose = [0.2, 0.1, 0.9, 0.02, 0.0, 0.1]
    least, middle, wide = (distribute(robot, pose, aim=aim) for aim in AIMS)
    assert np.linalg.norm(least.values) < np.linalg.norm(middle.values)
    assert wide.margin > max(least.margin, middle.margin)
    assert wide.margin == pytest.approx(check_feasibility(robot, pose).margin, abs=1e-6)
    reference = wide.values + 0.0
    assert distribute(robot, pose, aim="closest", reference=reference).values == pytest.approx(reference, abs=1e-6)


def test_a_reference_within_reach_is_met() -> None:
    robot = ROBOTS["spatial"]
    W = cable_functions(robot).wrench_matrix([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])[0]
    wanted = np.random.default_rng(33).uniform(20.0, 700.0, 8)
    found = distribute(robot, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], -W @ wanted, aim="closest", reference=wanted)
    assert found.values == pytest.approx(wanted, abs=1e-7)


def test_what_cannot_be_held_is_refused_with_the_limits_in_the_way() -> None:
    robot = ipanema(t_min=100.0, t_max=150.0)
    pose = [0.1, 0.0, 1.0, 0.0, 0.0, 0.0]
    heavy = [0.0, 0.0, -150.0, 0.0, 0.0, 0.0]
    with pytest.raises(InfeasibleError, match=r"cable 'q\d' at t_max.*loosened by") as caught:
        distribute(robot, pose, heavy)
    verdict = caught.value.evidence["feasibility"]
    assert not verdict.is_feasible
    assert 1.0 < -verdict.margin < 100.0
    # loosened by what it says and a little more, the limits allow it; with a little less they do not
    for more, holds in ((1e-3, True), (-1e-3, False)):
        change = -verdict.margin + more
        loose = ipanema(t_min=100.0 - change, t_max=150.0 + change)
        assert check_feasibility(loose, pose, heavy).is_feasible is holds
    # the limits that it does not name are not in the way: without them it is no better
    low, high = np.zeros(8), np.full(8, 1e4)
    for i, cable in enumerate(robot.cables):
        low[i] = 100.0 if f"cable {cable!r} at t_min" in verdict.cables else 0.0
        high[i] = 150.0 if f"cable {cable!r} at t_max" in verdict.cables else 1e4
    others = check_feasibility(ipanema(t_min=low, t_max=high), pose, heavy)
    assert others.margin == pytest.approx(verdict.margin, abs=1e-6)


def test_directions_without_cables_are_named() -> None:
    verdict = check_feasibility(hanging(), [0.4, 0.5, -0.5, 0.0, 0.0, 0.3])
    assert verdict.margin == -np.inf
    assert "give nothing along" in verdict.verdict
    assert "mx" in verdict.verdict
    with pytest.raises(InfeasibleError, match="give nothing along"):
        distribute(hanging(), [0.4, 0.5, -0.5, 0.0, 0.0, 0.3])


def test_a_hanging_platform_in_balance_has_its_tensions() -> None:
    robot = hanging()
    tensions = distribute(robot, robot.home_pose)
    assert tensions.residual <= 1e-9 * robot.weight
    # by hand: four equal cables carry the weight along their slope
    length = np.linalg.norm([0.4, 0.5, 0.5])
    assert tensions.values == pytest.approx(np.full(4, 9.81 * length / (4 * 0.5)))


@pytest.mark.parametrize("name", ROBOTS)
def test_batches_are_the_single_answers(name: str) -> None:
    robot = ROBOTS[name]
    poses = draw_poses(robot, 400, seed=34)
    margins = capacity_margins(robot, poses)
    for aim in ("least norm", "closest"):
        batch = distribute_batch(robot, poses, aim=aim)  # type: ignore[arg-type]
        assert np.array_equal(batch.feasible, margins >= 0.0)
        assert np.all(batch.residual[batch.feasible] <= 1e-9 * robot.weight)
        assert np.all((batch.values >= robot.t_min) & (batch.values <= robot.t_max))
        for i in np.flatnonzero(batch.feasible)[:15]:
            one = distribute(robot, poses[i], aim=aim)  # type: ignore[arg-type]
            assert batch.values[i] == pytest.approx(one.values, abs=1e-5)
    with pytest.raises(InfeasibleError, match="beyond what the cables can make"):
        batch.check()


def test_batches_are_right_up_to_the_boundary() -> None:
    """Wrenches are scaled until they are within a share of 1e-3 to 1e-7 of the boundary, on both sides."""
    robot = ROBOTS["spatial"]
    pose = np.array([0.3, 0.2, 0.9, 0.05, 0.02, -0.1])
    W = cable_functions(robot).wrench_matrix(pose)[0]
    random = np.random.default_rng(35)
    centre = -W @ (0.5 * (robot.t_min + robot.t_max))
    wrenches, inside = [], []
    for _ in range(60):
        direction = W @ random.normal(size=8)
        low, high = 0.0, 1e5
        for _ in range(80):
            half = 0.5 * (low + high)
            is_in = capacity_margins(robot, pose, centre + half * direction)[0] >= 0
            low, high = (half, high) if is_in else (low, half)
        share = 10.0 ** random.uniform(-7, -3)
        for sign in (-1, 1):
            wrenches.append(centre + low * (1 + sign * share) * direction)
            inside.append(sign < 0)
    for aim in ("least norm", "closest"):
        batch = distribute_batch(robot, np.tile(pose, (120, 1)), np.array(wrenches), aim=aim)  # type: ignore[arg-type]
        assert np.array_equal(batch.feasible, inside)


def test_tensions_are_continuous_along_a_motion() -> None:
    """Halving the step halves the largest change: no jump is left."""
    robot = ROBOTS["spatial"]
    ends = np.array([[-0.7, -0.4, 0.7, 0.03, 0.0, -0.05], [0.7, 0.4, 0.6, -0.03, 0.02, 0.05]])
    for aim in ("least norm", "closest"):
        changes = []
        for count in (1001, 2001, 4001):
            s = np.linspace(0.0, 1.0, count)[:, None]
            batch = distribute_batch(robot, (1 - s) * ends[0] + s * ends[1], aim=aim).check()  # type: ignore[arg-type]
            changes.append(np.max(np.abs(np.diff(batch.values, axis=0))))
        assert changes[1] == pytest.approx(0.5 * changes[0], rel=0.1)
        assert changes[2] == pytest.approx(0.5 * changes[1], rel=0.1)


def test_arguments_are_checked() -> None:
    robot = ROBOTS["spatial"]
    with pytest.raises(DefinitionError, match="aim is 'most'"):
        distribute(robot, [0.0] * 6, aim="most")  # type: ignore[arg-type]
    with pytest.raises(DefinitionError, match="for many poses"):
        distribute_batch(robot, [[0.0] * 6], aim="largest margin")  # type: ignore[arg-type]
    with pytest.raises(DefinitionError, match="must be 'closest'"):
        distribute(robot, [0.0] * 6, reference=10.0)
    with pytest.raises(DefinitionError, match="one pose is wanted"):
        distribute(robot, [[0.0] * 6] * 2)
    with pytest.raises(DefinitionError, match="wrench"):
        distribute(robot, [0.0] * 6, [0.0] * 3)


def test_tensions_of_a_batch_are_found_where_two_reach_their_limit_together() -> None:
    """At poses of symmetry but for round-off two cables come to t_min as one; which of them is free must be found."""
    robot = planar(t_min=1.0, t_max=60.0, gravity=(0, -9.81))
    random = np.random.default_rng(0)
    poses = np.zeros((1000, 3))
    poses[:, 1] = random.uniform(0.3, 0.5, 1000)
    poses[:, [0, 2]] = random.normal(size=(1000, 2)) * 10.0 ** random.uniform(-12, -5, (1000, 2))
    poses[:, 0] += 0.5
    tensions = distribute_batch(robot, poses)
    assert np.max(tensions.residual) <= 2e-9 * robot.weight
    assert np.mean(tensions.feasible) > 0.99  # to 1e-10 of the weight
