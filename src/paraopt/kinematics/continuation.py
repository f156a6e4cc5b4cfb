"""Continuation: follow a path of imposed values on one branch, and stop with the reason where it ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.corrector import BranchPoint, Corrector
from paraopt.kinematics.followed import BranchSingularity, Followed, StopReason
from paraopt.kinematics.free_motion import FreeMotion, describe_motion
from paraopt.kinematics.imposed_path import ImposedPath, read_path
from paraopt.kinematics.model import Kinematics

Array = NDArray[np.float64]
PathLike = Callable[[float], Mapping[str, float] | ArrayLike] | Mapping[str, ArrayLike]


@dataclass(frozen=True)
class FollowOptions:
    """Choose how carefully a branch is followed.

    Attributes:
        first_step: First step, as a part of the path [1].
        largest_step: Largest step, as a part of the path [1]; the path is looked at four times in each.
        smallest_step: Step below which the search gives up, as a part of the path [1].
        contraction: Largest relative change of the solved columns in the region of a step [1]; below 1, and the smaller
            the more careful.
        prediction: Largest first Newton correction, as a part of the length of the step [1].
        turn: Largest angle between the tangents at both ends of a step [rad].
        agreement: Largest distance between the middles of a step solved from its two ends, as a part of its length [1].
        singular: Smallest singular value of the solved columns at which the place counts as singular [1].
        ranges: Whether the ranges of the joints end the branch.
        range_tolerance: Excess over a range that is forgiven, in characteristic lengths or radians.
        start_tolerance: Largest distance of the start from the path's start, in characteristic lengths or radians.
        steps: Bound on the number of steps tried.

    Raises:
        DefinitionError: A number is not finite and above zero, or a bound that must be below one is not.
    """

    first_step: float = 0.02
    largest_step: float = 0.1
    smallest_step: float = 1e-14
    contraction: float = 0.5
    prediction: float = 0.25
    turn: float = 0.5
    agreement: float = 0.01
    singular: float = 1e-5
    ranges: bool = True
    range_tolerance: float = 1e-9
    start_tolerance: float = 1e-6
    steps: int = 100000

    def __post_init__(self) -> None:
        for name in ("first_step", "largest_step", "smallest_step", "contraction", "prediction", "turn", "agreement",
                     "singular", "range_tolerance", "start_tolerance", "steps"):  # fmt: skip
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and np.isfinite(value) and value > 0):
                raise DefinitionError(f"{name} of the continuation is {value!r}; it must be finite and above 0")
        for name in ("contraction", "prediction"):
            if not getattr(self, name) < 1:
                raise DefinitionError(f"{name} of the continuation is {getattr(self, name)!r}; it must be below 1")


def follow(
    kinematics: Kinematics,
    start: Configuration,
    path: PathLike,
    names: Sequence[str] | None = None,
    options: FollowOptions | None = None,
) -> Followed:
    """Follow a path of imposed values on the branch of a configuration, and never leave that branch.

    Let y be the imposed variables, A the columns of E that are solved for, `A0` those at the last configuration X0, and
    B the ball around X0 of radius `R = 2 eta`, where eta is the longest first-order motion `|A0^-1 E_y (y(s) - y0)|` in
    the step. If `q = max |A0^-1 (A - A0)| <= 1/2` in B, then for every y of the step

    * at most one solution lies in B, because `F(X) - F(X')` is `A0 (I + P) (X - X')` with `|P| <= q < 1`;
    * one lies there, because `X - A0^-1 F(X, y)` maps B into itself and contracts by q (Newton-Kantorovich);
    * the determinant of A keeps its sign in B, because `det(I + P) > 0`.

    The solution in B is therefore the continuation of X0 along the path, and a fold, behind which the other assembly
    mode waits, is never inside B: near one the steps become a fixed part of the way that is left. A step is accepted if
    q is small enough at the places of B where A changes most (both ways along the weakest singular direction, along the
    step and as far again beyond, and at the middle and the end), the path stays within eta at its quarters, the first
    Newton correction is small beside the step and the corrections contract by 0.5 at least, the determinant keeps its
    sign, the tangent does not turn too far, and the middle of the step solved from both ends is the same. q is measured
    at these places and not bounded over B: this is a test that errs on the safe side, not a proof by intervals, and a
    path that leaves and comes back between its quarters is not seen; lower `largest_step` for such a path.

    Args:
        kinematics: The mechanism's functions.
        start: A configuration on the branch.
        path: From s in [0, 1] to imposed values, by name or, with `names`, as an array of shape (n_imposed,); or
            waypoints by name, each a number or an array of shape (n_waypoints,), joined by straight lines of equal
            shares of s. The start's own values are put before the waypoints unless they are the first ones. Angles are
            not taken modulo a turn. Any variables may be imposed: the operational ones make it the inverse model, the
            drives the forward model.
        names: Names for a path that gives arrays.
        options: How carefully.

    Returns:
        The branch up to the end of the path or to where it stopped, with the reason.

    Raises:
        UnknownNameError: A name does not exist.
        DefinitionError: The path is malformed, or does not begin at the start.

    Source: Lahouar, II.3.
    """
    options = options or FollowOptions()
    imposed = read_path(kinematics.mechanism, start, path, names)
    return _Walk(kinematics, start, imposed, options).run()


@dataclass(frozen=True, eq=False)
class _Trial:
    """Hold a step that was tried; `refused` names the test that it failed."""

    refused: str
    change: float
    point: BranchPoint | None = None
    middle: Array | None = None
    residual: float = 0.0


class _Walk:
    """Walk along one path."""

    def __init__(self, kinematics: Kinematics, start: Configuration, path: ImposedPath, options: FollowOptions) -> None:
        self.kinematics, self.path, self.options = kinematics, path, options
        self.corrector = Corrector(kinematics, path.names, start)
        self.scale = self.corrector.scale
        self.start = start
        variables = kinematics.mechanism.variables
        self.low = np.array([v.range[0] for v in variables]) / self.scale - options.range_tolerance
        self.high = np.array([v.range[1] for v in variables]) / self.scale + options.range_tolerance
        self.rejections: dict[str, int] = {}

    def run(self) -> Followed:
        options = self.options
        first = self.path(0.0) / self.scale[self.corrector.imposed]
        z0 = self.start.X / self.scale
        if not np.all(np.isfinite(first)):
            return self._conclude([0.0], [self.corrector.point(z0)], [0.0], 0.0, StopReason.NOT_FINITE, "")
        gap = np.abs(first - z0[self.corrector.imposed])
        if np.max(gap, initial=0.0) > options.start_tolerance:
            worst = self.path.names[int(np.argmax(gap))]
            raise DefinitionError(
                f"path begins with {worst!r} = {self.path(0.0)[int(np.argmax(gap))]:.9g}, but the start has "
                f"{self.start[worst]:.9g}; begin the path at the start"
            )
        z0 = self.corrector.correct(z0, first).z
        places, points, changes = [0.0], [self.corrector.point(z0)], [0.0]
        residual = self.start.residual
        step, tried, refused, limit = options.first_step, 0, "", self._outside(z0)
        reason = StopReason.RANGE if options.ranges and limit else None
        while reason is None:
            s, point = places[-1], points[-1]
            tried += 1
            if s >= 1.0:
                reason = StopReason.ARRIVED
            elif point.margin <= options.singular:
                reason = StopReason.SINGULAR
            elif step < options.smallest_step or tried > options.steps:
                near = self._extrapolate(places, points)
                closing = near is not None and near[0] - s <= 10.0 * max(options.smallest_step, 1e-15 * s)
                reason = StopReason.SINGULAR if closing else StopReason.STEP
                if reason is StopReason.STEP and self.corrector.dependent:
                    reason = StopReason.CONTRADICTION
                reason = StopReason.NOT_FINITE if refused == "the path is not finite" else reason
            else:
                target = self._land(s, step)
                trial = self._try(point, s, target)
                if trial.refused or trial.point is None:
                    refused = trial.refused
                    self.rejections[refused] = self.rejections.get(refused, 0) + 1
                    share = 0.8 * options.contraction / max(trial.change, 1e-300)
                    step = (target - s) * float(np.clip(share, 0.1, 0.5))
                    continue
                if options.ranges and (limit := self._outside(trial.point.z) or self._outside(trial.middle)):
                    target, arrival, limit = self._find_limit(point, s, target)
                    reason = StopReason.RANGE
                else:
                    arrival = trial.point
                if target > s:
                    places.append(target)
                    points.append(arrival)
                    changes.append(trial.change)
                    residual = max(residual, trial.residual)
                ease = options.contraction / max(trial.change, 1e-3 * options.contraction)
                step = min((target - s) * float(np.clip(0.8 * ease, 0.5, 2.0)), options.largest_step)
        return self._conclude(places, points, changes, residual, reason, limit)

    def _land(self, s: float, step: float) -> float:
        """Give the end of a step: on the next corner of the path where that is near."""
        corner = self.path.next_corner(s)
        return corner if s + 1.2 * step >= corner else s + step

    # -- one step --------------------------------------------------------------------------------------------------

    def _try(self, point: BranchPoint, s: float, target: float) -> _Trial:
        """Predict, correct and judge one step."""
        corrector, options = self.corrector, self.options
        shares = np.array([0.25, 0.5, 0.75, 1.0])
        values = np.array([self.path(s + (target - s) * share) for share in shares]) / self.scale[corrector.imposed]
        if not np.all(np.isfinite(values)):
            return _Trial("the path is not finite", np.inf)
        origin = point.z[corrector.imposed]
        motions = np.array([corrector.motion(point, value - origin) for value in values])
        eta = float(np.max(np.linalg.norm(motions, axis=1)))
        if eta == 0.0:  # the path rests
            return _Trial("", 0.0, point, point.z)
        if not np.isfinite(eta) or eta > 1.0:
            return _Trial("the step is long", np.inf)
        # the region first: where A changes much in it, there is no sense in solving
        ahead = motions[-1] * (2.0 * eta / max(float(np.linalg.norm(motions[-1])), 1e-300))
        sideways = 2.0 * eta * corrector.weakest(point)
        region = point.z + np.array([ahead, -sideways, sideways])
        change = corrector.relative_change(point, region)
        if not change <= options.contraction:
            return _Trial("the region does not contract", change)
        end = corrector.correct(point.z + motions[-1], values[-1])
        middle = corrector.correct(point.z + motions[1], values[1])
        refused = ""
        for correction, motion in ((end, motions[-1]), (middle, motions[1])):
            length = max(float(np.linalg.norm(motion)), 0.1 * eta)
            if not correction.converged:
                refused = refused or "the corrector does not converge"
            elif correction.first > options.prediction * length:
                refused = refused or "the prediction is poor"
            elif correction.rate > 0.5:
                refused = refused or "the corrector does not contract"
        if refused:
            return _Trial(refused, change)
        change = max(change, corrector.relative_change(point, np.array([end.z, middle.z])))
        arrival = corrector.point(end.z)
        refused = self._compare(point, arrival, values, middle.z, eta) if change <= options.contraction else (
            "the region does not contract"
        )  # fmt: skip
        return _Trial(refused, change, arrival, middle.z, max(end.residual, middle.residual))

    def _compare(self, point: BranchPoint, arrival: BranchPoint, values: Array, middle: Array, eta: float) -> str:
        """Compare both ends of a step; name the test that fails, or nothing."""
        corrector, options = self.corrector, self.options
        if not corrector.determinant_ratio(point, arrival) > 0:
            return "the determinant changes its sign"
        leap = values[-1] - point.z[corrector.imposed]
        before, after = corrector.motion(point, leap), corrector.motion(arrival, leap)
        lengths = float(np.linalg.norm(before) * np.linalg.norm(after))
        if lengths > 0 and before @ after < np.cos(options.turn) * lengths:
            return "the tangent turns too far"
        back = corrector.correct(arrival.z + corrector.motion(arrival, values[1] - values[-1]), values[1])
        if not back.converged or np.linalg.norm(back.z - middle) > options.agreement * eta + 1e-11:
            return "the middle differs when it is solved from both ends"
        return ""

    # -- ends of the branch ----------------------------------------------------------------------------------------

    def _outside(self, z: Array | None) -> str:
        """Name a variable outside its range; the one that is farthest."""
        if z is None:
            return ""
        excess = np.maximum(self.low - z, z - self.high)
        worst = int(np.argmax(excess))
        return self.kinematics.mechanism.names[worst] if excess[worst] > 0 else ""

    def _find_limit(self, point: BranchPoint, s: float, target: float) -> tuple[float, BranchPoint, str]:
        """Find where the branch first leaves the ranges in a step that was accepted as a whole."""

        def reach(place: float) -> Array:
            value = self.path(place) / self.scale[self.corrector.imposed]
            step = self.corrector.motion(point, value - point.z[self.corrector.imposed])
            return self.corrector.correct(point.z + step, value).z

        def excess(place: float) -> float:
            z = reach(place)
            return float(np.max(np.maximum(self.low - z, z - self.high)))

        if excess(target) <= 0:  # it goes out and comes back: the middle is outside
            target = 0.5 * (s + target)
        name = self._outside(reach(target))
        place = s
        if excess(s) < 0:
            place = float(scipy.optimize.brentq(excess, s, target, xtol=1e-15, rtol=1e-14))
            name = self._outside(reach(min(place + 1e-9 * (target - s), target))) or name
        return place, self.corrector.point(reach(place)), name

    def _extrapolate(self, places: list[float], points: list[BranchPoint]) -> tuple[float, bool] | None:
        """Estimate where the margin is zero, and whether it goes there like a square root; None if it does not fall."""
        s = np.array(places[-3:])
        margin = np.array([p.margin for p in points[-3:]])
        if len(s) < 2 or not margin[-1] < margin[-2]:
            return (s[-1], False) if margin[-1] <= self.options.singular else None

        def zero(power: int, i: int, j: int) -> float:
            a, b = margin[i] ** power, margin[j] ** power
            return float(s[j] + b * (s[j] - s[i]) / max(a - b, 1e-300))

        fold = True
        if len(s) == 3 and margin[-2] < margin[-3]:  # the estimate that moves less fits better
            fold = abs(zero(2, 0, 1) - zero(2, 1, 2)) <= abs(zero(1, 0, 1) - zero(1, 1, 2))
        return zero(2 if fold else 1, -2, -1), fold

    def _conclude(
        self,
        places: list[float],
        points: list[BranchPoint],
        changes: list[float],
        residual: float,
        reason: StopReason,
        limit: str,
    ) -> Followed:
        s, point, mechanism = places[-1], points[-1], self.kinematics.mechanism
        X = np.array([p.z for p in points]) * self.scale
        singularity = None
        detail = f"{reason.value}, s = {s:.9g}"
        if reason is StopReason.SINGULAR:
            place, fold = self._extrapolate(places, points) or (s, False)
            singularity = BranchSingularity(
                self._kind(point), min(place, 1.0), max(place - s, 0.0), point.margin, self._free_motion(point), fold
            )
            detail = (
                f"singular ({singularity.kind}{', fold' if fold else ''}) at s = {place:.9g}, smallest singular value "
                f"{point.margin:.3g}; free: {', '.join(singularity.motion.moving[:4])}"
            )
        elif reason is StopReason.RANGE:
            variable = mechanism.variables[mechanism.index(limit)]
            value = float(X[-1, mechanism.index(limit)])
            low, high = variable.range
            detail = (
                f"joint range: {limit!r} is {value:.6g} {variable.unit}, its range ({low:.6g}, {high:.6g}) "
                f"{variable.unit}, at s = {s:.9g}"
            )
        elif reason is StopReason.CONTRADICTION:
            names = ", ".join(self.path.names)
            detail += f"; the closures force {self.corrector.dependent} relation(s) upon {names}; impose fewer"
        elif reason is StopReason.STEP:
            most = max(self.rejections, key=lambda k: self.rejections[k], default="")
            detail += f"; most steps were refused because {most}; smallest singular value {point.margin:.3g}"
        return Followed(
            mechanism=mechanism,
            names=self.path.names,
            s=np.array(places),
            X=X,
            margins=np.array([p.margin for p in points]),
            changes=np.array(changes),
            residual=max(residual, float(np.max(self.kinematics.scaled_residual(X)))),
            reason=reason,
            detail=detail,
            singularity=singularity,
            limit=limit if reason is StopReason.RANGE else "",
            rejections=dict(self.rejections),
            undetermined=self.corrector.undetermined,
        )

    def _kind(self, point: BranchPoint) -> str:
        mechanism, names = self.kinematics.mechanism, set(self.path.names)
        if self.corrector.constraint_margin(point) <= 10.0 * self.options.singular:
            return "constraint"
        if names == set(mechanism.active):
            return "parallel"
        return "serial" if names == set(mechanism.operational) else "of the imposed variables"

    def _free_motion(self, point: BranchPoint) -> FreeMotion:
        """Describe the weakest direction as velocities and as a twist of the platform."""
        return describe_motion(self.kinematics, point.z * self.scale, self.corrector.weakest(point))
