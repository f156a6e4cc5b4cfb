"""A robot among obstacles: clearance, witness points, and gradients through the kinematic Jacobians."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.kinematics import Configuration, MotionSpace
from paraopt.robot import Robot
from paraopt.scene.cable import move_witnesses
from paraopt.scene.collision import CollisionModel
from paraopt.scene.pairs import WORLD, Body, Pair, SkippedPair, choose_pairs, list_bodies
from paraopt.scene.reach import walk_configurations
from paraopt.scene.rules import PairRule, read_rules
from paraopt.shapes import Cable, Shape, check_cables, check_solids

Array = NDArray[np.float64]
Kind = Literal["all", "external", "internal"]


@dataclass(frozen=True, eq=False)
class Clearance:
    """Hold the smallest distance of a configuration.

    Attributes:
        distance: Signed distance [m], negative in penetration.
        pair: Names of the two bodies.
        points: Witness points on the first and second body, in the world [m], shape (2, 3).
        normal: Unit vector from the first body to the second, shape (3,).
        gradient: Derivative of the distance with respect to the operational variables [m/m or m/rad].
        is_external: Whether one of them is an obstacle; else the robot is near itself.
    """

    distance: float
    pair: str
    points: Array
    normal: Array
    gradient: Array
    is_external: bool

    def describe(self) -> str:
        """Tell in a sentence what is how near to what."""
        kind = "an obstacle" if self.is_external else "the robot itself"
        if self.distance < 0.0:
            return f"collision with {kind}: {self.pair}, {1e3 * -self.distance:.3g} mm deep"
        if self.distance == 0.0:
            return f"contact with {kind}: {self.pair}"
        return f"nearest to {kind}: {self.pair}, {1e3 * self.distance:.3g} mm apart"


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
        cables: Cables between links beyond those that the robot carries.
        rules: What was decided about pairs by hand or by sampling, beyond what follows from the robot.
    """

    robot: Robot
    obstacles: Sequence[Shape] = ()
    cables: Sequence[Cable] = ()
    rules: Sequence[PairRule] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Robot):
            raise DefinitionError(f"the scene's robot is {self.robot!r}; it must be a Robot")
        object.__setattr__(self, "obstacles", check_solids(self.obstacles, "obstacles of the scene"))
        object.__setattr__(self, "cables", check_cables(self.cables, "cables of the scene"))
        object.__setattr__(self, "rules", _check_rules(self.rules))
        names = [b.name for b in self.bodies]
        doubled = sorted({n for n in names if names.count(n) > 1})
        if doubled:
            raise DefinitionError(f"bodies {doubled} appear twice in the scene; give them different names")

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """List all bodies: solids of the links, obstacles, cables of the robot, cables of the scene."""
        return list_bodies(self.robot, self.obstacles, self.all_cables)

    @property
    def all_cables(self) -> tuple[Cable, ...]:
        """List the cables of the robot, then those that were given to the scene."""
        return (*self.robot.cables, *self.cables)

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
        return choose_pairs(self.robot, self.bodies, self.rules)

    @cached_property
    def _collision(self) -> CollisionModel:
        return CollisionModel(self.bodies, self.pairs)

    def describe_pairs(self) -> str:
        """Write a table of the pairs: which are checked, which are not and why."""
        lines = [f"checked  {p.name}{'  (obstacle)' if p.is_external else ''}" for p in self.pairs]
        lines += [f"skipped  {s.name}: {s.reason}" for s in self.skipped_pairs]
        return "\n".join(lines)

    def with_pairs(
        self,
        skip: Mapping[tuple[str, str] | str, str] | Iterable[tuple[str, str] | str] = (),
        check: Iterable[tuple[str, str] | str] = (),
    ) -> Scene:
        """Change the table of pairs.

        A pair is two names, or "first / second" as the table writes it. A name is that of a link, for
        all its bodies, or of a body; "world" stands for all obstacles. What is said later holds.

        Args:
            skip: Pairs that are left out, with the reasons where a mapping is given.
            check: Pairs that are checked, whatever was the reason to leave them out.

        Returns:
            A scene with this table.

        Raises:
            UnknownNameError: A name is that of no body and no link.
            DefinitionError: What is given are no pairs, or a pair is both skipped and checked.
        """
        links = [link.name for link in self.robot.mechanism.links]
        names = list(dict.fromkeys([*(b.name for b in self.bodies), *links, "world"]))
        skipped, checked = read_rules(skip, False, names), read_rules(check, True, names)
        both = {frozenset((r.first, r.second)) for r in skipped} & {frozenset((r.first, r.second)) for r in checked}
        if both:
            pair = " / ".join(sorted(next(iter(both))))
            raise DefinitionError(f"pair {pair} is both skipped and checked; leave one of them out")
        return replace(self, rules=(*self.rules, *skipped, *checked))

    def find_unreachable_pairs(self, samples: int = 2000, seed: int = 0, apart: float | None = None) -> Scene:
        """Leave out the pairs of bodies of the robot that never come near each other, as far as sampling shows.

        Configurations all over the reach of the robot, within its limits, are looked at; the reason in the table tells
        how many they were and the smallest distance that was seen. It is evidence, no proof: what the samples leave out
        between them is covered by the distance `apart`. Pairs with obstacles stay.

        Args:
            samples: Number of configurations.
            seed: Seed of the walk through them.
            apart: Distance that a pair keeps at all of them to be left out [m]; a fifth of the characteristic length
                when None.

        Returns:
            A scene in which these pairs are skipped.

        Raises:
            DefinitionError: A number is not positive.
        """
        apart = 0.2 * self.robot.mechanism.length if apart is None else float(apart)
        if not (np.isfinite(apart) and apart > 0.0):
            raise DefinitionError(f"distance of pairs that are never in reach is {apart} m; it must be finite, above 0")
        X = walk_configurations(self.robot, samples, seed)
        placed = self._collision.place(self.robot.kinematics.poses(X))
        bounds = self._collision.lower_bounds(placed)
        rules = []
        for k, pair in enumerate(self.pairs):
            if pair.is_external or bounds[:, k].min() < -apart:
                continue
            # measured where the bound is below the smallest distance so far
            order = np.argsort(bounds[:, k])
            nearest = np.inf
            for sample in np.array_split(order, max(1, len(order) // 16)):
                if bounds[sample[0], k] >= nearest or nearest < apart:
                    break
                distances, _, _ = self._collision.measure(placed, sample, np.full(len(sample), k))
                nearest = min(nearest, float(distances.min()))
            if nearest >= apart:
                reason = (
                    f"never in reach: {nearest:.3g} m apart or more over {len(X)} sampled configurations (seed {seed})"
                )
                bodies = self.bodies[pair.first], self.bodies[pair.second]
                rules.append(PairRule(bodies[0].name, bodies[1].name, False, reason))
        return replace(self, rules=(*self.rules, *rules))

    def clearance(self, configuration: Configuration, kind: Kind = "all") -> Clearance:
        """Find the smallest distance over the checked pairs.

        Args:
            configuration: Where to look.
            kind: "external" for pairs with an obstacle, "internal" for the robot against itself, "all" for both.

        Returns:
            Distance, witness points, normal, and gradient with respect to the operational variables.

        Raises:
            DefinitionError: The scene has no pair of this kind to check.
        """
        among = self._among(kind)
        if not (len(self.pairs) if among is None else len(among)):
            word = "" if kind == "all" else f"{kind} "
            raise DefinitionError(f"the scene of {self.robot.name!r} has no {word}pair to check; give its links shapes")
        X = configuration.X[None, :]
        poses = self.robot.kinematics.poses(X)
        placed = self._collision.place(poses)
        _, which = self._collision.smallest(placed, among)
        sample = np.zeros(1, dtype=int)
        measured = self._collision.measure(placed, sample, which)
        T = MotionSpace(self.robot.kinematics).tangent(X)
        gradient = self._gradients(X, T, poses, sample, which, measured[1], measured[2])
        pair = self.pairs[which[0]]
        return Clearance(
            float(measured[0][0]), pair.name, measured[1][0], measured[2][0], gradient[0], pair.is_external
        )

    def _among(self, kind: Kind) -> NDArray[np.intp] | None:
        """Give the indices of the pairs of one kind; None for all."""
        if kind == "all":
            return None
        if kind not in ("external", "internal"):
            raise unknown_name("kind of pairs", kind, ("all", "external", "internal"))
        return np.flatnonzero([p.is_external == (kind == "external") for p in self.pairs])

    def clearances(self, X: ArrayLike, kind: Kind = "all") -> tuple[Array, NDArray[np.intp]]:
        """Find the smallest distance at n configurations.

        Args:
            X: Configurations, shape (n, n_variables).
            kind: As for `clearance`.

        Returns:
            Distances [m], inf when the scene has no pair, and indices into `pairs`, -1 when none; shape (n,) each.
        """
        return self._collision.smallest(self._collision.place(self.robot.kinematics.poses(X)), self._among(kind))

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
        gradients = self._gradients(X, T, poses, samples, chosen, points, normals)
        return Distances(values.reshape(n, k), gradients.reshape(n, k, T.shape[2]))

    def _gradients(
        self,
        X: Array,
        T: Array,
        poses: Array,
        samples: NDArray[np.intp],
        pairs: NDArray[np.intp],
        points: Array,
        normals: Array,
    ) -> Array:
        """Give `n . (dp_second - dp_first)` for k measurements, shape (k, m)."""
        velocities = self.robot.kinematics.pose_velocity(X, T)
        gradients = np.zeros((len(samples), T.shape[2]))
        for side, sign in ((0, -1.0), (1, 1.0)):
            body = self._sides[side][pairs]
            frames = self._frames[body]
            moving = np.flatnonzero(frames != WORLD)
            s, witness = samples[moving], points[moving, side]
            dp = _move_points(poses, velocities, s, frames[moving], witness)
            on_cable = np.flatnonzero(body[moving] >= self._n_solids)
            if on_cable.size:
                s, cable = s[on_cable], body[moving][on_cable] - self._n_solids
                A, B = (end[s, cable] for end in self._collision.anchors(poses))
                dA = _move_points(poses, velocities, s, self._cable_frames[cable, 0], A)
                dB = _move_points(poses, velocities, s, self._cable_frames[cable, 1], B)
                dp[on_cable] = move_witnesses(A, B, dA, dB, self._ignored[cable], witness[on_cable])
            gradients[moving] += sign * np.einsum("kmi,ki->km", dp, normals[moving])
        return gradients

    @cached_property
    def _sides(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        return np.array([p.first for p in self.pairs], dtype=int), np.array([p.second for p in self.pairs], dtype=int)

    @cached_property
    def _frames(self) -> NDArray[np.intp]:
        return np.array([b.frame for b in self.bodies], dtype=int)

    @cached_property
    def _n_solids(self) -> int:
        return len(self.bodies) - len(self.all_cables)

    @cached_property
    def _cable_frames(self) -> NDArray[np.intp]:
        return np.array([(b.frame, b.frame_B) for b in self.bodies[self._n_solids :]], dtype=int).reshape(-1, 2)

    @cached_property
    def _ignored(self) -> Array:
        return np.array([c.ignore for c in self.all_cables]).reshape(-1, 2)


def _move_points(
    poses: Array, velocities: Array, samples: NDArray[np.intp], frames: NDArray[np.intp], points: Array
) -> Array:
    """Give the motion of points of links, given in the world (k, 3); shape (k, m, 3)."""
    X_WL = poses[samples, frames]
    local = np.einsum("kji,kj->ki", X_WL[:, :3, :3], points - X_WL[:, :3, 3])
    dX = velocities[samples, :, frames]
    return np.asarray(np.einsum("kmij,kj->kmi", dX[..., :3], local) + dX[..., 3])


def _check_rules(given: object) -> tuple[PairRule, ...]:
    if isinstance(given, (str, bytes)) or not isinstance(given, Iterable):
        raise DefinitionError(f"rules of the scene are {given!r}; they must be a list of PairRule")
    rules = tuple(given)
    for rule in rules:
        if not isinstance(rule, PairRule):
            raise DefinitionError(f"rules of the scene hold {rule!r}; each must be a PairRule")
    return rules
