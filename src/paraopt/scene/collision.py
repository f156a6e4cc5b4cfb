"""The one door to coal: distances between placed solids, with witness points and normals.

Conventions: the distance is signed, negative in penetration; the normal is a unit vector that points from the first
body to the second, so that `p_second - p_first = distance * normal` at the witness points, and moving the second body
along the normal increases the distance.
"""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
from numpy.typing import NDArray

from paraopt.errors import BackendError, DefinitionError
from paraopt.scene.bounds import enclose, segment_distance
from paraopt.scene.exact import measure_point_and_cylinder
from paraopt.scene.pairs import WORLD, Body, Pair
from paraopt.shapes import Box, Capsule, Cylinder, Shape, Sphere

Array = NDArray[np.float64]
_BLOCK = 64
_ABSURD = 1e100  # coal reports the largest double when its search fails [m]


def build_geometry(shape: Shape) -> coal.CollisionGeometry:
    """Build coal's solid for a shape, in the shape's own frame.

    Raises:
        DefinitionError: coal has no solid for this kind of shape here.
    """
    if isinstance(shape, Box):
        return coal.Box(*np.asarray(shape.size, dtype=float))
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length)
    if isinstance(shape, Capsule):
        return coal.Capsule(shape.radius, shape.length)
    raise DefinitionError(f"{shape.label} cannot be checked for collision; use Box, Sphere, Cylinder or Capsule")


def _build_request(separation: float, penetration: float) -> coal.DistanceRequest:
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    request.gjk_tolerance, request.epa_tolerance = separation, penetration
    request.gjk_max_iterations = request.epa_max_iterations = 512
    return request


class CollisionModel:
    """Measure distances between pairs of bodies for batches of link poses.

    Args:
        bodies: The solids.
        pairs: The pairs that are checked.
        tolerance: Accuracy asked of coal's iterations for separate bodies [m]; penetrations are known to about 1e-5 m.
    """

    def __init__(self, bodies: Sequence[Body], pairs: Sequence[Pair], tolerance: float = 1e-9) -> None:
        self.bodies, self.pairs = tuple(bodies), tuple(pairs)
        geometries = [build_geometry(b.shape) for b in self.bodies]
        self._geometries = geometries  # coal keeps no reference of its own
        self._measure = [coal.ComputeDistance(geometries[p.first], geometries[p.second]) for p in self.pairs]
        # asked for more than about 1e-6 m, coal's search for the depth of a penetration ends on wrong facets or fails
        self._request = _build_request(tolerance, max(tolerance, 1e-6))
        self._modest_request = _build_request(1e3 * tolerance, 1e-4)
        self._first = np.array([p.first for p in self.pairs], dtype=int)
        self._second = np.array([p.second for p in self.pairs], dtype=int)
        ends, radii = zip(*[enclose(b.shape) for b in self.bodies], strict=True) if self.bodies else ((), ())
        self._ends, self._radii = np.array(ends).reshape(-1, 2, 3), np.array(radii)
        self._placements = np.array([b.shape.pose for b in self.bodies]).reshape(-1, 4, 4)
        self._frames = np.array([b.frame for b in self.bodies], dtype=int)
        kinds = [{type(self.bodies[i].shape) for i in (p.first, p.second)} for p in self.pairs]
        # coal 3.0.3 gives wrong depths for a sphere whose centre is inside a cylinder
        self._by_formula = np.array([kind == {Sphere, Cylinder} for kind in kinds], dtype=bool)
        self._is_ball = np.array([isinstance(b.shape, Sphere) for b in self.bodies], dtype=bool)
        sizes = [(getattr(b.shape, "radius", np.nan), getattr(b.shape, "length", np.nan)) for b in self.bodies]
        self._radius, self._length = np.array(sizes, dtype=float).reshape(-1, 2).T

    def place(self, poses: Array) -> Array:
        """Give the pose of every body in the world.

        Args:
            poses: Link poses, shape (n, n_links, 4, 4).

        Returns:
            Body poses, shape (n, n_bodies, 4, 4).
        """
        n = len(poses)
        frames = np.empty((n, len(self.bodies), 4, 4))
        moving = self._frames != WORLD
        frames[:, moving] = poses[:, self._frames[moving]]
        frames[:, ~moving] = np.eye(4)
        return frames @ self._placements

    def lower_bounds(self, placed: Array) -> Array:
        """Bound the distance of every pair from below by that of enclosing capsules [m], shape (n, n_pairs)."""
        if not self.pairs:
            return np.empty((len(placed), 0))
        ends = self._ends @ placed[..., :3, :3].transpose(0, 1, 3, 2) + placed[:, :, None, :3, 3]
        gap = np.empty((len(placed), len(self.pairs)))
        for start in range(0, len(placed), _BLOCK):  # blocks that stay in the processor's cache
            block = ends[start : start + _BLOCK]
            P, Q = block[:, self._first].reshape(-1, 2, 3), block[:, self._second].reshape(-1, 2, 3)
            gap[start : start + _BLOCK] = segment_distance().batch(P, Q)[0].reshape(len(block), -1)
        return gap - self._radii[self._first] - self._radii[self._second]

    def measure(self, placed: Array, samples: NDArray[np.intp], pairs: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Measure chosen pairs at chosen samples.

        Args:
            placed: Body poses, shape (n, n_bodies, 4, 4).
            samples: Sample of each measurement, shape (k,).
            pairs: Pair of each measurement, shape (k,).

        Returns:
            Signed distances [m], shape (k,); witness points on both bodies in the world [m], shape (k, 2, 3);
            normals from the first to the second body, shape (k, 3).

        Raises:
            BackendError: coal failed.
        """
        k = len(samples)
        distances, points, normals = np.empty(k), np.empty((k, 2, 3)), np.empty((k, 3))
        formula = self._by_formula[pairs]
        if np.any(formula):
            distances[formula], points[formula], normals[formula] = self._measure_balls(
                placed, samples[formula], pairs[formula]
            )
        A, B, result = coal.Transform3s(), coal.Transform3s(), coal.DistanceResult()
        first, second = self._first[pairs], self._second[pairs]
        R_A, R_B = placed[samples, first, :3, :3], placed[samples, second, :3, :3]
        p_A, p_B = placed[samples, first, :3, 3], placed[samples, second, :3, 3]
        try:
            for i, pair in enumerate(pairs.tolist()):
                if formula[i]:
                    continue
                A.setTransform(R_A[i], p_A[i])
                B.setTransform(R_B[i], p_B[i])
                result.clear()
                distance = self._measure[pair](A, B, self._request, result)
                if abs(distance) > _ABSURD:
                    result.clear()
                    distance = self._measure[pair](A, B, self._modest_request, result)
                    if abs(distance) > _ABSURD:
                        raise BackendError(f"coal found no distance for the pair {self.pairs[pair].name}")
                distances[i] = distance
                points[i, 0], points[i, 1] = result.getNearestPoint1(), result.getNearestPoint2()
                normals[i] = result.normal
        except (RuntimeError, ValueError) as error:
            raise BackendError(f"coal failed on the pair {self.pairs[pair].name}: {error}") from error
        return distances, points, normals

    def _measure_balls(
        self, placed: Array, samples: NDArray[np.intp], pairs: NDArray[np.intp]
    ) -> tuple[Array, Array, Array]:
        """Measure pairs of a sphere and a cylinder by formula."""
        first, second = self._first[pairs], self._second[pairs]
        ball_first = self._is_ball[first]
        ball, tube = np.where(ball_first, first, second), np.where(ball_first, second, first)
        ball_radius, radius, half = self._radius[ball], self._radius[tube], 0.5 * self._length[tube]
        centre, X_WT = placed[samples, ball, :3, 3], placed[samples, tube]
        local = np.einsum("kji,kj->ki", X_WT[:, :3, :3], centre - X_WT[:, :3, 3])
        distance, touched, normal = measure_point_and_cylinder(local, radius, half)
        touched = np.einsum("kij,kj->ki", X_WT[:, :3, :3], touched) + X_WT[:, :3, 3]
        normal = np.einsum("kij,kj->ki", X_WT[:, :3, :3], normal)
        points = np.stack([touched, centre - ball_radius[:, None] * normal], axis=1)
        points[ball_first] = points[ball_first, ::-1]
        normal[ball_first] *= -1.0
        return distance - ball_radius, points, normal

    def smallest(self, placed: Array) -> tuple[Array, NDArray[np.intp]]:
        """Find the smallest distance over all pairs at every sample, and the pair that has it.

        Pairs are measured in the order of their lower bounds until no bound is below the smallest measured distance.

        Args:
            placed: Body poses, shape (n, n_bodies, 4, 4).

        Returns:
            Distances [m] and indices of pairs, shape (n,) each; inf and -1 when there is no pair.
        """
        n = len(placed)
        best, which = np.full(n, np.inf), np.full(n, -1, dtype=int)
        if not self.pairs:
            return best, which
        bounds = self.lower_bounds(placed)
        order = np.argsort(bounds, axis=1)
        waiting = np.arange(n)
        for rank in range(len(self.pairs)):
            candidates = order[waiting, rank]
            waiting = waiting[bounds[waiting, candidates] < best[waiting]]
            if not waiting.size:
                break
            pairs = order[waiting, rank]
            distances, _, _ = self.measure(placed, waiting, pairs)
            closer = distances < best[waiting]
            best[waiting[closer]], which[waiting[closer]] = distances[closer], pairs[closer]
        return best, which

    def first_below(self, placed: Array, margin: float) -> NDArray[np.intp]:
        """Find a pair closer than a margin [m] at every sample; -1 where there is none, shape (n,)."""
        which = np.full(len(placed), -1, dtype=int)
        samples, pairs = np.nonzero(self.lower_bounds(placed) < margin)
        distances, _, _ = self.measure(placed, samples, pairs)
        below = np.flatnonzero(distances < margin)[::-1]  # the first one is written last
        which[samples[below]] = pairs[below]
        return which
