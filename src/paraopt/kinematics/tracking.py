"""Velocity-level tracking: one quadratic program per step, within limits, and never into a singularity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.motion_limits import LimitRows, MotionLimits
from paraopt.kinematics.motion_place import KINDS, MotionPlace, find_frame
from paraopt.kinematics.tracked import Tracked, TrackStatus, TrackStep
from paraopt.kinematics.velocity_program import Program, check_solver
from paraopt.mechanism.joints import Range

Array = NDArray[np.float64]


class LimitsLike(Protocol):
    """Stand for the limits of a robot: bounds by name of variable."""

    @property
    def position(self) -> Mapping[str, Range]:
        """Give the lowest and highest value [m or rad]."""

    @property
    def velocity(self) -> Mapping[str, float]:
        """Give the largest speed [m/s or rad/s]."""

    @property
    def acceleration(self) -> Mapping[str, float]:
        """Give the largest acceleration [m/s^2 or rad/s^2]."""


@dataclass(frozen=True, eq=False)
class Twist:
    """Command the motion of a link in the world.

    Attributes:
        linear: Velocity of the link's origin [m/s], shape (3,), or (n, 3) for a sequence.
        angular: Angular velocity [rad/s], same shape; not commanded when None.
        link: Name of the link; the platform, which carries the last operational variable, when None.

    Raises:
        DefinitionError: A component is not a finite number, or a shape is wrong.
    """

    linear: ArrayLike
    angular: ArrayLike | None = None
    link: str | None = None

    def __post_init__(self) -> None:
        for name in ("linear", "angular"):
            given = getattr(self, name)
            if given is None:
                continue
            value = _as_finite(given, f"{name} velocity of a twist")
            if value.ndim not in (1, 2) or value.shape[-1] != 3:
                raise DefinitionError(f"{name} velocity of a twist has shape {value.shape}; it must be (3,) or (n, 3)")
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        if self.angular is not None and np.shape(self.angular) != np.shape(self.linear):
            raise DefinitionError(f"twist has shapes {np.shape(self.linear)} and {np.shape(self.angular)}")


Command = Mapping[str, float] | Twist


@dataclass(frozen=True)
class VelocityTracker:
    """Follow commanded velocities as well as limits and singularities allow.

    With the columns of V an orthonormal basis of the motions that the closures allow, the velocity of all variables is
    `Xdot = scale V c`: the loops stay closed to first order for every c, at every kind of pose. One program per step,

    `minimise |W^1/2 (J c - wanted)|^2 + proximity |c - c*|_D^2   subject to   low <= R c <= high`

    finds c, where c* is the least motion in the metric D that minimises the first term, damped near singularities of J;
    so the second term costs nothing while no bound holds, and D weighs the efforts. Rows of R are

    * each limited variable: its speed; its speed before, plus or minus acceleration times period; and towards each end
      of its range the largest speed from which its own acceleration stops it in the way d that is left, step by step,
      or `g d` where its acceleration is not limited;
    * each margin that is kept: `d margin / dt >= -g (margin - bound)`, and not below zero when under the bound, so that
      a jog leads out of a singularity and never further in.

    Here `g = min(gain, 1 / (T + 3 period))`, T being the time to brake to a stop from the speed before: what has no
    acceleration of its own must leave time for those that have. The program therefore stays feasible from step to step
    where the variables with limited accelerations move freely of each other and no margin is near; else it may not.
    After the step the loops are closed again; what the bounds mean is checked on the closed configuration (changes over
    the period), and the program is solved again with what the closing added, until they hold. Where no c keeps all
    bounds, accelerations give way by the least common part of themselves, which is told; speeds, ranges and margins
    never do.

    Attributes:
        limits: Bounds by name of variable, such as `robot.limits`; ranges of the joints always hold.
        solver: Any solver that qpsolvers finds installed.
        margins: Bounds kept from singularities [1], by kind: "parallel", "serial"; see `MotionSpace`.
        weights: Weight of each commanded variable [1], by name; 1 where absent. Where commands contradict each other,
            as those of more drives than motions may, it says whose is followed.
        effort: Weight of each variable's motion [1], by name, where the command leaves motions free; when it is given,
            active variables that are not named count 1 and all others 0. The least motion of the whole when None.
        damping: Singular value of the commanded rows of V under which the motion is damped [1]; bounds the speed near
            singularities of J, and costs nothing away from them.
        proximity: Weight that draws towards the unlimited answer where bounds hold [1].
        gain: Largest rate of approach to a margin, or to the end of a range without acceleration limit [1/s].
        buffer: Distance at which a range or margin already counts as reached, in characteristic lengths, radians or 1.
        largest_step: Largest change of a variable in one step, in characteristic lengths or radians.
        corrections: Bound on the number of programs per step.

    Raises:
        MissingBackendError: The solver is not installed; the message lists those that are.
        DefinitionError: A number is not finite or not above zero.
        UnknownNameError: A kind of margin does not exist.
    """

    limits: LimitsLike | None = None
    solver: str = "osqp"
    margins: Mapping[str, float] = field(default_factory=lambda: {"parallel": 0.02})
    weights: Mapping[str, float] = field(default_factory=dict)
    effort: Mapping[str, float] | None = None
    damping: float = 1e-3
    proximity: float = 1e-6
    gain: float = 20.0
    buffer: float = 1e-6
    largest_step: float = 0.1
    corrections: int = 6

    def __post_init__(self) -> None:
        check_solver(self.solver)
        for name in ("damping", "proximity", "gain", "buffer", "largest_step", "corrections"):
            _check_positive(getattr(self, name), f"{name} of the tracker")
        for quantity in ("margins", "weights", "effort"):
            given = getattr(self, quantity)
            if given is None:
                continue
            for name, value in given.items():
                if quantity == "margins" and name not in KINDS:
                    raise unknown_name("kind of singularity", name, KINDS)
                _check_positive(value, f"{quantity} of {name!r}")
            object.__setattr__(self, quantity, MappingProxyType(dict(given)))

    def step(
        self,
        kinematics: Kinematics,
        configuration: Configuration,
        command: Command,
        period: float,
        velocity: Mapping[str, float] | ArrayLike | None = None,
    ) -> TrackStep:
        """Take one step.

        Args:
            kinematics: The mechanism's functions.
            configuration: Where it begins.
            command: Velocities by name of variable [m/s or rad/s], operational, active or any, or the twist of a link.
            period: Duration of the step [s].
            velocity: Velocity of the step before, from which accelerations count: by name (others at rest), or of all
                variables, such as `TrackStep.velocity`; at rest when None.

        Returns:
            The step.

        Raises:
            DefinitionError: A number is not finite.
            UnknownNameError: A name does not exist.
            BackendError: The solver failed in another way than finding no answer.
        """
        stepper = _Stepper(self, kinematics, configuration, period)
        reader = stepper.read(command)
        return stepper.advance(MotionPlace(stepper.frame, configuration.X), reader, 0, stepper.read_velocity(velocity))[
            0
        ]


def track(
    kinematics: Kinematics,
    start: Configuration,
    commands: Mapping[str, ArrayLike] | Twist,
    period: float,
    tracker: VelocityTracker | None = None,
    velocity: Mapping[str, float] | ArrayLike | None = None,
    positions: bool = False,
) -> Tracked:
    """Run a sequence of steps.

    Args:
        kinematics: The mechanism's functions.
        start: Where to begin.
        commands: Velocities by name [m/s or rad/s], shape (n,) each, or a twist of shape (n, 3).
        period: Duration of a step [s].
        tracker: Options; the default ones when None.
        velocity: Velocity before the first step; at rest when None.
        positions: Whether the numbers are values to be reached at the end of each step [m or rad] instead, so that what
            a limit held back is made up for later.

    Returns:
        Configurations, velocities and verdicts of all steps.

    Raises:
        DefinitionError: A number is not finite, or shapes do not agree.
        UnknownNameError: A name does not exist.
        BackendError: The solver failed in another way than finding no answer.
    """
    stepper = _Stepper(tracker or VelocityTracker(), kinematics, start, period)
    reader = stepper.read(commands, positions)
    place, before = MotionPlace(stepper.frame, start.X), stepper.read_velocity(velocity)
    steps = []
    for k in range(len(reader.wanted)):
        done, place = stepper.advance(place, reader, k, before)
        before = done.velocity
        steps.append(done)
    if not steps:
        raise DefinitionError("commands hold no step; give at least one value for each name")
    return Tracked(
        period=period,
        X=np.array([start.X, *[s.configuration.X for s in steps]]),
        velocities=np.array([s.velocity for s in steps]),
        residuals=np.array([s.configuration.residual for s in steps]),
        errors=np.array([s.error for s in steps]),
        margins={kind: np.array([s.margins[kind] for s in steps]) for kind in steps[0].margins},
        relaxations=np.array([s.relaxation for s in steps]),
        statuses=tuple(s.status for s in steps),
        limited_by=tuple(s.limited_by for s in steps),
        end=steps[-1],
    )


@dataclass(frozen=True, eq=False)
class _Reader:
    """Hold commands as scaled rows: variables by index, or the twist of a link by its place."""

    index: NDArray[np.intp]
    link: int
    wanted: Array
    root: Array
    positions: bool


class _Stepper:
    """Step one mechanism with one period."""

    def __init__(self, tracker: VelocityTracker, kinematics: Kinematics, start: Configuration, period: float) -> None:
        _check_positive(period, "period of a step")
        self.tracker, self.kinematics, self.period = tracker, kinematics, float(period)
        self.frame = find_frame(kinematics, start)
        self.scale = self.frame.scale
        self.limits = MotionLimits.read(kinematics.mechanism, self.scale, tracker.limits, self.period, tracker.gain)
        # rows at their bounds in the program before: tried first, and never taken without a check
        self.held = self.held_relaxed = np.arange(0)
        names = kinematics.mechanism.names
        self.effort: Array | None = None
        for name in [*tracker.weights, *(tracker.effort or {})]:
            if name not in names:
                raise unknown_name("variable in the weights", name, names)
        if tracker.effort is not None:
            self.effort = np.array([
                tracker.effort.get(n, 1.0 if n in kinematics.mechanism.active else 0.0) for n in names
            ])  # fmt: skip

    def read(self, command: Any, positions: bool = False) -> _Reader:
        """Check commands and bring them to scaled rows, one for each step."""
        mechanism = self.kinematics.mechanism
        if isinstance(command, Twist):
            if positions:
                raise DefinitionError("a twist has no positions; command values by name")
            links = [link.name for link in mechanism.links]
            name = mechanism.variables[-1].link if command.link is None else command.link
            if name not in links:
                raise unknown_name("link of a twist", name, links)
            wanted = np.atleast_2d(command.linear) / mechanism.length
            if command.angular is not None:
                wanted = np.hstack([wanted, np.atleast_2d(command.angular)])
            return _Reader(np.arange(0), links.index(name), wanted, np.ones(wanted.shape[1]), False)
        if not isinstance(command, Mapping):
            raise DefinitionError(f"command is {command!r}; it must be velocities by name, or a Twist")
        index = np.array(mechanism.indices(command), dtype=np.intp)
        columns = [np.atleast_1d(_as_finite(value, f"command of {name!r}")) for name, value in command.items()]
        shapes = sorted({column.shape for column in columns})
        if len(shapes) != 1 or len(shapes[0]) != 1:
            raise DefinitionError(f"commands have shapes {shapes}; each name needs as many numbers as the others")
        root = np.sqrt([self.tracker.weights.get(name, 1.0) for name in command])
        return _Reader(index, -1, np.array(columns).T / self.scale[index], root, positions)

    def read_velocity(self, velocity: Mapping[str, float] | ArrayLike | None) -> Array:
        """Read the velocity of all variables before a step [m/s or rad/s]."""
        mechanism = self.kinematics.mechanism
        if velocity is None:
            return np.zeros(len(mechanism.names))
        if isinstance(velocity, Mapping):
            vector = np.zeros(len(mechanism.names))
            vector[mechanism.indices(velocity)] = [_as_finite(v, f"velocity of {n!r}") for n, v in velocity.items()]
            return vector
        vector = _as_finite(velocity, "velocity before the step")
        if vector.shape != (len(mechanism.names),):
            raise DefinitionError(f"velocity before the step has shape {vector.shape}; it must have one per variable")
        return vector

    # -- one step --------------------------------------------------------------------------------------------------

    def advance(self, place: MotionPlace, reader: _Reader, k: int, before: Array) -> tuple[TrackStep, MotionPlace]:
        """Take step k of the commands from a place.

        Returns:
            The step, and the place where it ends.
        """
        tracker, h, z = self.tracker, self.period, place.X / self.scale
        J, wanted = self._rows_of_command(place, reader), reader.wanted[k]
        if reader.positions:
            wanted = (wanted - z[reader.index]) / h
        rows = self.limits.rows(place, before / self.scale, tracker.margins, tracker.buffer)
        added, added_wanted = np.zeros(len(rows.low)), np.zeros(len(wanted))
        for _ in range(tracker.corrections):
            program, guess = self._build(place, reader, J, wanted - added_wanted, rows.shifted(added))
            c, relaxed = self._solve(program, guess, rows, added)
            after, shortened = self._move(place, c)
            realised = rows.realise(place, after, h)
            if shortened:
                break
            excess = rows.excess(realised, hard_only=relaxed)
            drift = realised - rows.R @ c
            drift_wanted = np.zeros(len(wanted))
            if reader.link < 0:
                drift_wanted = (after.X - place.X)[reader.index] / self.scale[reader.index] / h - J @ c
                if np.linalg.norm(drift_wanted) > 0.1 * np.linalg.norm(wanted):  # not what a correction is for
                    drift_wanted = added_wanted
            settled = np.max(np.abs(drift_wanted - added_wanted), initial=0.0) <= 1e-6 * float(np.linalg.norm(wanted))
            if excess <= 0.0 and settled:
                break
            added, added_wanted = drift, drift_wanted
        names: tuple[str, ...] = ()
        if relaxed:
            names = rows.gave_way(realised)
        elif self.held.size:
            names = rows.names(np.abs(self.held) - 1, realised)
        # resting keeps speeds, ranges and margins: what is left out of the step costs acceleration alone
        share = 1.0
        while rows.excess(realised, hard_only=relaxed or shortened or share < 1.0) > 0.0 and share > 0.0:
            share = 0.5 * share if share > 1e-12 else 0.0
            after, _ = self._move(place, share * c)
            realised = rows.realise(place, after, h)
            names = rows.names(rows.near(realised), realised)
        if shortened:
            names = (*names, "length of the step")
        if shortened or share < 1.0:
            relaxed = rows.excess(realised) > 0.0
        velocity = (after.X - place.X) / h
        status = TrackStatus.RELAXED if relaxed else TrackStatus.LIMITED if names else TrackStatus.OK
        configuration = Configuration(self.kinematics.mechanism, after.X, after.residual)
        step = TrackStep(
            configuration=configuration,
            velocity=velocity,
            status=status,
            limited_by=names,
            error=float(np.linalg.norm(J @ c + added_wanted - wanted)),
            margins={kind: after.margin(kind) for kind in tracker.margins},
            relaxation=rows.relaxation(realised) if relaxed else 0.0,
        )
        return step, after

    def _rows_of_command(self, place: MotionPlace, reader: _Reader) -> Array:
        """Give the commanded velocities as rows on c."""
        if reader.link < 0:
            return place.V[reader.index]
        derivative = self.kinematics.pose_velocity(place.X, (self.scale[:, None] * place.V)[None])[0, :, reader.link]
        linear = derivative[:, :, 3].T / self.kinematics.mechanism.length
        if reader.wanted.shape[1] == 3:
            return linear
        R = self.kinematics.poses(place.X)[0, reader.link, :3, :3]
        spin = derivative[:, :, :3] @ R.T
        return np.vstack([linear, spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]])

    def _build(
        self, place: MotionPlace, reader: _Reader, J: Array, wanted: Array, rows: LimitRows
    ) -> tuple[Program, Array]:
        """State the program, and give its minimiser without bounds."""
        A, b = reader.root[:, None] * J, reader.root * wanted
        m = A.shape[1]
        P = A.T @ A
        if self.effort is None:
            guess = least_motion(A, b, self.tracker.damping)
            P[np.diag_indices(m)] += self.tracker.proximity
        else:
            D = 1e-3 * np.eye(m) + place.V.T @ (self.effort[:, None] * place.V)
            inverse = np.linalg.inv(np.linalg.cholesky(D)).T  # c = inverse @ y with |y|^2 = c^T D c
            guess = inverse @ least_motion(A @ inverse, b, self.tracker.damping)
            P += self.tracker.proximity * D
        return Program(P, P @ guess, rows.R, rows.low, rows.high), guess

    def _solve(self, program: Program, guess: Array, rows: LimitRows, added: Array) -> tuple[Array, bool]:
        """Solve the program, with accelerations that give way if there is no other answer."""
        answer = program.solve(self.tracker.solver, guess, self.held)
        if answer is not None:
            self.held = answer.held
            return answer.c, False
        hard = Program(program.P, program.p, rows.R, rows.hard_low - added, rows.hard_high - added)
        loose = hard.relax(rows.soft_low - added, rows.soft_high - added, rows.room)
        answer = loose.solve(self.tracker.solver, np.append(guess, 0.0), self.held_relaxed)
        if answer is None:
            return np.zeros_like(guess), True
        c = answer.c[:-1]
        if program.excess(c) <= 1e-9 * max(float(np.linalg.norm(c)), 1.0):
            # nothing had to give way: the solver had lost its way between bounds that nearly meet
            answer = program.sharpen(c)
            self.held = answer.held
            return answer.c, False
        self.held_relaxed = answer.held
        return c, True

    def _move(self, place: MotionPlace, c: Array) -> tuple[MotionPlace, bool]:
        """Move along c for one period and close the loops; shorter where it is far or the loops do not close nearby.

        Returns:
            The place reached, and whether the step was shortened.
        """
        step = place.V @ c * self.period
        size = float(np.max(np.abs(step), initial=0.0))
        share = min(1.0, self.tracker.largest_step / max(size, 1e-300))
        for _ in range(30):
            moved = share * step
            X, residual = place.close(place.X + self.scale * moved)
            if residual <= 1e-10:
                correction = np.linalg.norm((X - place.X) / self.scale - moved)
                if correction <= 0.2 * np.linalg.norm(moved) + 1e-9:
                    return MotionPlace(self.frame, X, residual), share < 1.0
            share *= 0.5
        return place, True


def least_motion(A: Array, b: Array, damping: float) -> Array:
    """Give the smallest c that minimises `|A c - b|`, damped where singular values of A are small.

    Args:
        A: Rows of the command [1], shape (n_rows, mobility).
        b: Wanted rates [1/s], shape (n_rows,).
        damping: Singular value under which the damping sets in [1]; it grows smoothly from there to zero.

    Returns:
        The coordinates, at most about `|b| / damping` long.
    """
    U, sigma, Wt = np.linalg.svd(A, full_matrices=False)
    damped = np.maximum(damping**2 - sigma**2, 0.0)
    # values that are round-off stand for motions that the command does not ask for
    factor = np.where(sigma > 1e-12 * damping, sigma / (sigma**2 + damped), 0.0)
    return np.asarray(Wt.T @ (factor * (U.T @ b)))


def _as_finite(value: Any, what: str) -> Array:
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise DefinitionError(f"{what} is {value!r}; it must be numbers") from error
    if not np.all(np.isfinite(array)):
        raise DefinitionError(f"{what} is {value!r}; it must be finite")
    return array


def _check_positive(value: Any, what: str) -> None:
    if not (isinstance(value, (int, float, np.number)) and np.isfinite(value) and value > 0):
        raise DefinitionError(f"{what} is {value!r}; it must be a finite number above 0")
