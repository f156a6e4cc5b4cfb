"""The tripod against the closed forms of its source, in the corrected form of models.md §7."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.spatial import rotation_about

Array = np.ndarray
POSE = ("x", "y", "z", "alpha", "beta", "gamma")
LEGS = (1, 2, 3)
RADIUS, HALF_ANGLE, FOOT_RADIUS = 0.15, np.radians(20), 0.26
LOCKED = ("q1 1", "q2 1", "q3 1", "q6 1", "q1 2", "q1 3")  # b of leg 1 in the air


@functools.cache
def tripod() -> po.Robot:
    return po.robots.tripod()


@functools.cache
def walker() -> po.Kinematics:
    """The same machine, with a pose for each foot; used too little to be worth compiling."""
    return po.Kinematics(po.robots.tripod(free_feet=True).mechanism, "virtual machine")


@functools.cache
def walker_at_home() -> po.Configuration:
    robot = po.robots.tripod(free_feet=True)
    return walker().inverse({n: robot.home[n] for n in robot.mechanism.operational}, robot.home).configuration


# --- Closed forms: Tripod, 1-8, as corrected


def unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def signed_angle(a: Array, b: Array, normal: Array) -> float:
    """Equation 1."""
    return float(np.arctan2(normal @ np.cross(a, b), a @ b))


def projected(a: Array, normal: Array) -> Array:
    """Equation 2: the direction of a in the plane of the normal."""
    return unit(a - (a @ normal) * normal)


def rotation_zyx(alpha: float, beta: float, gamma: float) -> Array:
    R = rotation_about("z", gamma) @ rotation_about("y", beta) @ rotation_about("x", alpha)
    return np.asarray(R)


def attachments(i: int, pose: Array) -> tuple[Array, Array, Array]:
    """Give P_L, P_R and P_C of leg i in the world."""
    R, turn = rotation_zyx(*pose[3:]), (i - 1) * 2 * np.pi / 3
    left, right = (
        pose[:3] + R @ (RADIUS * np.array([np.cos(turn + a), np.sin(turn + a), 0])) for a in (-HALF_ANGLE, HALF_ANGLE)
    )
    return left, right, (left + right) / 2


def closed_forms(i: int, pose: Array, foot: Array) -> dict[str, float]:
    """Give q1 ... q6 and the lengths of the actuators of leg i for poses (x, y, z, alpha, beta, gamma)."""
    left, right, centre = attachments(i, pose)
    R_foot, A = rotation_zyx(*foot[3:]), foot[:3]
    u_a, w_a = R_foot[:, 0], R_foot[:, 2]
    u, lc = unit(right - left), unit(centre - A)
    v_c = unit(centre - pose[:3])
    v3 = unit(np.cross(u, lc))
    w = projected(w_a, v3)
    q4 = float(np.linalg.norm(centre - A))
    q5 = np.pi / 2 - signed_angle(u, lc, v3)
    d = RADIUS * np.sin(HALF_ANGLE)
    return {
        f"q6 {i}": np.pi / 2 - signed_angle(projected(lc, u), v_c, u),
        f"q5 {i}": q5,
        f"q4 {i}": q4,
        f"q3 {i}": signed_angle(lc, w, v3),
        f"q2 {i}": signed_angle(w, w_a, unit(np.cross(w, v3))),
        f"q1 {i}": signed_angle(u_a, projected(v3, w_a), w_a),
        f"qL {i}": float(np.sqrt(q4**2 + d**2 - 2 * q4 * d * np.sin(q5))),
        f"qR {i}": float(np.sqrt(q4**2 + d**2 + 2 * q4 * d * np.sin(q5))),
    }


def standing_feet() -> Array:
    turns = np.array([0.0, 2 * np.pi / 3, -2 * np.pi / 3])
    zero = np.zeros(3)
    return np.column_stack([FOOT_RADIUS * np.cos(turns), FOOT_RADIUS * np.sin(turns), zero, zero, zero, turns])


def difference(found: float, expected: float, name: str) -> float:
    gap = found - expected
    return gap if name.startswith(("q4", "qL", "qR")) else float(np.angle(np.exp(1j * gap)))


# --- Mode PP: the feet stand


def test_counts_and_ranks() -> None:
    """Two of six joints of each leg are driven; on three feet it is a Stewart platform."""
    report = po.report_state(tripod().kinematics, tripod().home_configuration)
    assert (report.n_variables, report.ranks["E"].value, report.mobility) == (36, 30, 6)
    assert len(tripod().mechanism.active) == 6
    assert report.ranks["[N K]"].value == report.ranks["N"].value + report.ranks["K"].value
    assert report.parallel_margin > 0.1  # level on level ground is regular as long as nothing is locked


def random_pose(seed: int) -> Array:
    home = np.array([0, 0, 0.32, 0, 0, 0])
    return home + np.random.default_rng(seed).uniform(-1, 1, size=6) * (0.04, 0.04, 0.04, 0.3, 0.3, 0.3)


@pytest.mark.parametrize("seed", range(12))
def test_closed_forms_at_random_poses(seed: int) -> None:
    pose, feet = random_pose(seed), standing_feet()
    solution = tripod().kinematics.inverse(dict(zip(POSE, pose, strict=True)), tripod().home_configuration)
    found = solution.configuration
    for i in LEGS:
        for name, expected in closed_forms(i, pose, feet[i - 1]).items():
            assert difference(found[name], expected, name) == pytest.approx(0, abs=1e-10), name


@pytest.mark.parametrize("seed", range(6))
def test_closed_forms_on_feet_anywhere(seed: int) -> None:
    """The foot of each leg has a pose of its own: uneven ground, turned feet."""
    random = np.random.default_rng(100 + seed)
    pose = random_pose(seed)
    feet = standing_feet() + random.uniform(-1, 1, size=(3, 6)) * (0.03, 0.03, 0.03, 0.2, 0.2, 0.4)
    values = dict(zip(POSE, pose, strict=True))
    for i in LEGS:
        values |= {f"foot {i} {c}": v for c, v in zip(POSE, feet[i - 1], strict=True)}
    found = walker().inverse(values, walker_at_home()).configuration
    for i in LEGS:
        for name, expected in closed_forms(i, pose, feet[i - 1]).items():
            assert difference(found[name], expected, name) == pytest.approx(0, abs=1e-10), name


def test_printed_forms_are_not_those_of_the_machine() -> None:
    """q6 with v_c from the world's origin, and q2 about u, as printed: wrong, the former by the place of the world."""
    pose, foot = random_pose(3), standing_feet()[1]
    left, right, centre = attachments(2, pose)
    u, lc = unit(right - left), unit(centre - foot[:3])
    expected = closed_forms(2, pose, foot)
    printed_q6 = np.pi / 2 - signed_angle(projected(lc, u), projected(unit(centre), u), u)
    assert abs(printed_q6 - expected["q6 2"]) > 0.5
    v3 = unit(np.cross(u, lc))
    w_a = np.array([0.0, 0, 1])
    printed_q2 = signed_angle(projected(w_a, v3), w_a, u)
    assert abs(printed_q2 - expected["q2 2"]) > 1e-4


# --- Mode BE: leg 1 in the air, its joints and q1 of the others locked


def feet_values(feet: Array) -> dict[str, float]:
    return {f"foot {i} {c}": float(v) for i in LEGS for c, v in zip(POSE, feet[i - 1], strict=True)}


def tilted() -> po.Configuration:
    start = dict(zip(POSE, (0, 0, 0.32, 0, 0.3, 0), strict=True))
    return walker().inverse(start | feet_values(standing_feet()), walker_at_home()).configuration


def singular_values(configuration: po.Configuration) -> Array:
    """Give the singular values of the columns that feet and locks leave, which 30 independent equations determine."""
    mechanism = walker().mechanism
    imposed = {*feet_values(standing_feet()), *LOCKED}
    (E,) = walker().functions.scaled_jacobian(configuration.X)
    return np.linalg.svd(E[:, [i for i, n in enumerate(mechanism.names) if n not in imposed]], compute_uv=False)


def test_level_platform_cannot_be_held_by_the_locks() -> None:
    """Six equations, six unknowns, rank 5 where u of both standing legs is square to w_a: level on level ground."""
    level = walker_at_home()
    values = singular_values(level)
    assert values.size == 30
    assert values[-1] < 1e-12 < 1e-3 < values[-2]
    assert singular_values(tilted())[-1] > 1e-3


def test_step_of_leg_1() -> None:
    """Checked: from (0, 0, 320) mm tilted by 0.3 rad, a step of 80 mm lifted by 30 mm ends at (51.411, 0, 383.487)."""
    start = tilted()
    locks = {n: start[n] for n in LOCKED}
    here, lengths = start, [start.active]
    for s in np.linspace(0, 1, 41)[1:]:
        feet = standing_feet()
        feet[0, 0] += 0.08 * s
        feet[0, 2] += 0.03 * 4 * s * (1 - s)  # the law of lifting that gives the stated extremes
        here = walker().solve(feet_values(feet) | locks, here).configuration
        lengths.append(here.active)
    end = [here[c] for c in POSE]
    assert_allclose(end, (0.051411, 0, 0.383487, 0, 0.3, 0), atol=6e-7)  # half of the last digit, and rounding
    assert np.min(lengths) == pytest.approx(0.3089, abs=6e-5)
    assert np.max(lengths) == pytest.approx(0.4427, abs=6e-5)
