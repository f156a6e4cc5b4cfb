"""Singularities at one configuration: which kind, how far, what becomes free, and which way leads out.

All distances are singular values of scaled matrices: lengths are divided by the characteristic length. With the columns
of V an orthonormal basis of the motions that the closures allow (`MotionSpace`), they are

* parallel: of the active rows of V; at zero some motion needs no drive;
* serial: of the operational rows of V; at zero some drive moves while the platform rests;
* serial of one leg: of the leg's block of [M N];
* of the constraints: of E itself; at zero the closures allow more motions than elsewhere.

Where the constraints lose rank, distances of the other kinds jump: with the drives blocked at least one of the motions
that are more is free, so that the configuration is singular for them as well, and the way out is that of the
constraints.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.escape import find_agreeing, find_fastest, find_fastest_on_branches
from paraopt.kinematics.free_motion import FreeMotion, describe_motion
from paraopt.kinematics.legs import Leg
from paraopt.kinematics.margins import Determinants
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.ranks import RANK_TOLERANCE, compute_rank, null_space
from paraopt.kinematics.samples import GeneralState, SampleOptions, find_general_state, useful_motions

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Singularity:
    """Tell how near a configuration is to one kind of singularity.

    Attributes:
        kind: "parallel", "serial" or "constraint".
        leg: Name of the leg that is serially singular; empty where the whole mechanism is meant.
        distance: Scaled singular value [1], with the sign of the determinant where the matrix is square; it is zero at
            the singularity and changes its sign across.
        motion: What becomes free at zero: with the drives at rest (parallel), with the platform at rest (serial), or
            a motion that the closures forbid elsewhere (constraint). At a singularity from which an escape leads, it is
            the motion that is lost along the escape.
        escape: Motion along which |distance| grows fastest. None where it grows along none at first order, as at a
            best place and at crossings where only higher orders decide; for other kinds than "constraint" also where
            the constraints lose rank.
        rate: Growth of |distance| along it, per characteristic length or radian of scaled motion; zero without escape.
        is_singular: Whether |distance| is below the tolerance.
    """

    kind: str
    leg: str
    distance: float
    motion: FreeMotion
    escape: FreeMotion | None
    rate: float
    is_singular: bool


@dataclass(frozen=True, eq=False)
class SingularityReport:
    """Hold the distances to all kinds of singularities at one configuration.

    Attributes:
        mechanism_name: Name of the mechanism.
        parallel: Distance at which the platform is no longer held by the drives.
        serial: Distance at which a drive moves nothing.
        legs: Serial distance of each leg, in the order of `Kinematics.legs`.
        constraint: Distance at which the closures themselves lose rank.
        architectural: Kinds that are singular at every configuration around: a fault of the dimensions, or of the
            choice of variables, not of the pose.
        unheld: How many motions the drives hold nowhere, because they are fewer than the freedoms: an under-actuated
            machine can be regular, yet its platform is loose; the parallel distance is then that of what is held.
        tolerance: Distance below which a configuration counts as singular [1].
    """

    mechanism_name: str
    parallel: Singularity
    serial: Singularity
    legs: tuple[Singularity, ...]
    constraint: Singularity
    architectural: tuple[str, ...]
    unheld: int
    tolerance: float

    @property
    def singular_legs(self) -> tuple[str, ...]:
        """Name the legs that are serially singular."""
        return tuple(leg.leg for leg in self.legs if leg.is_singular)

    @property
    def kind(self) -> str:
        """Say in words which kinds apply here."""
        words: list[str] = []
        if self.parallel.is_singular:
            always = "parallel" in self.architectural
            words.append("architectural (parallel at every pose)" if always else "parallel")
        if self.serial.is_singular or self.singular_legs:
            drives = self.singular_legs or self.serial.motion.moving[:1]
            where = " at every pose" if "serial" in self.architectural else ""
            words.append(f"serial{where} ({', '.join(repr(d) for d in drives)})")
        if self.constraint.is_singular:
            words.append("of the constraints")
        return " and ".join(words) or "regular"

    def __str__(self) -> str:
        loose = (
            f"; under-actuated: {self.unheld} motion{'s' * (self.unheld > 1)} more than drives" if self.unheld else ""
        )
        lines = [f"{self.mechanism_name}: {self.kind}{loose}"]
        for s in (self.parallel, self.serial, *self.legs, self.constraint):
            name = f"{s.kind} {s.leg!r}" if s.leg else s.kind
            out = f", grows by {s.rate:.3g} along its escape" if s.escape else ", stationary"
            lines.append(f"  {name:24} {s.distance:+.6f}{out}; free: {', '.join(s.motion.moving[:4])}")
        return "\n".join(lines)


def report_singularities(
    kinematics: Kinematics,
    configuration: Configuration,
    tolerance: float = 1e-6,
    determinants: Determinants | None = None,
    samples: SampleOptions | None = None,
) -> SingularityReport:
    """Measure the distance to every kind of singularity, with the free motion and the way out.

    Args:
        kinematics: The mechanism's functions.
        configuration: Where to look.
        tolerance: Distance below which a configuration counts as singular [1].
        determinants: Choice of rows and columns for the signs of parallel and serial distances; chosen here when None.
            Signs at two configurations compare when both used the same choice.
        samples: Configurations around it that stand for the general case.

    Returns:
        Signed, scaled distances, free motions and escapes.

    Raises:
        DefinitionError: The tolerance is not a finite number above 0.

    Source: GosselinAngeles1990; Lahouar, II.26; Lahouar, II.27; Chablat1998.
    """
    if not (np.isfinite(tolerance) and tolerance > 0):
        raise DefinitionError(f"tolerance of singularities is {tolerance!r}; it must be finite and above 0")
    place = _Place(kinematics, configuration, find_general_state(kinematics, configuration, samples), tolerance)
    chosen = determinants or Determinants.at(kinematics, configuration)
    signs = [float(s[0]) for s in chosen.signs(configuration.X)]
    mechanism = kinematics.mechanism
    parallel, lost_p = place.judge_motions("parallel", mechanism.active, signs[0])
    serial, lost_s = place.judge_motions("serial", mechanism.operational, signs[1])
    return SingularityReport(
        mechanism_name=mechanism.name,
        parallel=parallel,
        serial=serial,
        legs=tuple(place.judge_leg(leg) for leg in kinematics.legs),
        constraint=place.judge_constraints(),
        architectural=tuple(k for k, lost in (("parallel", lost_p), ("serial", lost_s)) if lost),
        unheld=max(place.motions.shape[1] - place.lost - len(mechanism.active), 0),
        tolerance=tolerance,
    )


class _Place:
    """Judge one configuration; matrices are scaled."""

    def __init__(
        self, kinematics: Kinematics, configuration: Configuration, general: GeneralState, tolerance: float
    ) -> None:
        self.kinematics, self.X, self.general, self.tolerance = kinematics, configuration.X, general, tolerance
        (self.samples,) = kinematics.functions.scaled_jacobian.batch(general.X)
        self.E = self.samples[0]
        self.motions = useful_motions(kinematics, self.E, general.internal)
        self.all_motions = null_space(self.E)
        # more motions here than in general: what the closures have lost
        self.lost = self.all_motions.shape[1] - (self.E.shape[1] - general.ranks["E"])

    def judge_motions(self, kind: str, names: Sequence[str], sign: float) -> tuple[Singularity, bool]:
        """Judge the rows of the basis of motions of some variables, and whether they are singular at every sample."""
        rows = self.kinematics.mechanism.indices(names)
        bases = [useful_motions(self.kinematics, E, self.general.internal) for E in self.samples]
        count = min(len(rows), *(V.shape[1] for V in bases))  # as many as can be independent
        if not self.motions.shape[1] or not count:
            return self._rest(kind), False
        always = count > max(_absolute_rank(V[rows]) for V in bases if V.shape[1] + self.lost == self.motions.shape[1])
        matrix, wanted = self.motions[rows], count + self.lost  # as many must be held as there are more
        if wanted > min(matrix.shape):
            free = self.motions @ np.linalg.svd(matrix, full_matrices=True)[2][-1]
            return self._conclude(kind, "", 0.0, free), always
        inverse = np.linalg.pinv(self.E, rcond=RANK_TOLERANCE)

        def weigh(left: Array) -> Array:
            # d(u^T V w) = weights . F''[., V w], because E dV = -dE V keeps V among the motions
            picked = np.zeros(len(self.X))
            picked[rows] = left
            weights: Array = -inverse.T @ picked
            return weights

        return self._judge(kind, "", matrix, wanted, self.motions, weigh, sign), always

    def judge_leg(self, leg: Leg) -> Singularity:
        """Judge the block of one leg."""
        mechanism = self.kinematics.mechanism
        rows, columns = np.array(leg.rows), np.array(mechanism.indices(leg.variables))
        blocks = self.samples[:, rows][:, :, columns]
        count = max(compute_rank(b, whole=E).value for b, E in zip(blocks, self.samples, strict=True))
        sign = float(np.sign(np.linalg.det(blocks[0]))) if blocks.shape[1] == blocks.shape[2] else 1.0
        to_whole = np.eye(len(self.X))[:, columns]

        def weigh(left: Array) -> Array:
            weights = np.zeros(len(self.E))
            weights[rows] = left
            return weights

        return self._judge("serial", leg.name, blocks[0], count, to_whole, weigh, sign)

    def judge_constraints(self) -> Singularity:
        """Judge E itself."""
        count = self.general.ranks["E"]
        if count == 0:
            return self._rest("constraint")
        if not self.lost:
            return self._judge("constraint", "", self.E, count, np.eye(len(self.X)), lambda left: left, 1.0)
        V = self.all_motions
        unreached = null_space(self.E.T)
        terms = np.array([V.T @ self._hessian(u) @ V for u in unreached.T]).reshape(unreached.shape[1], -1)
        # of what E does not reach, the part that second-order motions do: as a rule one for every rank that is lost
        _, sizes, rows = np.linalg.svd(terms, full_matrices=False)
        if self.lost > 1 or np.count_nonzero(sizes > 1e-8) != 1:
            return self._conclude("constraint", "", 0.0, V[:, 0])
        Q = (sizes[0] * rows[0]).reshape(V.shape[1], -1)
        d, rate = find_fastest_on_branches(Q)
        return self._conclude("constraint", "", 0.0, V @ _normalised(Q @ d) if rate > 0 else V[:, 0], V @ d, rate)

    def _judge(
        self, kind: str, leg: str, matrix: Array, place: int, to_whole: Array, weigh: Callable[[Array], Array],
        sign: float,
    ) -> Singularity:  # fmt: skip
        """Judge one singular value of a matrix.

        Args:
            kind: Kind of singularity.
            leg: Name of the leg.
            matrix: The matrix, shape (p, q).
            place: Which singular value.
            to_whole: Motions of the whole that the columns stand for, shape (n_variables, q).
            weigh: Gives the weights of the equations with which `u^T dA w = weights . F''[., to_whole w]`.
            sign: Sign of the distance; nan or zero count as plus.
        """
        if place == 0:
            return self._rest(kind, leg)
        agreeing = find_agreeing(matrix, place, self.tolerance)
        value = float(np.linalg.svd(matrix, compute_uv=False)[place - 1])
        signed = value * (sign if np.isfinite(sign) and sign != 0 else 1.0)
        moved = to_whole @ agreeing.right
        motion = to_whole @ np.linalg.svd(matrix, full_matrices=True)[2][place - 1]
        if self.lost:
            return self._conclude(kind, leg, signed, motion)
        P = np.array([self.all_motions.T @ self._hessian(weigh(u)) @ moved for u in agreeing.left.T])
        d, rate, w = find_fastest(P.transpose(1, 0, 2), agreeing)
        if agreeing.is_zero and rate > 1e-8:
            motion = moved @ w
        return self._conclude(kind, leg, signed, motion, self.all_motions @ d, rate)

    def _rest(self, kind: str, leg: str = "") -> Singularity:
        """Conclude that nothing can be lost."""
        return self._conclude(kind, leg, 1.0, np.zeros(len(self.X)))

    def _hessian(self, weights: Array) -> Array:
        return self.kinematics.functions.closure_hessian(self.X, weights)[0]

    def _conclude(
        self, kind: str, leg: str, distance: float, motion: Array, escape: Array | None = None, rate: float = 0.0
    ) -> Singularity:
        """Turn scaled motions into what a person can read."""
        leads = escape is not None and rate > 1e-8
        way = self._describe(escape) if escape is not None and leads else None
        singular = abs(distance) < self.tolerance
        return Singularity(kind, leg, distance, self._describe(motion), way, rate if leads else 0.0, singular)

    def _describe(self, motion: Array) -> FreeMotion:
        return describe_motion(self.kinematics, self.X, motion)


def _normalised(vector: Array) -> Array:
    return vector / max(float(np.linalg.norm(vector)), 1e-300)


def _absolute_rank(rows: Array) -> int:
    """Count the singular values of rows of an orthonormal basis that are not round-off."""
    if rows.size == 0:
        return 0
    return int(np.count_nonzero(np.linalg.svd(rows, compute_uv=False) > RANK_TOLERANCE))
