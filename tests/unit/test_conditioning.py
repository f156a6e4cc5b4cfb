"""Conditioning: condition numbers against closed forms, isotropic configurations, maps over a grid."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import paraopt as po
from support import Array, five_bar_robot, raf_configurations, raf_robot, two_rpr, two_rpr_values, vector


@functools.cache
def symmetric() -> po.Robot:
    """Give the symmetric five-bar of models.md §10: base 8, proximal bars 5, distal bars 7."""
    return po.robots.five_bar(base=8.0, proximal=(5.0, 5.0), distal=(7.0, 7.0))


def closed_forms(X: Array) -> tuple[Array, Array]:
    """K(A) = max(|tan(D/2)|, 1/|tan(D/2)|), D the angle between the distal bars; K(B) = betamax / betamin.

    Source: Chablat1998, 3.5; models.md §10 (the printed K(A) holds for cos D >= 0 only, K(B) without the root).
    """
    index = symmetric().mechanism.index
    theta = {i: X[..., index(f"theta{i}")] for i in (1, 2, 3, 4)}
    delta = (theta[1] + theta[3]) - (theta[2] + theta[4])  # relative angles to absolute ones
    t = np.abs(np.tan(delta / 2))
    beta = 7 * 5 * np.abs(np.sin(np.stack([theta[3], theta[4]])))
    return np.maximum(t, 1 / t), beta.max(axis=0) / beta.min(axis=0)


@functools.cache
def map_of_symmetric() -> po.ConditioningMap:
    robot = symmetric()
    axes = {"x": np.linspace(-6, 14, 81), "y": np.linspace(-12, 12, 97)}
    return po.map_conditioning(robot.kinematics, axes, robot.home_configuration)


def test_iso_conditioning_map_of_the_symmetric_five_bar() -> None:
    conditioning = map_of_symmetric()
    reached = conditioning.is_reached
    assert reached.shape == (81, 97)
    assert np.count_nonzero(reached) > 1000
    A, B = closed_forms(conditioning.X[reached])
    # a condition number c is known to about 1e-16 c^2; B comes from cosines of joint angles near a stretched leg
    assert_allclose(conditioning.condition_A[reached], A, rtol=1e-9 * np.maximum(1, A.max()))
    assert_allclose(1 / conditioning.condition_B[reached], 1 / B, atol=1e-9)
    assert_allclose(1 / conditioning.condition_A[reached], 1 / A, atol=1e-9)
    assert conditioning.condition_A[reached].min() < 1.05
    assert np.all(np.isnan(conditioning.condition_A[~reached]))


def test_the_map_stays_in_its_working_mode_and_is_symmetric() -> None:
    conditioning = map_of_symmetric()
    X = conditioning.X[conditioning.is_reached]
    home, index = symmetric().home_configuration, symmetric().mechanism.index
    for joint in ("theta3", "theta4"):
        assert set(np.sign(np.sin(X[:, index(joint)]))) == {np.sign(np.sin(home[joint]))}
    # what is reached in one working mode: both annuli of radii 2 and 12, whole
    x, y = np.meshgrid(*conditioning.axes.values(), indexing="ij")
    radii = [np.hypot(x - foot, y) for foot in (0.0, 8.0)]
    inside = np.all([(r >= 2 - 1e-9) & (r <= 12 + 1e-9) for r in radii], axis=0)  # the rims are on the grid
    assert_array_equal(conditioning.is_reached & ~inside, False)
    assert np.count_nonzero(conditioning.is_reached & inside) > 0.98 * np.count_nonzero(inside)


def test_condition_numbers_are_those_of_the_velocity_models() -> None:
    for robot in (five_bar_robot(), raf_robot()):
        configurations = raf_configurations()[:4] if robot.name == "RAF" else (robot.home_configuration,)
        values = po.condition_numbers(robot.kinematics, [c.X for c in configurations])
        models = [po.eliminate_passives(robot.kinematics, c) for c in configurations]
        assert_allclose(values[0], [m.condition_A for m in models], rtol=1e-9)
        assert_allclose(values[1], [m.condition_B for m in models], rtol=1e-9)


def test_ranks_that_change_along_a_batch_are_handled() -> None:
    kinematics = po.Kinematics(two_rpr(), "virtual machine")
    X = [vector(kinematics.mechanism, two_rpr_values(x, y)) for x, y in ((2.0, 2.0), (1.5, 0.0), (0.0, 0.0))]
    A, B = po.condition_numbers(kinematics, X)
    assert A[0] == pytest.approx(1.0)  # legs at a right angle
    assert A[1] > 1e12  # in one line
    assert_allclose(B[:2], 1.0)


# --- Isotropy


@pytest.mark.parametrize("matrix", ["A", "B"])
def test_isotropic_configurations_of_the_five_bar(matrix: Any) -> None:
    robot = symmetric()
    answer = po.find_isotropic(robot.kinematics, robot.home_configuration, matrix)
    assert answer.is_isotropic
    assert answer.condition == pytest.approx(1.0, abs=1e-6)
    A, B = closed_forms(answer.configuration.X)
    assert (A if matrix == "A" else B) == pytest.approx(1.0, abs=1e-6)


def test_isotropy_along_a_line() -> None:
    """On the axis of symmetry B is isotropic everywhere; A where the distal bars make a right angle."""
    robot = symmetric()
    answer = po.find_isotropic(robot.kinematics, robot.home_configuration, "A", fixed={"x": 4.0})
    assert answer.is_isotropic
    assert answer.configuration["x"] == pytest.approx(4.0, abs=1e-9)
    index = robot.mechanism.index
    X = answer.configuration.X
    delta = X[index("theta1")] + X[index("theta3")] - X[index("theta2")] - X[index("theta4")]
    assert np.cos(delta) == pytest.approx(0, abs=1e-5)


def test_best_conditioned_pose_of_the_raf_is_not_isotropic() -> None:
    """With redundant rows and idle spins; the optimum beats its surroundings."""
    robot = raf_robot()
    answer = po.find_isotropic(robot.kinematics, robot.home_configuration, "A")
    assert not answer.is_isotropic
    home = po.eliminate_passives(robot.kinematics, robot.home_configuration).condition_A
    assert 1.0 < answer.condition < home


def test_no_isotropy_from_a_singular_start() -> None:
    kinematics = po.Kinematics(two_rpr(), "virtual machine")
    start = kinematics.configuration(vector(kinematics.mechanism, two_rpr_values(1.5, 0.0)))
    with pytest.raises(po.SolveError, match="singular at the start"):
        po.find_isotropic(kinematics, start, "A")


@pytest.mark.parametrize(
    ("options", "word"), [({"matrix": "C"}, "'C'"), ({"fixed": {"x": np.nan}}, "'x'"), ({"fixed": {"w": 0.0}}, "'w'")]
)
def test_faulty_questions_are_refused(options: dict[str, Any], word: str) -> None:
    robot = symmetric()
    with pytest.raises(po.DefinitionError, match=word):
        po.find_isotropic(robot.kinematics, robot.home_configuration, **options)


@pytest.mark.parametrize(
    ("axes", "word"),
    [
        ({"x": [1, 2]}, "operational"),
        ({"x": [1, 2], "y": [2, 1]}, "'y' of the map must be increasing"),
        ({"x": [], "y": [1]}, "'x' of the map"),
        ({"x": [1, np.nan], "y": [1]}, "finite"),
        ({"x": "wide", "y": [1]}, "numbers"),
    ],
)
def test_faulty_axes_are_refused(axes: dict[str, Any], word: str) -> None:
    with pytest.raises(po.DefinitionError, match=word):
        po.map_conditioning(symmetric().kinematics, axes, symmetric().home_configuration)


def test_what_is_isotropic_already_is_returned() -> None:
    """B of a machine whose legs stretch is a rotation everywhere: each leg has one equation and one drive."""
    robot = po.robots.three_rpr()
    kinematics = po.Kinematics(robot.mechanism, "virtual machine")
    start = kinematics.inverse({"x": 5.0, "y": 3.0, "theta": 0.5}, robot.home).configuration
    found = po.kinematics.find_isotropic(kinematics, start, "B")
    assert found.is_isotropic
    assert found.configuration is start
    # a value that the start has not is still imposed
    elsewhere = po.kinematics.find_isotropic(kinematics, start, "A", fixed={"theta": 0.9})
    assert elsewhere.configuration["theta"] == pytest.approx(0.9, abs=1e-9)
