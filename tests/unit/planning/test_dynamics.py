"""Bounds on speed and acceleration that a problem states: retimers keep them, the certificate checks them."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import paraopt as po
from motions import raf_problem

Array = np.ndarray
LIMIT = 0.6  # [m/s^2]


def _along_x(points: Any) -> tuple[Array, Array, Array]:
    """Bound the platform's acceleration along x, on both sides: two rows, -1 at rest."""
    i = po.robots.raf().mechanism.index("x")
    a, b = points.dX[:, [i]] / LIMIT, points.ddX[:, [i]] / LIMIT
    return np.hstack([a, -a]), np.hstack([b, -b]), -np.ones((len(a), 2))


BOUND = po.RowConstraint(("forwards along x", "backwards along x"), _along_x)


@functools.cache
def planned(retimer: po.TimeOptimal | po.JerkLimited) -> po.Plan:
    return po.plan(replace(raf_problem("free"), dynamics=(BOUND,)), retimer=retimer)


@pytest.mark.parametrize("retimer", [po.TimeOptimal(), po.JerkLimited()])
def test_retimers_keep_and_the_certificate_tells_what_the_problem_states(retimer: Any) -> None:
    plan = planned(retimer)
    t = np.linspace(0.0, plan.trajectory.duration, 5001)
    x = plan.trajectory(t, 2)[:, plan.problem.robot.mechanism.index("x")]
    assert np.max(np.abs(x)) <= LIMIT * 1.001
    check = plan.certificate["dynamics, RowConstraint"]
    assert check.passed
    assert check.where in BOUND.names
    # rows are -1 at rest: what is left of the limit
    assert check.value == pytest.approx(np.max(np.abs(x)) / LIMIT - 1.0, abs=2e-3)
    assert np.max(np.abs(x)) >= 0.95 * LIMIT, "the bound is what holds the motion back"


def test_a_faster_law_is_not_certified() -> None:
    faster = po.plan(raf_problem("free"))
    check = po.verify(replace(raf_problem("free"), dynamics=(BOUND,)), faster.trajectory)["dynamics, RowConstraint"]
    assert not check.passed
    assert check.value > 0.2
    assert faster.trajectory.duration < planned(po.TimeOptimal()).trajectory.duration


def test_bounds_of_problem_and_retimer_add_up() -> None:
    """Stated in the problem or in the retimer, a bound gives the same motion."""
    ours = planned(po.TimeOptimal()).trajectory.duration
    theirs = po.plan(raf_problem("free"), retimer=po.TimeOptimal(constraints=(BOUND,))).trajectory.duration
    assert ours == pytest.approx(theirs, rel=1e-9)


def test_a_bound_that_is_no_sequence_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match=r"dynamics of the problem are .*; they must be a sequence"):
        replace(raf_problem("free"), dynamics=BOUND)
