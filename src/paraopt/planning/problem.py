"""What is asked: a scene, a start, a goal, limits and margins, checked when stated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, InfeasibleError
from paraopt.kinematics import Configuration, Determinants, MotionSpace
from paraopt.robot import Limits, Robot
from paraopt.scene import Scene

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

    Raises:
        DefinitionError: A value is not finite, or a name is missing or unknown.
    """

    scene: Scene
    start: Pose
    goal: Pose
    margins: Margins = field(default_factory=Margins)
    limits: Limits | None = None

    def __post_init__(self) -> None:
        if self.limits is not None:
            self.limits.check_fit(self.robot.mechanism)
        for label in ("start", "goal"):
            self._check_pose(label, getattr(self, label))

    @property
    def robot(self) -> Robot:
        """Give the machine."""
        return self.scene.robot

    @property
    def bounds(self) -> Limits:
        """Give the limits in force."""
        return self.robot.limits if self.limits is None else self.limits

    @property
    def independent(self) -> tuple[str, ...]:
        """Name the coordinates in which the path is described: the operational ones."""
        return tuple(self.robot.mechanism.operational)

    @cached_property
    def metric(self) -> Array:
        """Give the weight of each independent coordinate: 1 for lengths, the characteristic length for angles."""
        mechanism = self.robot.mechanism
        kinds = {v.name: v.kind for v in mechanism.variables}
        return np.array([1.0 if kinds[n] == "length" else mechanism.length for n in self.independent])

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
        return MotionSpace(self.robot.kinematics, self.independent)

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

        Raises:
            InfeasibleError: The goal cannot be reached.
        """
        if isinstance(self.goal, Configuration):
            return self.goal
        return self._solve("goal", self.goal, self.start_configuration)

    @cached_property
    def determinants(self) -> Determinants:
        """Give the signed determinants, on rows chosen at the start."""
        return Determinants.at(self.robot.kinematics, self.start_configuration)

    def goal_values(self) -> Array:
        """Give the goal in the independent coordinates, periodic angles brought within half a turn of the start."""
        index = self.robot.mechanism.indices(self.independent)
        start, goal = self.start_configuration.X[index], self.goal_configuration.X[index].copy()
        turn = goal - start
        return np.where(self.periodic, start + (turn + np.pi) % (2 * np.pi) - np.pi, goal)

    def _check_pose(self, label: str, pose: Pose) -> None:
        mechanism = self.robot.mechanism
        if isinstance(pose, Configuration):
            if pose.mechanism != mechanism:
                raise DefinitionError(
                    f"{label} is a configuration of another mechanism, {pose.mechanism.name!r}", configuration=pose
                )
            return
        missing = [n for n in mechanism.operational if n not in pose]
        unknown = [n for n in pose if n not in mechanism.operational]
        if missing or unknown:
            raise DefinitionError(
                f"{label} must state {list(mechanism.operational)}; missing {missing}, not operational {unknown}",
                pose=dict(pose),
            )
        for name, value in pose.items():
            if not (isinstance(value, (int, float, np.floating, np.integer)) and np.isfinite(value)):
                raise DefinitionError(
                    f"{label} value of {name!r} is {value!r}; it must be a finite number", pose=dict(pose)
                )

    def _solve(self, label: str, pose: Mapping[str, float], origin: Configuration) -> Configuration:
        """Walk from a known configuration to a pose in small steps, so that the branch is kept."""
        mechanism, kinematics = self.robot.mechanism, self.robot.kinematics
        names = list(mechanism.operational)
        first, last = origin.operational, np.array([float(pose[n]) for n in names])
        scale = kinematics.graph.variable_scale[mechanism.indices(names)]
        steps = max(1, int(np.ceil(np.max(np.abs(last - first) / scale) / 0.25)))
        X = origin.X[None, :]
        for t in np.linspace(0.0, 1.0, steps + 1)[1:]:
            closed = kinematics.solve_batch(names, (first + t * (last - first))[None, :], X)
            if not closed.converged[0]:
                break
            X = closed.X
        else:
            return kinematics.configuration(X[0])
        # the straight walk left the reachable space: try the pose itself, then tell how near one can get
        solution = kinematics.inverse(dict(zip(names, last.tolist(), strict=True)), start=origin)
        if np.all(solution.X[mechanism.indices(names)] == last) and solution.residual <= 1e-10:
            return solution.configuration
        raise InfeasibleError(f"{label} is out of reach: {solution.summary}", solution=solution, pose=dict(pose))
