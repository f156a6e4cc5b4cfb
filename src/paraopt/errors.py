"""One tree of exceptions.

Every message names the quantity, its value and unit, the bound, and what to try. Evidence (the problem, the last
iterate, residuals, a failed certificate) travels in `ParaoptError.evidence`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any


class ParaoptError(Exception):
    """Signal any failure of paraopt; `evidence` holds what is needed to judge it.

    Args:
        message: A sentence a person can act on.
        evidence: Objects that support the message, by name.
    """

    def __init__(self, message: str, **evidence: Any) -> None:
        super().__init__(message)
        self.evidence: Mapping[str, Any] = evidence


class DefinitionError(ParaoptError, ValueError):
    """Signal a description (mechanism, shape, limit, option) that cannot be built."""


class UnknownNameError(DefinitionError):
    """Signal a name that does not exist; the message lists the valid ones."""


class MissingBackendError(ParaoptError, ImportError):
    """Signal an optional package that is not installed."""


class SolveError(ParaoptError):
    """Signal a model (inverse, forward, locked) that has no acceptable solution."""


class InfeasibleError(ParaoptError):
    """Signal a problem that cannot have a solution as stated."""


class NoPathError(InfeasibleError):
    """Signal that no path exists at the search's step between a start and a goal that are both valid."""


class BudgetExceededError(ParaoptError):
    """Signal that a search stopped because its budget ran out: a solution may still exist."""


class RefineError(SolveError):
    """Signal that the refinement of a path did not reach a feasible optimum."""


class RetimeError(SolveError):
    """Signal that no admissible time law was found for a path."""


class CertificateError(ParaoptError):
    """Signal a plan that its own certificate contradicts."""


class BackendError(ParaoptError):
    """Signal an unexpected failure inside a backend (coal, toppra, ruckig, IPOPT), wrapped with its cause."""


def unknown_name(kind: str, name: str, valid: Iterable[str]) -> UnknownNameError:
    """Build the error for a name that does not exist, with the valid names and the closest one."""
    names = [str(v) for v in valid]
    close = [v for v in names if v.casefold() == str(name).casefold()] or get_close_matches(str(name), names, n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    return UnknownNameError(f"unknown {kind} {name!r}{hint}; valid names: {', '.join(map(repr, names)) or 'none'}")
