"""The five-bar RR-RRR against its sources: Lahouar, II.47; Chablat1998, as recomputed in models.md §2 and §10."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.kinematics import Determinants
from solutions import home_of, uncompiled
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


# --- The other dimensions of the source, and its bars as solids


def by_hand(target: Sequence[float], L: float, M: float, elbow: int) -> tuple[float, float]:
    """Angles of one leg in closed form: Chablat1998, 18 solved by the law of cosines."""
    r = np.hypot(*target)
    second = elbow * np.arccos((r**2 - L**2 - M**2) / (2 * L * M))
    return np.arctan2(target[1], target[0]) - elbow * np.arccos((r**2 + L**2 - M**2) / (2 * r * L)), second


LIMITED = {"base": 8.0, "proximal": (5.0, 5.0), "distal": (7.0, 7.0), "ranges": ((0.0, np.pi), (0.0, np.pi))}
WIDE = {"base": 5.0, "proximal": (8.0, 8.0), "distal": (5.0, 5.0), "levels": 2}


@pytest.mark.parametrize("dimensions", [{}, LIMITED, WIDE], ids=["9-8-5-5-8", "8-5-5-7-7", "5-8-8-5-5"])
@pytest.mark.parametrize("elbows", [(-1, 1), (1, 1), (-1, -1), (1, -1)])
def test_home_is_the_closed_form_of_the_inverse_model(dimensions: dict, elbows: tuple[int, int]) -> None:
    """The three sets of models.md §10, L0 ... L4, in all four working modes."""
    robot = po.robots.five_bar(**dimensions, elbows=elbows)
    kinematics = uncompiled(robot)
    home = kinematics.configuration(home_of(robot))
    assert home.residual < 1e-15
    base, proximal, distal = (
        dimensions.get(k, v) for k, v in (("base", 9.0), ("proximal", (8.0, 5.0)), ("distal", (5.0, 8.0)))
    )
    for i in range(2):
        first, second = by_hand((6.0 - i * base, 7.0), proximal[i], distal[i], elbows[i])
        assert_allclose(np.exp(1j * home[f"theta{i + 1}"]), np.exp(1j * first), rtol=0, atol=1e-12)
        assert home[f"theta{i + 3}"] == pytest.approx(second, abs=1e-12)
    # Chablat1998, after 18: B = diag(L1 L3 sin(theta3 - theta1), ...), whose signs are the working mode
    assert np.sign([np.sin(home["theta3"]), np.sin(home["theta4"])]).tolist() == list(elbows)


def test_limits_of_the_second_set() -> None:
    """Chablat1998, table 12: both drives in [0, pi]."""
    robot = po.robots.five_bar(**LIMITED)
    low, high = robot.limits.bounds(robot.mechanism)
    assert_allclose(np.column_stack([low, high])[:2], [(0, np.pi), (0, np.pi)], rtol=0, atol=0)
    assert np.all((home_of(robot) >= low) & (home_of(robot) <= high))


@pytest.mark.parametrize(
    ("tip", "elbows", "met"),
    [
        ((2.5, 11.0), (-1, 1), None),
        ((2.5, 6.0), (1, 1), "distal 1 / proximal 2"),
        ((2.5, 6.0), (-1, -1), "proximal 1 / distal 2"),
        ((5.0, 4.0), (1, -1), "proximal 1 / post 2"),
        ((0.0, 4.0), (1, -1), "proximal 2 / post 1"),
    ],
)
def test_on_two_levels_bars_meet_bars_and_posts(
    tip: tuple[float, float], elbows: tuple[int, int], met: str | None
) -> None:
    """Joined bars run on different levels; a bar meets those of the other leg on its level, and the posts."""
    robot = po.robots.five_bar(**WIDE, tip=tip, elbows=elbows)
    assert uncompiled(robot).configuration(home_of(robot)).residual < 1e-15
    scene = po.Scene(robot)
    (clearance,), (worst,) = scene.clearances(home_of(robot)[None])
    assert (clearance < 0, scene.pairs[worst].name if clearance < 0 else None) == (met is not None, met)
    # on four levels the same motion is free, by a third of the distance between levels of 3 radii
    free = po.Scene(po.robots.five_bar(**{**WIDE, "levels": 4}))
    assert free.clearances(home_of(robot)[None])[0][0] > 0.149


def test_what_cannot_be_assembled_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="leg 1 of the five-bar must span"):
        po.robots.five_bar(tip=(12.0, 9.0))
    with pytest.raises(po.DefinitionError, match="levels of the five-bar is 3"):
        po.robots.five_bar(levels=3)
