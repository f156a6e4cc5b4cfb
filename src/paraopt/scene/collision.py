"""Distances between placed bodies, with witness points and normals, for batches of link poses.

The conventions are those of the room, see `paraopt.scene`. Most pairs are measured by coal; those that it measures
wrongly, and cables against all but cylinders and cones, by formula.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np
from numpy.typing import NDArray

from paraopt.errors import BackendError, DefinitionError
from paraopt.scene.bounds import enclose, segment_distance
from paraopt.scene.cable import shorten_segments
from paraopt.scene.exact import (
    measure_cores,
    measure_point_and_cylinder,
    measure_segments_and_planes,
    part_cores,
    pose_segments,
)
from paraopt.scene.geometry import Cell, list_cells
from paraopt.scene.pairs import WORLD, Body, Pair
from paraopt.scene.segments import measure_segments, stack_hulls
from paraopt.shapes import Cable, Capsule, Cylinder, HalfSpace, Sphere

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Measured = tuple[Array, Array, Array]
_BLOCK = 64
_ABSURD = 1e100  # coal reports the largest double when its search fails [m]


@dataclass(frozen=True, eq=False)
class Placement:
    """Hold where the bodies are at n samples.

    Attributes:
        poses: Poses of the bodies in the world, shape (n, n_bodies, 4, 4); a cable's z axis runs along it.
        ends: Ends of the cables in the world, without what is ignored [m], shape (n, n_cables, 2, 3).
    """

    poses: Array
    ends: Array

    def __len__(self) -> int:
        return len(self.poses)


def _build_request(separation: float, penetration: float) -> coal.DistanceRequest:
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    request.gjk_tolerance, request.epa_tolerance = separation, penetration
    request.gjk_max_iterations = request.epa_max_iterations = 512
    return request


class CollisionModel:
    """Measure distances between pairs of bodies for batches of link poses.

    Args:
        bodies: The solids, then the cables.
        pairs: The pairs that are checked.
        tolerance: Accuracy asked of coal's iterations for separate bodies [m]; penetrations are known to about 1e-5 m.

    Raises:
        DefinitionError: A pair is made of two half-spaces, which have no distance.
    """

    def __init__(self, bodies: Sequence[Body], pairs: Sequence[Pair], tolerance: float = 1e-9) -> None:
        self.bodies, self.pairs = tuple(bodies), tuple(pairs)
        self._cells = cells = list_cells([b.shape for b in self.bodies])  # coal keeps no reference of its own
        # asked for more than about 1e-6 m, coal's search for the depth of a penetration ends on wrong facets or fails
        self._request = _build_request(tolerance, max(tolerance, 1e-6))
        self._modest_request = _build_request(1e3 * tolerance, 1e-4)
        self._first = np.array([p.first for p in self.pairs], dtype=int)
        self._second = np.array([p.second for p in self.pairs], dtype=int)
        self._place_data()
        self._bound_data()
        self._list_elements(cells)

    def _place_data(self) -> None:
        solids = [(b.frame, b.shape) for b in self.bodies if not isinstance(b.shape, Cable)]
        self._n_solids = len(solids)
        self._placements = np.array([shape.pose for _, shape in solids]).reshape(-1, 4, 4)
        self._frames = np.array([frame for frame, _ in solids], dtype=int)
        cables = [(b, b.shape) for b in self.bodies if isinstance(b.shape, Cable)]
        self._cable_frames = np.array([(b.frame, b.frame_B) for b, _ in cables], dtype=int).reshape(-1, 2)
        self._cable_points = np.array([(c.point_A, c.point_B) for _, c in cables]).reshape(-1, 2, 3)
        self._cable_ignore = np.array([c.ignore for _, c in cables]).reshape(-1, 2)

    def _bound_data(self) -> None:
        solids = [b.shape for b in self.bodies if not isinstance(b.shape, Cable)]
        ends, radii = zip(*[enclose(s) for s in solids], strict=True) if solids else ((), ())
        self._ends = np.array(ends).reshape(-1, 2, 3)
        self._radii = np.array([*radii, *[b.shape.radius for b in self.bodies if isinstance(b.shape, Cable)]])
        flat = np.array([isinstance(b.shape, HalfSpace) for b in self.bodies], dtype=bool)
        both = np.flatnonzero(flat[self._first] & flat[self._second])
        if both.size:
            raise DefinitionError(
                f"{self.pairs[both[0]].name} are two half-spaces, which have no distance; skip the pair, or use a box"
            )
        self._flat_pairs = np.flatnonzero(flat[self._first] | flat[self._second])
        first = flat[self._first[self._flat_pairs]]
        self._planes = np.where(first, self._first[self._flat_pairs], self._second[self._flat_pairs])
        self._above = np.where(first, self._second[self._flat_pairs], self._first[self._flat_pairs])

    def _list_elements(self, cells: Sequence[Cell]) -> None:
        """List the pairs of convex pieces of every pair of bodies; without meshes they are the pairs themselves."""
        of_body: list[list[int]] = [[] for _ in self.bodies]
        for k, cell in enumerate(cells):
            of_body[cell.body].append(k)
        elements = [(i, j, p) for p, pair in enumerate(self.pairs)
                    for i in of_body[pair.first] for j in of_body[pair.second]]  # fmt: skip
        first, second, owner = np.array(elements, dtype=int).reshape(-1, 3).T
        self._element_cells = np.stack([first, second])
        self._element_pair = owner
        self._count = np.bincount(owner, minlength=len(self.pairs))
        self._start = np.concatenate([[0], np.cumsum(self._count)[:-1]]).astype(int)
        self._simple = bool(np.all(self._count == 1))
        enclosed = [
            (np.zeros((2, 3)), c.shape.radius) if isinstance(c.shape, Cable) else enclose(c.shape) for c in cells
        ]
        self._cell_ends = np.array([ends for ends, _ in enclosed]).reshape(-1, 2, 3)
        self._cell_radii = np.array([np.inf if isinstance(c.shape, HalfSpace) else radius
                                     for c, (_, radius) in zip(cells, enclosed, strict=True)])  # fmt: skip
        body = np.array([c.body for c in cells], dtype=int)
        self._element_bodies = body[self._element_cells]
        self._measure = [coal.ComputeDistance(cells[i].geometry, cells[j].geometry) for i, j, _ in elements]
        kinds = [{type(cells[i].shape), type(cells[j].shape)} for i, j, _ in elements]
        # coal 3.0.3 gives wrong depths for a sphere whose centre is inside a cylinder
        self._by_formula = np.array([kind == {Sphere, Cylinder} for kind in kinds], dtype=bool)
        of_cable = np.array([Cable in kind for kind in kinds], dtype=bool)
        self._by_cores = of_cable & np.array([kind <= {Cable, Capsule, Sphere} for kind in kinds], dtype=bool)
        self._by_plane = of_cable & np.array([HalfSpace in kind for kind in kinds], dtype=bool)
        polyhedral = np.array([c.is_polyhedral for c in cells], dtype=bool)
        self._by_segment = of_cable & polyhedral[self._element_cells].any(axis=0)
        # the hulls that cables meet, and where each cell's stands among them
        used = np.unique(self._element_cells[:, self._by_segment])
        hulls = [int(k) for k in used if polyhedral[k]]
        self._hull_of_cell = np.full(len(cells), -1)
        self._hull_of_cell[hulls] = np.arange(len(hulls))
        self._hulls = stack_hulls([cells[k].build_hull() for k in hulls]) if hulls else None
        self._special = self._by_formula | self._by_cores | self._by_plane | self._by_segment
        # cables against cylinders and cones: coal measures capsules that are stretched to the cable's length
        self._stretched = of_cable & ~self._special
        self._is_ball = np.array([isinstance(c.shape, Sphere) for c in cells], dtype=bool)
        sizes = [(getattr(c.shape, "radius", np.nan), getattr(c.shape, "length", np.nan)) for c in cells]
        self._radius, self._length = np.array(sizes, dtype=float).reshape(-1, 2).T
        # of pairs of balls, capsules and cables the sum of the radii, which is their depth where their cores meet
        rounded = np.array([isinstance(c.shape, (Sphere, Capsule, Cable)) for c in cells], dtype=bool)
        both = rounded[self._element_cells].all(axis=0)
        self._round_radii = np.where(both, self._radius[self._element_cells].sum(axis=0), np.inf)

    def place(self, poses: Array) -> Placement:
        """Place every body in the world.

        Args:
            poses: Link poses, shape (n, n_links, 4, 4).

        Returns:
            The placed bodies.
        """
        n = len(poses)
        frames = np.empty((n, self._n_solids, 4, 4))
        moving = self._frames != WORLD
        frames[:, moving] = poses[:, self._frames[moving]]
        frames[:, ~moving] = np.eye(4)
        placed = frames @ self._placements
        if not len(self._cable_frames):
            return Placement(placed, np.empty((n, 0, 2, 3)))
        A, B = self.anchors(poses)
        ends = shorten_segments(A, B, self._cable_ignore)
        return Placement(np.concatenate([placed, pose_segments(ends, B - A)], axis=1), ends)

    def anchors(self, poses: Array) -> tuple[Array, Array]:
        """Give both ends of the cables in the world [m], shape (n, n_cables, 3) each."""
        X = poses[:, self._cable_frames]
        points = np.einsum("ncsij,csj->ncsi", X[..., :3, :3], self._cable_points) + X[..., :3, 3]
        return points[:, :, 0], points[:, :, 1]

    def lower_bounds(self, placed: Placement) -> Array:
        """Bound the distance of every pair from below by that of enclosing capsules [m], shape (n, n_pairs)."""
        n = len(placed)
        if not self.pairs:
            return np.empty((n, 0))
        poses = placed.poses[:, : self._n_solids]
        ends = self._ends @ poses[..., :3, :3].transpose(0, 1, 3, 2) + poses[:, :, None, :3, 3]
        if placed.ends.shape[1]:
            ends = np.concatenate([ends, placed.ends], axis=1)
        gap = _gaps(ends, self._first, self._second)
        gap -= self._radii[self._first] + self._radii[self._second]
        if self._flat_pairs.size:
            planes = placed.poses[:, self._planes]
            heights = np.einsum("nki,nkei->nke", planes[..., :3, 2], ends[:, self._above] - planes[:, :, None, :3, 3])
            gap[:, self._flat_pairs] = heights.min(axis=2) - self._radii[self._above]
        return gap

    def measure(self, placed: Placement, samples: Indices, pairs: Indices) -> Measured:
        """Measure chosen pairs at chosen samples.

        Args:
            placed: The placed bodies.
            samples: Sample of each measurement, shape (k,).
            pairs: Pair of each measurement, shape (k,).

        Returns:
            Signed distances [m], shape (k,); witness points on both bodies in the world [m], shape (k, 2, 3);
            normals from the first to the second body, shape (k, 3).

        Raises:
            BackendError: coal failed.
        """
        if self._simple:
            return self._measure_elements(placed, samples, pairs)
        elements, bounds = self._order_elements(placed, samples, pairs)
        distances, points, normals = self._measure_elements(placed, samples, elements[:, 0])
        # a mesh is as near as the nearest of its parts: those that may be nearer than what was found
        for rank in range(1, elements.shape[1]):
            rows = np.flatnonzero(bounds[:, rank] < distances)
            if not rows.size:
                break
            found = self._measure_elements(placed, samples[rows], elements[rows, rank])
            nearer = found[0] < distances[rows]
            for kept, new in zip((distances, points, normals), found, strict=True):
                kept[rows[nearer]] = new[nearer]
        return distances, points, normals

    def _order_elements(self, placed: Placement, samples: Indices, pairs: Indices) -> tuple[Indices, Array]:
        """List the pairs of pieces of chosen pairs by their lower bounds; both (k, most), filled up with inf bounds."""
        most = int(self._count[pairs].max(initial=1))
        part = np.minimum(np.arange(most), self._count[pairs, None] - 1)
        elements = self._start[pairs, None] + part
        bounds = np.full(elements.shape, -np.inf)
        bounds[np.arange(most) >= self._count[pairs, None]] = np.inf
        rows, columns = np.nonzero((self._count[pairs, None] > 1) & np.isneginf(bounds))
        if rows.size:
            chosen = elements[rows, columns]
            ends = []
            for side in range(2):
                X, cells = (
                    placed.poses[samples[rows], self._element_bodies[side, chosen]],
                    self._element_cells[side, chosen],
                )
                own = self._cell_ends[cells] @ X[:, :3, :3].transpose(0, 2, 1) + X[:, None, :3, 3]
                cable = np.flatnonzero(self._element_bodies[side, chosen] >= self._n_solids)
                own[cable] = placed.ends[
                    samples[rows[cable]], self._element_bodies[side, chosen[cable]] - self._n_solids
                ]
                ends.append(own)
            gap = segment_distance().batch(ends[0], ends[1])[0].reshape(-1)
            # minus infinity for half-spaces, which nothing encloses
            bounds[rows, columns] = gap - self._cell_radii[self._element_cells[:, chosen]].sum(axis=0)
        order = np.argsort(bounds, axis=1, kind="stable")
        return np.take_along_axis(elements, order, 1), np.take_along_axis(bounds, order, 1)

    def _measure_elements(self, placed: Placement, samples: Indices, elements: Indices) -> Measured:
        k = len(samples)
        distances, points, normals = np.empty(k), np.empty((k, 2, 3)), np.empty((k, 3))
        special = self._special[elements]
        if not special.any():
            self._ask_coal(placed, samples, elements, distances, points, normals)
            return distances, points, normals
        for chosen, act in (
            (self._by_formula, self._measure_balls),
            (self._by_segment, self._measure_cables),
            (self._by_cores, self._measure_cores),
            (self._by_plane, self._measure_planes),
        ):
            rows = chosen[elements]
            if rows.any():
                distances[rows], points[rows], normals[rows] = act(placed, samples[rows], elements[rows])
        rest = np.flatnonzero(~special)
        found = np.empty(len(rest)), np.empty((len(rest), 2, 3)), np.empty((len(rest), 3))
        self._ask_coal(placed, samples[rest], elements[rest], *found)
        distances[rest], points[rest], normals[rest] = found
        return distances, points, normals

    def _ask_coal(
        self, placed: Placement, samples: Indices, elements: Indices, distances: Array, points: Array, normals: Array
    ) -> None:
        """Let coal measure pieces; the results are written into the arrays."""
        A, B, result = coal.Transform3s(), coal.Transform3s(), coal.DistanceResult()
        bodies = self._element_bodies[:, elements]
        X_A, X_B = placed.poses[samples, bodies[0]], placed.poses[samples, bodies[1]]
        R_A, p_A, R_B, p_B = X_A[:, :3, :3], X_A[:, :3, 3], X_B[:, :3, :3], X_B[:, :3, 3]
        measures, request = self._measure, self._request
        element = -1
        stretched = self._stretched[elements] if self._stretched.any() else None
        try:
            for i, element in enumerate(elements.tolist()):
                A.setTransform(R_A[i], p_A[i])
                B.setTransform(R_B[i], p_B[i])
                if stretched is not None and stretched[i]:
                    self._stretch(placed, int(samples[i]), element)
                result.clear()
                distance = measures[element](A, B, request, result)
                if abs(distance) > _ABSURD:
                    result.clear()
                    distance = measures[element](A, B, self._modest_request, result)
                    if abs(distance) > _ABSURD:
                        raise BackendError(f"coal found no distance for the pair {self._name(element)}")
                distances[i] = distance
                points[i, 0], points[i, 1] = result.getNearestPoint1(), result.getNearestPoint2()
                normals[i] = result.normal
        except (RuntimeError, ValueError) as error:
            raise BackendError(f"coal failed on the pair {self._name(element)}: {error}") from error
        together = distances + self._round_radii[elements] < 1e-9
        if np.any(together):
            cells = self._element_cells[:, elements[together]].T
            axes = np.stack([X_A[together, :3, 2], X_B[together, :3, 2]], axis=1)
            axes[self._is_ball[cells]] = 0.0
            way, out = points[together], normals[together]
            part_cores(way, out, self._radius[cells], axes)
            points[together], normals[together] = way, out
        lost = np.flatnonzero(~(np.abs(np.einsum("ki,ki->k", normals, normals) - 1.0) < 1e-6))
        if lost.size:
            raise BackendError(f"coal found no direction for the pair {self._name(int(elements[lost[0]]))}")

    def _name(self, element: int) -> str:
        return self.pairs[int(self._element_pair[element])].name

    def _stretch(self, placed: Placement, sample: int, element: int) -> None:
        """Give coal's capsules of cables their length at a sample."""
        for cell in self._element_cells[:, element]:
            body = self._cells[cell].body
            if body >= self._n_solids:
                a, b = placed.ends[sample, body - self._n_solids]
                self._cells[cell].geometry.halfLength = 0.5 * float(np.linalg.norm(b - a))

    def _measure_balls(self, placed: Placement, samples: Indices, elements: Indices) -> Measured:
        """Measure pairs of a sphere and a cylinder by formula."""
        cells, bodies = self._element_cells[:, elements], self._element_bodies[:, elements]
        ball_first = self._is_ball[cells[0]]
        ball, tube = np.where(ball_first, cells[0], cells[1]), np.where(ball_first, cells[1], cells[0])
        ball_radius, radius, half = self._radius[ball], self._radius[tube], 0.5 * self._length[tube]
        X_WB = placed.poses[samples, np.where(ball_first, bodies[0], bodies[1])]
        X_WT = placed.poses[samples, np.where(ball_first, bodies[1], bodies[0])]
        centre = X_WB[:, :3, 3]
        local = np.einsum("kji,kj->ki", X_WT[:, :3, :3], centre - X_WT[:, :3, 3])
        distance, touched, normal = measure_point_and_cylinder(local, radius, half)
        touched = np.einsum("kij,kj->ki", X_WT[:, :3, :3], touched) + X_WT[:, :3, 3]
        normal = np.einsum("kij,kj->ki", X_WT[:, :3, :3], normal)
        points = np.stack([touched, centre - ball_radius[:, None] * normal], axis=1)
        points[ball_first] = points[ball_first, ::-1]
        normal[ball_first] *= -1.0
        return distance - ball_radius, points, normal

    def _measure_cables(self, placed: Placement, samples: Indices, elements: Indices) -> Measured:
        """Measure cables against pieces bounded by planes."""
        if self._hulls is None:
            raise BackendError("cables meet no polyhedron here")
        cells, bodies = self._element_cells[:, elements], self._element_bodies[:, elements]
        cable_first = bodies[0] >= self._n_solids
        cable = np.where(cable_first, bodies[0], bodies[1])
        X_WP = placed.poses[samples, np.where(cable_first, bodies[1], bodies[0])]
        R, p = X_WP[:, :3, :3], X_WP[:, :3, 3]
        ends = (placed.ends[samples, cable - self._n_solids] - p[:, None]) @ R
        which = self._hull_of_cell[np.where(cable_first, cells[1], cells[0])]
        distance, solid, core, normal = measure_segments(ends[:, 0], ends[:, 1], self._hulls, which)
        radius = self._radii[cable]
        points = np.stack([solid, core - radius[:, None] * normal], axis=1) @ R.transpose(0, 2, 1) + p[:, None]
        normal = np.einsum("kij,kj->ki", R, normal)
        points[cable_first] = points[cable_first, ::-1]
        normal[cable_first] *= -1.0
        return distance - radius, points, normal

    def _find_cores(self, placed: Placement, samples: Indices, cells: Indices, bodies: Indices) -> Array:
        """Give the ends of the cores of balls, capsules and cables in the world [m], shape (k, 2, 3)."""
        half = np.where(self._is_ball[cells], 0.0, 0.5 * np.nan_to_num(self._length[cells]))
        X = placed.poses[samples, bodies]
        reach = half[:, None] * X[:, :3, 2]
        cores = np.stack([X[:, :3, 3] - reach, X[:, :3, 3] + reach], axis=1)
        cable = np.flatnonzero(bodies >= self._n_solids)
        cores[cable] = placed.ends[samples[cable], bodies[cable] - self._n_solids]
        return cores

    def _measure_cores(self, placed: Placement, samples: Indices, elements: Indices) -> Measured:
        """Measure cables against balls, capsules and each other: segments, each with a radius."""
        cells, bodies = self._element_cells[:, elements], self._element_bodies[:, elements]
        P, Q = (self._find_cores(placed, samples, cells[side], bodies[side]) for side in range(2))
        return measure_cores(P, Q, self._radius[cells].T)

    def _measure_planes(self, placed: Placement, samples: Indices, elements: Indices) -> Measured:
        """Measure cables above half-spaces: the lower end counts."""
        bodies = self._element_bodies[:, elements]
        cable_first = bodies[0] >= self._n_solids
        cable = np.where(cable_first, bodies[0], bodies[1])
        X = placed.poses[samples, np.where(cable_first, bodies[1], bodies[0])]
        found = measure_segments_and_planes(placed.ends[samples, cable - self._n_solids], X, self._radii[cable])
        found[1][cable_first] = found[1][cable_first, ::-1]
        found[2][cable_first] *= -1.0
        return found

    def smallest(self, placed: Placement, among: Indices | None = None) -> tuple[Array, Indices]:
        """Find the smallest distance over pairs at every sample, and the pair that has it.

        Pairs are measured in the order of their lower bounds until no bound is below the smallest measured distance.

        Args:
            placed: The placed bodies.
            among: Indices of the pairs that are looked at; all when None.

        Returns:
            Distances [m] and indices of pairs, shape (n,) each; inf and -1 when there is no pair.
        """
        n = len(placed)
        best, which = np.full(n, np.inf), np.full(n, -1, dtype=int)
        bounds = self.lower_bounds(placed)
        if among is not None:
            kept = np.full(bounds.shape, np.inf)
            kept[:, among] = bounds[:, among]
            bounds = kept
        order = np.argsort(bounds, axis=1)
        waiting = np.arange(n)
        for rank in range(len(self.pairs) if among is None else len(among)):
            candidates = order[waiting, rank]
            waiting = waiting[bounds[waiting, candidates] < best[waiting]]
            if not waiting.size:
                break
            pairs = order[waiting, rank]
            distances, _, _ = self.measure(placed, waiting, pairs)
            closer = distances < best[waiting]
            best[waiting[closer]], which[waiting[closer]] = distances[closer], pairs[closer]
        return best, which

    def first_below(self, placed: Placement, margin: float) -> Indices:
        """Find a pair closer than a margin [m] at every sample; -1 where there is none, shape (n,)."""
        which = np.full(len(placed), -1, dtype=int)
        if not self.pairs:
            return which
        bounds = self.lower_bounds(placed)
        # the pair with the lowest bound decides most samples that are too close
        lowest = np.argmin(bounds, axis=1)
        open_ = np.flatnonzero(bounds[np.arange(len(placed)), lowest] < margin)
        distances, _, _ = self.measure(placed, open_, lowest[open_])
        below = distances < margin
        which[open_[below]] = lowest[open_[below]]
        open_ = open_[~below]
        rows, pairs = np.nonzero(bounds[open_] < margin)
        other = pairs != lowest[open_[rows]]
        samples, pairs = open_[rows[other]], pairs[other]
        distances, _, _ = self.measure(placed, samples, pairs)
        found = np.flatnonzero(distances < margin)[::-1]  # the first one is written last
        which[samples[found]] = pairs[found]
        return which


def _gaps(ends: Array, first: Indices, second: Indices) -> Array:
    """Give distances between segments (n, n_bodies, 2, 3) of chosen pairs [m], shape (n, n_pairs)."""
    gap = np.empty((len(ends), len(first)))
    for start in range(0, len(ends), _BLOCK):  # blocks that stay in the processor's cache
        block = ends[start : start + _BLOCK]
        P, Q = block[:, first].reshape(-1, 2, 3), block[:, second].reshape(-1, 2, 3)
        gap[start : start + _BLOCK] = segment_distance().batch(P, Q)[0].reshape(len(block), -1)
    return gap
