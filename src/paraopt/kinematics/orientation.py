"""Signs of determinants that can be compared between poses, whatever angles and equations describe the machine."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.legs import Leg, find_legs
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.platform import passive_coordinates
from paraopt.kinematics.ranks import compute_rank, independent_rows
from paraopt.mechanism import Mobile

Array = NDArray[np.float64]


def chart_signs(kinematics: Kinematics, X: Array, names: Collection[str]) -> Array:
    """Tell which set of angles of universal and spherical joints and of free links describes each configuration.

    `Rx(a) Ry(b)` and `Rx(a + pi) Ry(pi - b)` give the same direction, and determinants of opposite signs. The sign is
    that of the product of the cosines of all second angles; a determinant times this sign belongs to the posture.

    Args:
        kinematics: The mechanism's functions.
        X: Values of all variables [m or rad], shape (n, n_variables).
        names: Variables that the determinant is about; joints of which not both angles are among them are left out.

    Returns:
        1 or -1, shape (n,).
    """
    signs = np.ones(len(X))
    for link in kinematics.mechanism.links:
        angles = [m for m in link.motions if m.kind == "angle"]
        if len(angles) > 1 and {m.name for m in angles[:2]} <= set(names):
            signs *= np.where(np.cos(X[:, kinematics.mechanism.index(angles[1].name)]) < 0, -1.0, 1.0)
    return signs


def twist_columns(kinematics: Kinematics, E: Array, X: Array) -> Array:
    """Give the columns of the twists of free links, in their own frames, that E has for their coordinates.

    Which of these columns depend on each other in the rows of a tie is the same at every pose.

    Args:
        kinematics: The mechanism's functions.
        E: Scaled Jacobians [1], shape (n, n_equations, n_variables).
        X: Values of all variables [m or rad], shape (n, n_variables).

    Returns:
        The columns [1], shape (n, n_equations, n_coordinates).
    """
    mechanism = kinematics.mechanism
    poses = kinematics.poses(X)
    parts = []
    for number, link in enumerate(mechanism.links):
        if not isinstance(link, Mobile):
            continue
        R = poses[:, number, :3, :3]
        shifts = [m for m in link.motions if m.kind == "length"]
        angles = [m for m in link.motions if m.kind == "angle"]
        moved = E[:, :, mechanism.indices(m.name for m in shifts)]
        axes = ["xyz".index(m.axis) for m in shifts]
        if len(shifts) == 3 or (len(shifts) == 2 and mechanism.planar):
            moved = moved @ R[:, axes][:, :, axes]
        turned = E[:, :, mechanism.indices(m.name for m in angles)]
        if len(angles) == 3:
            # columns of the rates: each axis, carried by the turns after it
            rates = np.zeros((len(X), 3, 3))
            after = np.tile(np.eye(3), (len(X), 1, 1))
            for k in (2, 1, 0):
                axis = "xyz".index(angles[k].axis)
                rates[:, :, k] = after[:, axis]
                after = _turns(axis, X[:, mechanism.index(angles[k].name)]) @ after
            turned = turned @ np.linalg.pinv(rates)
        parts += [moved, turned]
    return np.concatenate(parts, axis=2) if parts else np.zeros((*E.shape[:2], 0))


def _turns(axis: int, angle: Array) -> Array:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.zeros((len(angle), 3, 3))
    R[:, axis, axis] = 1.0
    R[:, i, i] = R[:, j, j] = np.cos(angle)
    R[:, j, i] = np.sin(angle)
    R[:, i, j] = -np.sin(angle)
    return R


@dataclass(frozen=True, eq=False)
class ParallelOrientation:
    """Evaluate the determinant of [N K], divided by the volume of the equations: it lies in [-1, 1].

    Where equations repeat others, those of a leg are replaced by their products with as many columns of the platform's
    twist as are independent (`twist_columns`, chosen once), or, where these do not span them, with columns of E.

    Attributes:
        kinematics: The mechanism's functions.
        parts: Rows of each leg or constraint, and the columns by which they are multiplied: indices of twists, or
            -1 - i for column i of E; None for the rows themselves.
        columns: Columns that are not idle.
        is_certain: Whether signs can be compared between all configurations; where rows were combined by columns of E,
            or chosen, they can only be where these stay independent.
    """

    kinematics: Kinematics
    parts: tuple[tuple[NDArray[np.intp], NDArray[np.intp] | None], ...]
    columns: NDArray[np.intp]
    is_certain: bool

    @classmethod
    def at(cls, kinematics: Kinematics, X: Array) -> ParallelOrientation:
        """Choose equations at a regular configuration, shape (n_variables,)."""
        known = _PARALLEL.get(kinematics)
        if known is not None:
            return known
        mechanism = kinematics.mechanism
        (E,) = kinematics.functions.scaled_jacobian.batch(X[None])
        columns = np.array([k for k, name in enumerate(mechanism.names) if name not in kinematics.idle], dtype=int)
        everything = np.arange(E.shape[1])
        certain = True
        if len(independent_rows(E[0])) == len(everything):
            parts: list[tuple[NDArray[np.intp], NDArray[np.intp] | None]] = [(everything, None)]
        else:
            legs = find_legs(kinematics.graph, passive_coordinates(kinematics))
            loose = np.setdiff1d(everything, [k for leg in legs for k in leg.rows])
            twists = twist_columns(kinematics, E, X[None])[0]
            parts, certain = _combine([*(np.array(leg.rows, dtype=int) for leg in legs), loose], E[0], twists)
            if not certain:  # a leg of several closures may have more independent rows than the platform has twists
                names = [row.closure for row in kinematics.graph.rows]
                closures = [np.flatnonzero([n == name for n in names]) for name in dict.fromkeys(names)]
                finer, certain = _combine(closures, E[0], twists)
                whole = sum(len(rows) if chosen is None else len(chosen) for rows, chosen in finer)
                parts = finer if certain or whole == compute_rank(E[0]).value else parts
        made = cls(kinematics, tuple(parts), columns, certain)
        _PARALLEL[kinematics] = made
        return made

    def __call__(self, X: Array) -> Array:
        """Evaluate at n configurations.

        Args:
            X: Values, shape (n, n_variables).

        Returns:
            Normalised determinants [1], shape (n,); nan where [N K] is not square.
        """
        whole = self.rows(X)[:, :, self.columns]
        square = whole[:, :, self.columns >= len(self.kinematics.mechanism.active)]
        if square.shape[1] != square.shape[2]:
            return np.full(len(X), np.nan)
        volume = 0.5 * np.linalg.slogdet(whole @ whole.transpose(0, 2, 1))[1]
        sign, logarithm = np.linalg.slogdet(square)
        names = self.kinematics.mechanism.names[len(self.kinematics.mechanism.active) :]
        return np.asarray(chart_signs(self.kinematics, X, names) * sign * np.exp(logarithm - volume), dtype=float)

    def rows(self, X: Array) -> Array:
        """Give as many combinations of the equations' derivatives as are independent.

        Args:
            X: Values, shape (n, n_variables).

        Returns:
            Scaled rows [1], shape (n, n_rows, n_variables).
        """
        (E,) = self.kinematics.functions.scaled_jacobian.batch(X)
        is_twisted = any(chosen is not None and chosen[0] >= 0 for _, chosen in self.parts)
        twists = twist_columns(self.kinematics, E, X) if is_twisted else E
        rows = []
        for part, chosen in self.parts:
            block = E[:, part]
            if chosen is not None:
                factor = twists[:, part][:, :, chosen] if chosen[0] >= 0 else block[:, :, -1 - chosen]
                block = factor.transpose(0, 2, 1) @ block
            rows.append(block)
        return np.concatenate([E[:, :0], *rows], axis=1)


def _combine(
    groups: Sequence[NDArray[np.intp]], E: Array, twists: Array
) -> tuple[list[tuple[NDArray[np.intp], NDArray[np.intp] | None]], bool]:
    """Combine the rows of each group to as many as are independent, by columns of twists; tell whether all could be."""
    parts: list[tuple[NDArray[np.intp], NDArray[np.intp] | None]] = []
    certain = True
    for rows in groups:
        rank = compute_rank(E[rows]).value
        if rank == len(rows):
            parts.append((rows, None))
            continue
        if not rank:  # equations that nothing moves
            continue
        chosen = independent_rows(twists[rows].T)[:rank]
        if compute_rank(twists[rows][:, chosen]).value == rank:
            parts.append((rows, chosen))
        else:  # as in a loop within a leg: by columns of variables, which move with the leg, unlike rows
            parts.append((rows, -1 - independent_rows(E[rows].T)[:rank]))
            certain = False
    count = sum(len(rows) if chosen is None else len(chosen) for rows, chosen in parts)
    if count > compute_rank(E).value:  # groups repeat each other
        return [(independent_rows(E), None)], False
    return parts, certain


@dataclass(frozen=True, eq=False)
class LegOrientation:
    """Give the sign of a leg's block J, shape (m, n), of its rows and variables.

    * Square: the sign of det J.
    * The platform moves the rows as J does: the sign of `det(C^T J)`, where C are n columns of the platform's
      twist in the same rows (`twist_columns`). Both span the motions that the tied points can make, so the sign does
      not depend on which rows repeat others.
    * The joints follow the pose by `T = -J^+ K` while other coordinates are held, as in the parallelograms of a Delta:
      the sign of the determinant of as many rows of T as there are operational coordinates, those of the first joints
      that are independent, drives before others.
    * Rows repeat others in another way: the sign of the determinant of as many rows as are independent.

    Rows and columns are chosen once for each mechanism, at the first pose that is asked for. Signs are comparable
    between poses as long as what was chosen stays independent, which the twists do at all poses.

    Attributes:
        kinematics: The mechanism's functions.
        rows: Rows of the leg.
        columns: Columns of its variables.
        platform: Chosen twists C, empty where they are not used.
        pose: Columns K of the operational coordinates, empty where T is not used.
        joints: Chosen rows of T.
    """

    kinematics: Kinematics
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    platform: NDArray[np.intp]
    pose: NDArray[np.intp]
    joints: NDArray[np.intp]

    @classmethod
    def of(cls, kinematics: Kinematics, leg: Leg, held: Sequence[str], X: Array) -> LegOrientation:
        """Choose rows and columns for one leg, or find the choice that was made before.

        Args:
            kinematics: The mechanism's functions.
            leg: The leg.
            held: Names of the coordinates that are held.
            X: One of its postures, shape (n_variables,).
        """
        known = _CHOICES.setdefault(kinematics, {})
        key = (leg.rows, leg.variables, tuple(held))
        if key not in known:
            known[key] = cls._choose(kinematics, leg, X)
        return known[key]

    @classmethod
    def _choose(cls, kinematics: Kinematics, leg: Leg, X: Array) -> LegOrientation:
        mechanism = kinematics.mechanism
        (E,) = kinematics.functions.scaled_jacobian(X)
        rows, columns = np.array(leg.rows, dtype=int), np.array(mechanism.indices(leg.variables), dtype=int)
        block, none, n = E[rows], np.arange(0), len(columns)
        J = block[:, columns]
        if len(rows) <= n or compute_rank(J).value < n:
            return cls(kinematics, rows, columns, none, none, none)
        twists = twist_columns(kinematics, E[None], X[None])[0][rows]
        chosen = independent_rows(twists.T)[:n] if twists.shape[1] else none
        C = twists[:, chosen]
        if compute_rank(C).value == n == compute_rank(np.hstack([J, C])).value:
            return cls(kinematics, rows, columns, chosen, none, none)
        pose = np.array(mechanism.indices(mechanism.operational), dtype=int)
        T = -np.linalg.pinv(J) @ block[:, pose]
        if float(np.max(np.abs(J @ T + block[:, pose]))) < 1e-6 and compute_rank(T).value == len(pose):
            joints: list[int] = []
            for k in range(n):
                if len(joints) < len(pose) and compute_rank(T[[*joints, k]], 1e-6).value == len(joints) + 1:
                    joints.append(k)
            return cls(kinematics, rows, columns, none, pose, np.array(joints, dtype=int))
        return cls(kinematics, rows[independent_rows(J)], columns, none, none, none)

    def __call__(self, X: Array) -> Array:
        """Give the signs at n points.

        Args:
            X: Values of all variables [m or rad], shape (n, n_variables).

        Returns:
            Signs, shape (n,), those of the posture (`chart_signs`); 0 where the block has no determinant.
        """
        (E,) = self.kinematics.functions.scaled_jacobian.batch(X)
        J = E[:, self.rows][:, :, self.columns]
        used = self.columns
        if self.pose.size:
            used = np.concatenate([self.columns[self.joints], self.pose])
            T = -np.linalg.pinv(J) @ E[:, self.rows][:, :, self.pose]
            J = T[:, self.joints]
        elif self.platform.size:
            J = twist_columns(self.kinematics, E, X)[:, self.rows][:, :, self.platform].transpose(0, 2, 1) @ J
        if J.shape[1] != J.shape[2]:
            return np.zeros(len(X))
        names = [self.kinematics.mechanism.names[k] for k in used]
        return np.asarray(chart_signs(self.kinematics, X, names) * np.linalg.slogdet(J)[0], dtype=float)


_PARALLEL: WeakKeyDictionary[Kinematics, ParallelOrientation] = WeakKeyDictionary()
_CHOICES: WeakKeyDictionary[Kinematics, dict[object, LegOrientation]] = WeakKeyDictionary()
