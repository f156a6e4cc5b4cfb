"""What is asked: a scene, a start, a goal, limits and margins, checked when stated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, InfeasibleError, SolveError, unknown_name
from paraopt.kinematics import Configuration, Determinants, MotionSpace
from paraopt.planning.condition import ConditionSet, PathBound, PathCondition, read_conditions
from paraopt.robot import Limits, Robot
from paraopt.scene import Scene

if TYPE_CHECKING:
    from paraopt.planning.retime_base.rows import PathConstraint

Array = NDArray[np.float64]
Pose = Mapping[str, float] | Configuration


@dataclass(frozen=True)
class Margins:
    """State how far a motion must stay from trouble.

    Attributes:
        clearance: Smallest allowed distance between checked bodies [m].
        singularity: Smallest allowed distance to singularities, parallel and serial, in [0, 1]; see `MotionSpace`.
    """

    clearance: float = 0.005
    singularity: float = 0.05

    def __post_init__(self) -> None:
        for name, top in (("clearance", np.inf), ("singularity", 1.0)):
            value = getattr(self, name)
            if not (isinstance(value, (int, float, np.floating)) and np.isfinite(value) and 0.0 <= value < top):
                raise DefinitionError(f"{name} margin is {value!r}; it must be a finite number in [0, {top})")


@dataclass(frozen=True, eq=False)
class Problem:
    """Ask for a motion from one pose to another.

    Attributes:
        scene: The robot among its obstacles.
        start: Operational values by name [m or rad], solved on the branch of the robot's home; or a configuration.
        goal: Operational values by name, on the branch that the motion reaches; or a configuration.
        margins: Distances to keep.
        limits: Bounds of the drives; those of the robot when None.
        allow_mode_change: Whether the motion may cross serial singularities, to end in another working mode. It is then
            described by the actuators instead of the operational variables, and only parallel singularities count.
        characteristic_length: What an angle of one radian counts in the metric [m]; that of the mechanism when None.
        turns: Full turns by which an angle without bounds may pass beyond start and goal.
        coordinates: Names of the variables in which start, goal and path are stated, as many as the machine has degrees
            of freedom while others are held; the operational variables when None. A serial singularity is where these
            no longer determine the motion.
        held: Names of the variables that are locked at their values at the start: joints with a brake, the feet on
            which a legged machine stands. A start that is stated by values takes them from the robot's home.
        conditions: What else must hold all along: bounds on expressions, or objects that compute their own quantities.
        dynamics: Bounds that depend on speed and acceleration too, such as those of cable tensions: retimers keep them,
            and the certificate checks them.

    Raises:
        DefinitionError: A value is not finite, or a name is missing or unknown; mode changes are allowed, but there are
            not as many actuators as operational variables; a variable is both held and a coordinate; a held variable
            differs between start and goal.
    """

    scene: Scene
    start: Pose
    goal: Pose
    margins: Margins = field(default_factory=Margins)
    limits: Limits | None = None
    allow_mode_change: bool = False
    characteristic_length: float | None = None
    turns: int = 1
    coordinates: Sequence[str] | None = None
    held: Sequence[str] = ()
    conditions: Sequence[PathBound | PathCondition] = ()
    dynamics: Sequence[PathConstraint] = ()

    def __post_init__(self) -> None:
        mechanism = self.robot.mechanism
        for name in ("coordinates", "held", "conditions", "dynamics"):
            value = getattr(self, name)
            if isinstance(value, str) or not (value is None or isinstance(value, Sequence)):
                raise DefinitionError(f"{name} of the problem are {value!r}; they must be a sequence")
            object.__setattr__(self, name, None if value is None else tuple(value))
        self._check_names()
        if self.limits is not None:
            self.limits.check_fit(mechanism)
        length = self.characteristic_length
        if length is not None and not (np.isfinite(length) and length > 0):
            raise DefinitionError(f"characteristic length of the metric is {length} m; it must be finite and above 0")
        if self.turns < 0:
            raise DefinitionError(f"number of full turns is {self.turns}; it must not be negative")
        drives = [name for name in mechanism.active if name not in self.held]
        if self.allow_mode_change and len(drives) != len(self.stated):
            raise DefinitionError(
                f"{mechanism.name!r} has {len(drives)} free actuators and {len(self.stated)} operational variables or "
                "coordinates; a motion that changes the working mode is described by the actuators, so these must be "
                "as many"
            )
        for label in ("start", "goal"):
            self._check_pose(label, getattr(self, label))
        if self.held and isinstance(self.goal, Configuration):
            index = mechanism.indices(self.held)
            first, last = self.start_configuration.X[index], self.goal.X[index]
            worst = int(np.argmax(np.abs(last - first)))
            if abs(last[worst] - first[worst]) > 1e-9:
                raise DefinitionError(
                    f"{self.held[worst]!r} is held, but it is {first[worst]:.9g} at the start and {last[worst]:.9g} at "
                    "the goal; they must agree to 1e-9"
                )

    @property
    def robot(self) -> Robot:
        """Give the machine."""
        return self.scene.robot

    @property
    def bounds(self) -> Limits:
        """Give the limits in force."""
        return self.robot.limits if self.limits is None else self.limits

    @property
    def stated(self) -> tuple[str, ...]:
        """Name the coordinates in which start and goal are stated."""
        return tuple(self.robot.mechanism.operational if self.coordinates is None else self.coordinates)

    @property
    def independent(self) -> tuple[str, ...]:
        """Name the coordinates in which the path is described: those of start and goal, or those of the actuators.

        Away from parallel singularities the actuators determine the motion, at serial singularities too.
        """
        if self.allow_mode_change:
            return tuple(name for name in self.robot.mechanism.active if name not in self.held)
        return self.stated

    @cached_property
    def index(self) -> NDArray[np.intp]:
        """Give the places of the independent coordinates among the variables, shape (m,)."""
        return np.asarray(self.robot.mechanism.indices(self.independent))

    @cached_property
    def metric(self) -> Array:
        """Give the weight of each independent coordinate: 1 for lengths, the characteristic length for angles.

        A force of the size that balances weigh counts as much as a radian.
        """
        mechanism = self.robot.mechanism
        length = self.characteristic_length or mechanism.length
        scales = {"length": length, "angle": 1.0}
        known = {v.name: scales.get(v.kind, v.scale) for v in mechanism.variables}
        return np.array([length / known[n] for n in self.independent])

    @cached_property
    def periodic(self) -> NDArray[np.bool_]:
        """Tell which independent coordinates are angles that may turn without end."""
        by_name = {v.name: v for v in self.robot.mechanism.variables}
        low, high = self.bounds.bounds(self.robot.mechanism)
        return np.array(
            [
                by_name[n].kind == "angle"
                and not np.isfinite(low[self.robot.mechanism.index(n)])
                and not np.isfinite(high[self.robot.mechanism.index(n)])
                for n in self.independent
            ]
        )

    @cached_property
    def space(self) -> MotionSpace:
        """Give the judge of singularities in the independent coordinates."""
        return MotionSpace(self.robot.kinematics, self.independent, self.stated, self.held)

    @cached_property
    def condition_set(self) -> ConditionSet:
        """Give the evaluator of the conditions."""
        return read_conditions(self.robot.kinematics.graph, tuple(self.conditions))

    @cached_property
    def start_configuration(self) -> Configuration:
        """Solve the start.

        Raises:
            InfeasibleError: The start cannot be reached.
        """
        if isinstance(self.start, Configuration):
            return self.start
        return self._solve("start", self.start, self.robot.home_configuration)

    @cached_property
    def goal_configuration(self) -> Configuration:
        """Solve the goal, on the branch of the start unless it is stated as a configuration.

        Where that branch leaves the ranges there, or the working mode may change and the branch lies beyond a parallel
        singularity, it is the nearest of the other solutions, those first that no sign parts from the start.

        Raises:
            InfeasibleError: The goal cannot be reached.
        """
        if isinstance(self.goal, Configuration):
            return self.goal
        return self._choose_mode(self.goal, self._solve("goal", self.goal, self.start_configuration))

    @cached_property
    def determinants(self) -> Determinants:
        """Give the signed determinants, on rows chosen at the start."""
        return Determinants.at(self.robot.kinematics, self.start_configuration, self.stated, self.held)

    def goal_values(self) -> Array:
        """Give the goal in the independent coordinates, periodic angles brought within half a turn of the start."""
        start, goal = self.start_configuration.X[self.index], self.goal_configuration.X[self.index]
        return np.where(self.periodic, start + self.turn(goal - start), goal)

    def turn(self, difference: Array) -> Array:
        """Take the periodic ones among differences of the independent coordinates the short way round."""
        if not np.any(self.periodic):
            return difference
        return np.where(self.periodic, (difference + np.pi) % (2 * np.pi) - np.pi, difference)

    @cached_property
    def turn_bounds(self) -> tuple[Array, Array]:
        """Give the least and largest values to look at: `turns` beyond start and goal for periodic ones, else none."""
        start, goal = self.start_configuration.X[self.index], self.goal_values()
        beyond = np.where(self.periodic, 2 * np.pi * self.turns + 1e-9, np.inf)
        return np.minimum(start, goal) - beyond, np.maximum(start, goal) + beyond

    def _check_pose(self, label: str, pose: Pose) -> None:
        mechanism = self.robot.mechanism
        if isinstance(pose, Configuration):
            if pose.mechanism != mechanism:
                raise DefinitionError(
                    f"{label} is a configuration of another mechanism, {pose.mechanism.name!r}", configuration=pose
                )
            return
        missing = [n for n in self.stated if n not in pose]
        unknown = [n for n in pose if n not in self.stated]
        if missing or unknown:
            kind = "operational" if self.coordinates is None else "among them"
            raise DefinitionError(
                f"{label} must state {list(self.stated)}; missing {missing}, not {kind} {unknown}", pose=dict(pose)
            )
        for name, value in pose.items():
            if not (isinstance(value, (int, float, np.floating, np.integer)) and np.isfinite(value)):
                raise DefinitionError(
                    f"{label} value of {name!r} is {value!r}; it must be a finite number", pose=dict(pose)
                )

    def _check_names(self) -> None:
        """Refuse coordinates and held variables that do not exist, or contradict each other."""
        mechanism = self.robot.mechanism
        for what, names in (("coordinate", self.coordinates or ()), ("held variable", self.held)):
            for name in names:
                if name not in mechanism.names:
                    raise unknown_name(f"{what} of the problem", name, mechanism.names)
            if doubled := sorted({n for n in names if names.count(n) > 1}):
                raise DefinitionError(f"{what} {doubled[0]!r} appears twice; name it once")
        if self.coordinates is not None and not self.coordinates:
            raise DefinitionError("coordinates of the problem are empty; name at least one, or None")
        if both := [name for name in self.held if name in self.stated]:
            raise DefinitionError(
                f"{both[0]!r} is held, but start and goal are stated in it; name as coordinates only what moves"
            )

    def _solve(self, label: str, pose: Mapping[str, float], origin: Configuration) -> Configuration:
        """Walk from a known configuration to a pose in small steps, so that the branch is kept."""
        mechanism, kinematics = self.robot.mechanism, self.robot.kinematics
        names, index, held = list(self.stated), mechanism.indices(self.stated), mechanism.indices(self.held)
        first, last = origin.X[index], np.array([float(pose[n]) for n in names])
        scale = kinematics.graph.variable_scale[index]
        steps = max(1, int(np.ceil(np.max(np.abs(last - first) / scale) / 0.25)))
        X = origin.X[None, :]
        for t in np.linspace(0.0, 1.0, steps + 1)[1:]:
            closed = kinematics.solve_batch(names, (first + t * (last - first))[None, :], X, held=self.held)
            if not closed.converged[0]:
                break
            X = closed.X
        else:
            return kinematics.configuration(X[0])
        # the straight walk left the reachable space: try the pose itself, then tell how near one can get
        wanted = {**dict(zip(names, last.tolist(), strict=True)), **dict(zip(self.held, origin.X[held], strict=True))}
        solution = kinematics.solve(wanted, start=origin)
        if np.all(solution.X[index] == last) and solution.residual <= 1e-10:
            return solution.configuration
        raise InfeasibleError(f"{label} is out of reach: {solution.summary}", solution=solution, pose=dict(pose))

    def _choose_mode(self, pose: Mapping[str, float], same: Configuration) -> Configuration:
        """Keep the solution that a straight walk reaches, unless another one of the pose can be the goal and it cannot.

        A walk that passes near a leg of no length comes out with a negative length. Where the working mode may change,
        the solution must lie on the start's side of the parallel singularities.
        """
        wanted = np.array(self.determinants.signs(self.start_configuration.X))[:, 0]
        if self.allow_mode_change:
            wanted[1] = np.nan
        low, high = self.bounds.bounds(self.robot.mechanism)

        def is_inside(X: Array) -> bool:
            return bool(np.all((low <= X) & (high >= X)))

        def is_apart(X: Array) -> bool:
            signs = np.array(self.determinants.signs(X))[:, 0]
            return bool(np.any((signs != wanted) & ~np.isnan(wanted)))

        if is_inside(same.X) and not (self.allow_mode_change and is_apart(same.X)):
            return same
        if self.held or self.coordinates is not None:  # working modes are those of the operational variables
            return same
        try:
            others = [c for c in self.robot.kinematics.working_modes(pose, same) if is_inside(c.X)]
        except SolveError:
            return same
        start = self.start_configuration.X[self.index]

        def distance(other: Configuration) -> tuple[bool, float]:
            move = self.turn(other.X[self.index] - start) * self.metric
            return is_apart(other.X), float(np.linalg.norm(move))

        return min(others, key=distance, default=same)
