"""The tree of exceptions: who is whose kind, evidence, and the message about an unknown name."""

from __future__ import annotations

import inspect

import pytest

import paraopt as po
from paraopt import errors

ALL = [kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, Exception)]


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.__name__)
def test_every_error_is_a_paraopt_error_and_public(kind: type[Exception]) -> None:
    assert issubclass(kind, po.ParaoptError)
    assert getattr(po, kind.__name__) is kind


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.__name__)
def test_evidence_travels_as_an_attribute(kind: type[po.ParaoptError]) -> None:
    error = kind("stroke of 'q1' is 0.3 m, the bound is 0.2 m", residual=0.5, X=(1, 2))
    assert str(error) == "stroke of 'q1' is 0.3 m, the bound is 0.2 m"
    assert dict(error.evidence) == {"residual": 0.5, "X": (1, 2)}
    assert dict(kind("no evidence").evidence) == {}


@pytest.mark.parametrize(
    ("kind", "parents"),
    [
        (errors.DefinitionError, {ValueError}),
        (errors.UnknownNameError, {errors.DefinitionError, ValueError}),
        (errors.MissingBackendError, {ImportError}),
        (errors.NoPathError, {errors.InfeasibleError}),
        (errors.RefineError, {errors.SolveError}),
        (errors.RetimeError, {errors.SolveError}),
    ],
)
def test_kinds_can_be_caught_by_their_parents(kind: type[Exception], parents: set[type[Exception]]) -> None:
    assert all(issubclass(kind, parent) for parent in parents)


def test_no_solution_and_no_budget_are_different_errors() -> None:
    assert not issubclass(errors.BudgetExceededError, errors.InfeasibleError)
    assert not issubclass(errors.NoPathError, errors.BudgetExceededError)


def test_unknown_name_lists_the_valid_ones_and_the_closest() -> None:
    error = errors.unknown_name("link", "plattform", ["base", "platform", "rod 1"])
    assert isinstance(error, errors.UnknownNameError)
    for part in ("link", "'plattform'", "did you mean 'platform'?", "'base', 'platform', 'rod 1'"):
        assert part in str(error)


def test_unknown_name_without_a_close_one_or_any() -> None:
    assert "did you mean" not in str(errors.unknown_name("link", "zzz", ["base"]))
    assert str(errors.unknown_name("link", "zzz", [])).endswith("valid names: none")
