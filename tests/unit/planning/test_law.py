"""Time laws: piecewise polynomials from 0 to 1."""

from __future__ import annotations

import numpy as np
import pytest

import paraopt as po
from paraopt.planning import TimeLaw


@pytest.fixture
def law() -> TimeLaw:
    """Accelerate by 1 / s^2 for a second, and brake as long: t^2 / 2, then 1 - (2 - t)^2 / 2."""
    return TimeLaw(np.array([0.0, 1.0, 2.0]), np.array([[0.5, -0.5], [0.0, 1.0], [0.0, 0.5]]))


def test_a_law_runs_from_nought_to_one(law: TimeLaw) -> None:
    assert law.duration == 2.0
    assert law(0.0) == 0.0
    assert law(2.0) == 1.0
    # every number here is a binary fraction: no rounding
    np.testing.assert_array_equal(law([0.25, 1.0, 1.5]), [0.03125, 0.5, 0.875])


def test_derivatives_are_those_of_the_pieces(law: TimeLaw) -> None:
    t = np.array([0.25, 0.5, 1.5])
    np.testing.assert_array_equal(law(t, 1), [0.25, 0.5, 0.5])
    np.testing.assert_array_equal(law(t, 2), [1.0, 1.0, -1.0])
    np.testing.assert_array_equal(law(t, 3), [0.0, 0.0, 0.0])


def test_times_of_parameters_are_found(law: TimeLaw) -> None:
    # halved to round-off of a time of 2 s
    np.testing.assert_allclose(law.time_at([0.0, 0.03125, 0.5, 0.875, 1.0]), [0.0, 0.25, 1.0, 1.5, 2.0], atol=1e-7)
    # at rest many times have parameters that are 1 but for round-off; between, they are known better
    np.testing.assert_allclose(law.time_at([0.03125, 0.5, 0.875]), [0.25, 1.0, 1.5], rtol=0, atol=1e-14)


def test_times_beyond_the_ends_count_as_the_ends(law: TimeLaw) -> None:
    np.testing.assert_array_equal(law([-1.0, 9.0]), [0.0, 1.0])


def test_values_stay_within_nought_and_one() -> None:
    # a law whose last piece ends a little high, as sums of rounded pieces do
    law = TimeLaw(np.array([0.0, 1.0]), np.array([[1.0 + 1e-12], [0.0]]))
    assert law(1.0) == 1.0
    assert law(1.0, 1) == 1.0 + 1e-12  # derivatives are as they are


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_stretched_law_is_slower_by_the_factor(law: TimeLaw, factor: float) -> None:
    slow, t = law.stretched(factor), np.linspace(0.0, law.duration, 33)
    assert slow.duration == factor * law.duration
    for order in range(4):
        # powers of two: exact
        np.testing.assert_array_equal(slow(factor * t, order), law(t, order) / factor**order)
    assert law.duration == 2.0  # the first one is untouched


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), float("inf")])
def test_a_faulty_factor_is_refused(law: TimeLaw, factor: float) -> None:
    with pytest.raises(po.DefinitionError, match=f"factor of a time law is {factor}"):
        law.stretched(factor)
