"""What a person says about pairs: check these, leave those out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from paraopt.errors import DefinitionError, unknown_name


@dataclass(frozen=True)
class PairRule:
    """Hold what was decided about the pairs of two bodies, or of all bodies of links.

    Attributes:
        first: Name of a body, or of a link for all its bodies; "world" for all obstacles.
        second: Idem.
        check: Whether the pairs are checked.
        reason: Why they are not.
    """

    first: str
    second: str
    check: bool
    reason: str = ""


def find_rule(rules: Sequence[PairRule], one: Sequence[str], other: Sequence[str]) -> PairRule | None:
    """Find the last rule that is about two bodies, each known by several names (its own, its links)."""
    for rule in reversed(rules):
        if (rule.first in one and rule.second in other) or (rule.first in other and rule.second in one):
            return rule
    return None


def read_rules(given: Any, check: bool, names: Sequence[str]) -> tuple[PairRule, ...]:
    """Turn pairs of names, as a person writes them, into rules.

    Args:
        given: Pairs of names, each two names or "first / second" as in the table; for pairs that are left out a mapping
            from these to the reasons, or pairs alone.
        check: Whether the pairs are checked.
        names: Names of bodies and links.

    Returns:
        The rules.

    Raises:
        UnknownNameError: A name is that of no body and no link.
        DefinitionError: What is given are no pairs, or a reason is no string.
    """
    what = "check" if check else "skip"
    if isinstance(given, (str, bytes)) or not isinstance(given, Iterable):
        raise DefinitionError(f"{what} is {given!r}; it must be a list of pairs of names")
    if check and isinstance(given, Mapping):
        raise DefinitionError("check is a mapping; pairs that are checked need no reason: give a list of pairs")
    reasons = given if isinstance(given, Mapping) else dict.fromkeys(given, "left out by hand")
    rules = []
    for pair, reason in reasons.items():
        ends = tuple(pair.split(" / ")) if isinstance(pair, str) else tuple(pair) if _is_pair(pair) else ()
        if len(ends) != 2:
            raise DefinitionError(f"{what} has {pair!r}; it must be two names, or 'first / second'")
        for name in ends:
            if name not in names:
                raise unknown_name("body or link in a pair", name, names)
        if not isinstance(reason, str) or not reason:
            raise DefinitionError(f"reason of {ends[0]} / {ends[1]} is {reason!r}; it must say why in words")
        rules.append(PairRule(ends[0], ends[1], check, "" if check else reason))
    return tuple(rules)


def _is_pair(pair: Any) -> bool:
    return isinstance(pair, (tuple, list)) and all(isinstance(name, str) for name in pair)
