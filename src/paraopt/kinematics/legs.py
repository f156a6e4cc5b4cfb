"""Legs: with the platform imposed, the equations fall apart into blocks that share no joint variable."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from paraopt.closure import ClosureGraph


@dataclass(frozen=True)
class Leg:
    """Name the equations and joint variables of one block of `[M N]`.

    Attributes:
        rows: Indices of the closure equations.
        active: Names of the driven variables.
        passive: Names of the passive variables.
    """

    rows: tuple[int, ...]
    active: tuple[str, ...]
    passive: tuple[str, ...]

    @property
    def name(self) -> str:
        """Name the leg by its drives, or by its passive variables when it has none."""
        return ", ".join(self.active or self.passive)

    @property
    def variables(self) -> tuple[str, ...]:
        """List the joint variables, driven ones first."""
        return self.active + self.passive


def find_legs(graph: ClosureGraph, held: Collection[str] = ()) -> tuple[Leg, ...]:
    """Decompose `[M N]` by its sparsity: the legs are found, not declared.

    Two equations belong to one leg when they share a joint variable, directly or through others. Passive coordinates of
    the platform tie its legs together.

    Args:
        graph: The closure equations.
        held: Joint variables that are imposed as well, such as passive coordinates of the platform.

    Returns:
        The legs in the order of their first variable; variables that enter no equation belong to none.
    """
    mechanism = graph.mechanism
    n_joints = len(mechanism.active) + len(mechanism.passive)
    rows, columns = (np.asarray(k, dtype=int) for k in graph.E.sparsity().get_triplet())
    chosen = (columns < n_joints) & ~np.isin(columns, mechanism.indices(held))
    rows, columns = rows[chosen], columns[chosen]
    n_rows = graph.F.numel()
    size = n_rows + n_joints
    incidence = sp.coo_matrix((np.ones(len(rows)), (rows, n_rows + columns)), shape=(size, size))
    _, labels = connected_components(incidence, directed=False)
    legs = []
    for label in dict.fromkeys(labels[n_rows:]):
        members = np.flatnonzero(labels == label)
        equations = members[members < n_rows]
        if not equations.size:
            continue
        names = [mechanism.names[i - n_rows] for i in members if i >= n_rows]
        active = tuple(n for n in names if n in mechanism.active)
        legs.append(Leg(tuple(equations.tolist()), active, tuple(n for n in names if n not in active)))
    return tuple(legs)
