"""A robot among obstacles: clearance, witness points, and gradients through the kinematic Jacobians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics import Configuration, MotionSpace
from paraopt.robot import Robot
from paraopt.scene.collision import CollisionModel
from paraopt.scene.pairs import WORLD, Body, Pair, SkippedPair, choose_pairs, list_bodies
from paraopt.shapes import Shape, check_solids

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Clearance:
    """Hold the smallest distance of a configuration.

    Attributes:
        distance: Signed distance [m], negative in penetration.
        pair: Names of the two bodies.
        points: Witness points on the first and second body, in the world [m], shape (2, 3).
        normal: Unit vector from the first body to the second, shape (3,).
        gradient: Derivative of the distance with respect to the operational variables [m/m or m/rad].
    """

    distance: float
    pair: str
    points: Array
    normal: Array
    gradient: Array


@dataclass(frozen=True, eq=False)
class Distances:
    """Hold distances of chosen pairs at n configurations.

    Attributes:
        values: Signed distances [m], shape (n, k).
        gradients: Derivatives with respect to the independent coordinates [m/m or m/rad], shape (n, k, m).
    """

    values: Array
    gradients: Array


@dataclass(frozen=True, eq=False)
class Scene:
    """Place a robot among obstacles.

    Attributes:
        robot: The machine.
        obstacles: Solids fixed in the world.
    """

    robot: Robot
    obstacles: Sequence[Shape] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Robot):
            raise DefinitionError(f"the scene's robot is {self.robot!r}; it must be a Robot")
        object.__setattr__(self, "obstacles", check_solids(self.obstacles, "obstacles of the scene"))
        names = [b.name for b in self.bodies]
        doubled = sorted({n for n in names if names.count(n) > 1})
        if doubled:
            raise DefinitionError(f"bodies {doubled} appear twice in the scene; give them different names")

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """List all solids: those of the links, then the obstacles."""
        return list_bodies(self.robot, self.obstacles)

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """List the pairs that are checked."""
        return self._choice[0]

    @property
    def skipped_pairs(self) -> tuple[SkippedPair, ...]:
        """List the pairs that are not checked, with the reason."""
        return self._choice[1]

    @cached_property
    def _choice(self) -> tuple[tuple[Pair, ...], tuple[SkippedPair, ...]]:
        return choose_pairs(self.robot, self.bodies)

    @cached_property
    def _collision(self) -> CollisionModel:
        return CollisionModel(self.bodies, self.pairs)

    def describe_pairs(self) -> str:
        """Write a table of the pairs: which are checked, which are not and why."""
        lines = [f"checked  {p.name}{'  (obstacle)' if p.is_external else ''}" for p in self.pairs]
        lines += [f"skipped  {s.name}: {s.reason}" for s in self.skipped_pairs]
        return "\n".join(lines)

    def clearance(self, configuration: Configuration) -> Clearance:
        """Find the smallest distance over all checked pairs.

        Args:
            configuration: Where to look.

        Returns:
            Distance, witness points, normal, and gradient with respect to the operational variables.

        Raises:
            DefinitionError: The scene has no pair to check.
        """
        if not self.pairs:
            raise DefinitionError(f"the scene of {self.robot.name!r} has no pair to check; give its links shapes")
        X = configuration.X[None, :]
        placed = self._collision.place(self.robot.kinematics.poses(X))
        _, which = self._collision.smallest(placed)
        distance, points, normal = self._collision.measure(placed, np.zeros(1, dtype=int), which)
        space = MotionSpace(self.robot.kinematics)
        gradients = self.distances(X, which, space.tangent(X)).gradients
        return Clearance(float(distance[0]), self.pairs[which[0]].name, points[0], normal[0], gradients[0, 0])

    def clearances(self, X: ArrayLike) -> tuple[Array, NDArray[np.intp]]:
        """Find the smallest distance at n configurations.

        Args:
            X: Configurations, shape (n, n_variables).

        Returns:
            Distances [m], inf when the scene has no pair, and indices into `pairs`, -1 when none; shape (n,) each.
        """
        return self._collision.smallest(self._collision.place(self.robot.kinematics.poses(X)))

    def too_close(self, X: ArrayLike, margin: float) -> NDArray[np.intp]:
        """Find a pair that is closer than a margin [m] at each of n configurations; -1 where there is none."""
        return self._collision.first_below(self._collision.place(self.robot.kinematics.poses(X)), margin)

    def near_pairs(self, X: ArrayLike, horizon: float) -> NDArray[np.intp]:
        """List the pairs that come closer than a horizon [m] at any of n configurations."""
        placed = self._collision.place(self.robot.kinematics.poses(X))
        samples, pairs = np.nonzero(self._collision.lower_bounds(placed) < horizon)
        distances, _, _ = self._collision.measure(placed, samples, pairs)
        return np.unique(pairs[distances < horizon])

    def distances(self, X: ArrayLike, pairs: NDArray[np.intp], T: Array) -> Distances:
        """Measure chosen pairs at n configurations, with gradients.

        The gradient of a distance is `n . (dp_second - dp_first)`, the motion of the witness points as parts of
        their links; at a kink (several nearest points) it is that of the witness points that coal returns.

        Args:
            X: Configurations, shape (n, n_variables).
            pairs: Indices into `pairs`, shape (k,).
            T: Motions `dX / d independent` at the configurations, shape (n, n_variables, m).

        Returns:
            Distances and gradients.
        """
        X = np.atleast_2d(np.asarray(X, dtype=float))
        n, k = len(X), len(pairs)
        poses = self.robot.kinematics.poses(X)
        placed = self._collision.place(poses)
        samples, chosen = np.repeat(np.arange(n), k), np.tile(pairs, n)
        values, points, normals = self._collision.measure(placed, samples, chosen)
        velocities = self.robot.kinematics.pose_velocity(X, T)
        gradients = np.zeros((n * k, T.shape[2]))
        for side, sign in ((0, -1.0), (1, 1.0)):
            body = self._sides[side][chosen]
            frames = self._frames[body]
            moving = np.flatnonzero(frames != WORLD)
            s, f = samples[moving], frames[moving]
            X_WL = poses[s, f]
            local = np.einsum("kji,kj->ki", X_WL[:, :3, :3], points[moving, side] - X_WL[:, :3, 3])
            dX = velocities[s, :, f]
            dp = np.einsum("kmij,kj->kmi", dX[..., :3], local) + dX[..., 3]
            gradients[moving] += sign * np.einsum("kmi,ki->km", dp, normals[moving])
        return Distances(values.reshape(n, k), gradients.reshape(n, k, T.shape[2]))

    @cached_property
    def _sides(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        return np.array([p.first for p in self.pairs], dtype=int), np.array([p.second for p in self.pairs], dtype=int)

    @cached_property
    def _frames(self) -> NDArray[np.intp]:
        return np.array([b.frame for b in self.bodies], dtype=int)
