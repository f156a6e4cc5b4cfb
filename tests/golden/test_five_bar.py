"""The five-bar RR-RRR against its sources: Lahouar, II.47; Chablat1998, as recomputed in models.md §2 and §10."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics import Determinants
from support import five_bar_robot

Array = np.ndarray
LENGTHS = (9.0, 8.0, 5.0, 5.0, 8.0)


def all_solutions(impose: dict[str, float], starts: int = 200) -> Array:
    """Find every solution by starting everywhere; angles are compared on the circle."""
    kinematics = five_bar_robot().kinematics
    mechanism = kinematics.mechanism
    random = np.random.default_rng(0)
    low = [-np.pi if v.kind == "angle" else -13.0 for v in mechanism.variables]
    X = random.uniform(low, np.negative(low), size=(starts, 6))
    batch = kinematics.solve_batch(tuple(impose), np.tile(list(impose.values()), (starts, 1)), X)
    found: list[Array] = []
    for x in batch.X[batch.converged]:
        x = np.where([v.kind == "angle" for v in mechanism.variables], (x + np.pi) % (2 * np.pi) - np.pi, x)
        if not any(np.max(np.abs(np.exp(1j * (x - y)) - 1)) < 1e-6 for y in found):
            found.append(x)
    return np.array(found)


def test_dimensions_are_as_printed() -> None:
    """L0 ... L4 = 9, 8, 5, 5, 8: base, the two driven bars, the two bars that carry the end point."""
    mechanism = five_bar_robot().mechanism
    at = {link.name: link.at for link in mechanism.links if isinstance(link, po.Series)}
    assert at["proximal 2"] == (LENGTHS[0], 0, 0)
    assert at["distal 1"] == (LENGTHS[1], 0, 0)
    assert at["distal 2"] == (LENGTHS[2], 0, 0)
    ends = {c.link_A: c.point_A for c in mechanism.closures if isinstance(c, po.Coincidence)}
    assert ends == {"distal 1": (LENGTHS[3], 0, 0), "distal 2": (LENGTHS[4], 0, 0)}


def test_counts_and_ranks() -> None:
    """Printed: N = 6, 4 equations of rank 4, m = 2, operational (x, y)."""
    robot = five_bar_robot()
    report = po.report_state(robot.kinematics, robot.home_configuration)
    assert (report.n_variables, report.n_equations, report.ranks["E"].value, report.mobility) == (6, 4, 4, 2)
    assert robot.mechanism.operational == ("x", "y")


@pytest.mark.parametrize("tip", [(6.0, 7.0), (4.5, 6.0), (3.0, -7.0), (5.5, 3.5)])
def test_four_working_modes(tip: Sequence[float]) -> None:
    """Each leg has its elbow on one side or the other; the product is four, one for each pair of signs."""
    solutions = all_solutions(dict(zip("xy", tip, strict=True)))
    names = five_bar_robot().mechanism.names
    elbows = np.sign(solutions[:, [names.index("theta3"), names.index("theta4")]])
    assert sorted(map(tuple, elbows.tolist())) == [(-1, -1), (-1, 1), (1, -1), (1, 1)]
    # the sign of the serial determinant is that of the product of both legs'
    determinants = Determinants.at(five_bar_robot().kinematics, five_bar_robot().home_configuration)
    signs = np.sign(determinants(solutions)[1])
    assert abs(np.sum(signs * elbows[:, 0] * elbows[:, 1])) == 4


@pytest.mark.parametrize("q", [(1.4, 0.7), (1.0, 0.3), (2.0, 1.5), (-1.2, -0.5)])
def test_two_assembly_modes(q: Sequence[float]) -> None:
    """The end point is on two circles: two solutions, mirrored in the line of the elbows, of opposite determinants."""
    solutions = all_solutions({"theta1": q[0], "theta2": q[1]})
    assert len(solutions) == 2
    tips = solutions[:, -2:]
    B1 = 8 * np.array([np.cos(q[0]), np.sin(q[0])])
    B2 = (9, 0) + 5 * np.array([np.cos(q[1]), np.sin(q[1])])
    for tip in tips:
        assert np.linalg.norm(tip - B1) == pytest.approx(5, abs=1e-10)
        assert np.linalg.norm(tip - B2) == pytest.approx(8, abs=1e-10)
    assert_allclose((tips[0] - tips[1]) @ (B2 - B1), 0, atol=1e-9)
    determinants = Determinants.at(five_bar_robot().kinematics, five_bar_robot().home_configuration)
    parallel, _ = determinants(solutions)
    assert parallel[0] * parallel[1] < 0


def test_no_assembly_where_the_elbows_are_too_far_apart() -> None:
    """theta1 = pi, theta2 = 0: elbows at (-8, 0) and (14, 0), 22 apart, bars of 13."""
    assert len(all_solutions({"theta1": np.pi, "theta2": 0.0}, starts=50)) == 0
