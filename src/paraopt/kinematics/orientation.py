"""Signs of leg blocks that can be compared between poses, also where a block has more rows than columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from paraopt.kinematics.legs import Leg
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.platform import passive_coordinates
from paraopt.kinematics.ranks import compute_rank, independent_rows

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LegOrientation:
    """Give the sign of a leg's block J, shape (m, n), of its rows and variables.

    * Square: the sign of det J.
    * The platform moves the rows as J does: the sign of `det(C^T J)`, where C are n columns of the platform's
      coordinates in the same rows. Both span the motions that the tied points can make, so the sign does not depend on
      which rows repeat others.
    * The joints follow the pose by `T = -J^+ K` while other coordinates are held, as in the parallelograms of a Delta:
      the sign of the determinant of as many rows of T as there are operational coordinates, those of the first joints
      that are independent, drives before others.
    * Rows repeat others in another way: the sign of the determinant of as many rows as are independent.

    Rows and columns are chosen once for each mechanism, at the first pose that is asked for. Signs are comparable
    between poses as long as what was chosen stays independent; in the third case, as long as the chosen coordinates
    move the leg's end in n independent ways: always in the plane, and where the platform does not turn.

    Attributes:
        rows: Rows of the leg.
        columns: Columns of its variables.
        platform: Columns C, empty where they are not used.
        pose: Columns K of the operational coordinates, empty where T is not used.
        joints: Chosen rows of T.
    """

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    platform: NDArray[np.intp]
    pose: NDArray[np.intp]
    joints: NDArray[np.intp]

    @classmethod
    def of(cls, kinematics: Kinematics, leg: Leg, held: Sequence[str], E: Array) -> LegOrientation:
        """Choose rows and columns for one leg, or find the choice that was made before.

        Args:
            kinematics: The mechanism's functions.
            leg: The leg.
            held: Names of the coordinates that are held.
            E: Scaled Jacobian at one of its postures [1], shape (n_equations, n_variables).
        """
        known = _CHOICES.setdefault(kinematics, {})
        key = (leg.rows, leg.variables, tuple(held))
        if key not in known:
            known[key] = cls._choose(kinematics, leg, held, E)
        return known[key]

    @classmethod
    def _choose(cls, kinematics: Kinematics, leg: Leg, held: Sequence[str], E: Array) -> LegOrientation:
        mechanism = kinematics.mechanism
        rows, columns = np.array(leg.rows, dtype=int), np.array(mechanism.indices(leg.variables), dtype=int)
        block, none, n = E[rows], np.arange(0), len(columns)
        J = block[:, columns]
        if len(rows) <= n or compute_rank(J).value < n:
            return cls(rows, columns, none, none, none)
        coordinates = np.array(mechanism.indices([*mechanism.operational, *passive_coordinates(kinematics)]), dtype=int)
        coordinates = coordinates[~np.isin(coordinates, columns)]
        _, _, order = scipy.linalg.qr(block[:, coordinates], mode="economic", pivoting=True)
        chosen = np.sort(coordinates[order[:n]])
        if compute_rank(block[:, chosen]).value == n == compute_rank(np.hstack([J, block[:, chosen]])).value:
            return cls(rows, columns, chosen, none, none)
        pose = np.array(mechanism.indices(mechanism.operational), dtype=int)
        T = -np.linalg.pinv(J) @ block[:, pose]
        if float(np.max(np.abs(J @ T + block[:, pose]))) < 1e-6 and compute_rank(T).value == len(pose):
            joints: list[int] = []
            for k in range(n):
                if len(joints) < len(pose) and compute_rank(T[[*joints, k]], 1e-6).value == len(joints) + 1:
                    joints.append(k)
            return cls(rows, columns, none, pose, np.array(joints, dtype=int))
        return cls(rows[independent_rows(J)], columns, none, none, none)

    def __call__(self, E: Array) -> Array:
        """Give the signs at n points.

        Args:
            E: Scaled Jacobians [1], shape (n, n_equations, n_variables).

        Returns:
            Signs, shape (n,); 0 where the block has no determinant.
        """
        J = E[:, self.rows][:, :, self.columns]
        if self.pose.size:
            T = -np.linalg.pinv(J) @ E[:, self.rows][:, :, self.pose]
            return np.asarray(np.linalg.slogdet(T[:, self.joints])[0], dtype=float)
        if self.platform.size:
            J = E[:, self.rows][:, :, self.platform].transpose(0, 2, 1) @ J
        if J.shape[1] != J.shape[2]:
            return np.zeros(len(E))
        return np.asarray(np.linalg.slogdet(J)[0], dtype=float)


_CHOICES: WeakKeyDictionary[Kinematics, dict[object, LegOrientation]] = WeakKeyDictionary()
