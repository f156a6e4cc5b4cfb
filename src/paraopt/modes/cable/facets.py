"""The wrenches that cables can make within their limits: a zonotope, told by its facets.

The set `{W t : t_min <= t <= t_max}` is bounded by pairs of parallel hyperplanes. Each is spanned by dof - 1 columns of
W; its normal n is the vector of their minors, and it is shifted until it touches the set:

    n . f <= sum_j max(0, n . W_j) t_max_j + min(0, n . W_j) t_min_j

Moments count divided by the robot's characteristic length, so that a distance to a facet is a force.

Source: Bouchard2010; Gouttefarde2010.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.modes.cable.minors import find_thin, loss, plan_minors
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.read import read_rows
from paraopt.modes.cable.wrench import cable_functions

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True)
class FacetOptions:
    """Hold how facets are computed.

    Attributes:
        flat: Share of the product of their columns' norms below which minors count as zero, so that the columns span no
            hyperplane [1].
        chunk: Number of poses worked on at once, so that their minors stay in the processor's cache.
    """

    flat: float = 1e-9
    chunk: int = 256

    def __post_init__(self) -> None:
        if not 0.0 < self.flat < 1.0:
            raise DefinitionError(f"flat is {self.flat!r}; it must be in (0, 1)")
        if self.chunk < 1:
            raise DefinitionError(f"chunk is {self.chunk!r}; it must be at least 1")


@dataclass(frozen=True, eq=False)
class Facets:
    """Hold the facets of the available wrench sets at k poses; facet and opposite facet share a column of `normals`.

    Attributes:
        normals: Unit normals in (force, moment / length), shape (k, n_pairs, dof); zero where columns are dependent.
        upper: Largest product of normal and wrench of the cables, shape (k, n_pairs) [N].
        lower: Least product, same shape.
        columns: The cables that span each pair, shape (n_pairs, dof - 1).
        length: Characteristic length by which moments are divided [m].
        largest: Largest tension of all cables [N].
    """

    normals: Array
    upper: Array
    lower: Array
    columns: Index
    length: float
    largest: float

    @property
    def is_flat(self) -> NDArray[np.bool_]:
        """Tell which pairs are none because their columns are dependent, shape (k, n_pairs)."""
        return ~np.any(self.normals, axis=2)

    def distances(self, wrench: ArrayLike) -> Array:
        """Give the signed distances of the wrench asked of the cables, `-w`, to all facets, positive inside.

        Args:
            wrench: What the cables must balance, w [N, N m], shape (k, dof), or (dof,) for all poses.

        Returns:
            Shape (k, 2 n_pairs) [N], those of the lower facets first; inf where there is no facet. At poses where the
            cables do not feel some direction, at which the set has no inside, all are negative.
        """
        levels = self.slopes(wrench) + np.hstack([-self.lower, self.upper])
        levels[np.tile(self.is_flat, 2)] = np.inf
        lost = self.is_lost
        levels[lost] = np.minimum(levels[lost], 0.0) - loss(self.largest)
        return np.asarray(levels)

    @property
    def is_lost(self) -> NDArray[np.bool_]:
        """Tell at which poses the cables do not feel some direction, shape (k,)."""
        thin = find_thin(self.upper, self.lower, self.is_flat, self.largest)
        return np.asarray(np.any(thin, axis=1) | np.all(self.is_flat, axis=1))

    def slopes(self, wrench: ArrayLike) -> Array:
        """Give what a wrench adds to the distances; shape (k, 2 n_pairs) [N], zero where there is no facet."""
        w = np.broadcast_to(scale_moments(np.asarray(wrench, dtype=float), self.length), self.normals[:, 0].shape)
        along = np.einsum("kpd,kd->kp", self.normals, w)
        return np.hstack([-along, along])  # the cables make -w


def facet_names(robot: CableRobot) -> tuple[str, ...]:
    """Name the facets by the cables that span them, in the order of `Facets.distances`."""
    sets = [" ".join(cables) for cables in combinations(robot.cables, robot.dof - 1)]
    return tuple(f"facet of {cables}, {side}" for side in ("lower", "upper") for cables in sets)


def compute_facets(robot: CableRobot, poses: ArrayLike, options: FacetOptions | None = None) -> Facets:
    """Compute the facets of the available wrench set at many poses.

    Args:
        robot: The cable robot, with at least as many cables as freedoms.
        poses: Poses, shape (k, dof) or (dof,).
        options: How.

    Returns:
        The facets.

    Raises:
        DefinitionError: There are fewer cables than freedoms: the set has no inside.
    """
    W = cable_functions(robot).both(poses)[0]
    return facets_of(W, robot.t_min, robot.t_max, robot.length_scale, options)


def facets_of(
    W: ArrayLike, t_min: ArrayLike, t_max: ArrayLike, length: float = 1.0, options: FacetOptions | None = None
) -> Facets:
    """Compute the facets of `{W t : t_min <= t <= t_max}`.

    Args:
        W: Wrench matrices [1, m], shape (k, dof, n) with n >= dof.
        t_min: Least tensions [N], shape (n,).
        t_max: Largest tensions [N], shape (n,).
        length: Length by which moments are divided [m].
        options: How.

    Returns:
        The facets.

    Raises:
        DefinitionError: There are fewer cables than freedoms.
    """
    options = options or FacetOptions()
    matrices = np.asarray(W, dtype=float)
    k, dof, n = matrices.shape
    _check_counts(dof, n)
    plan = plan_minors(dof, n)
    weights = _weights(dof, length)[:, None, None]
    low, high = (np.broadcast_to(np.asarray(v, dtype=float), (n,))[:, None] for v in (t_min, t_max))
    normals, upper, lower = np.empty((k, plan.n_pairs, dof)), np.empty((k, plan.n_pairs)), np.empty((k, plan.n_pairs))
    for first in range(0, k, options.chunk):
        part = slice(first, min(first + options.chunk, k))
        c, top, bottom = plan.evaluate(_poses_last(matrices[part], weights), low, high, options.flat)
        normals[part], upper[part], lower[part] = c.transpose(2, 1, 0), top.T, bottom.T
    return Facets(normals, upper, lower, plan.columns, length, float(np.max(high)))


def capacity_margins(
    robot: CableRobot, poses: ArrayLike, wrench: ArrayLike | None = None, options: FacetOptions | None = None
) -> Array:
    """Give the signed distance of the wrench asked of the cables to the boundary of those that they can make.

    Inside it is the distance to the nearest facet, exactly: the largest disturbance in force, or in moment over the
    characteristic length, that the cables can balance in every direction. Outside it is negative, by how far the wrench
    lies beyond the facet that it exceeds most. Where the cables do not feel some direction there is no inside: it is
    negative there, even where tensions balance this very wrench, which `check_feasibility` tells.

    Args:
        robot: The cable robot.
        poses: Poses, shape (k, dof) or (dof,).
        wrench: What the cables must balance about the platform's origin [N, N m], shape (k, dof) or (dof,); weight and
            load when None.
        options: How.

    Returns:
        The margins [N], shape (k,).

    Raises:
        DefinitionError: There are fewer cables than freedoms, or the wrench has another size or is not finite.
    """
    options = options or FacetOptions()
    W, w = cable_functions(robot).both(poses)
    k, dof, n = W.shape
    _check_counts(dof, n)
    if wrench is not None:
        w = read_rows(wrench, k, dof, "wrenches", ", ".join(robot.wrench_names))
    plan = plan_minors(dof, n)
    length = robot.length_scale
    weights = _weights(dof, length)[:, None, None]
    asked = np.ascontiguousarray(scale_moments(w, length).T)
    low, high = robot.t_min[:, None], robot.t_max[:, None]
    margins = np.empty(k)
    for first in range(0, k, options.chunk):
        part = slice(first, min(first + options.chunk, k))
        margins[part] = plan.margin(_poses_last(W[part], weights), asked[:, part], low, high, options.flat)
    lost = np.flatnonzero(np.isinf(margins))
    if lost.size:  # no hyperplane at all: the rank is below dof - 1
        U = np.linalg.svd(W[lost] / weights[:, 0])[0]
        margins[lost] = -np.abs(np.einsum("kd,dk->k", U[:, :, -1], asked[:, lost])) - loss(float(np.max(high)))
    return margins


def is_wrench_feasible(
    robot: CableRobot, poses: ArrayLike, margin: float = 0.0, options: FacetOptions | None = None
) -> NDArray[np.bool_]:
    """Tell at which poses tensions within the limits hold weight and load, with a margin [N]; shape (k,)."""
    return np.asarray(capacity_margins(robot, poses, None, options) >= margin)


def has_wrench_closure(robot: CableRobot, poses: ArrayLike, options: FacetOptions | None = None) -> NDArray[np.bool_]:
    """Tell at which poses positive tensions, however large, can balance every wrench; shape (k,)."""
    W = cable_functions(robot).both(poses)[0]
    facets = facets_of(W, 0.0, 1.0, robot.length_scale, options)
    levels = np.minimum(np.where(facets.is_flat, np.inf, facets.upper), np.where(facets.is_flat, np.inf, -facets.lower))
    # the columns have a size of one: below this, round-off decides
    return np.asarray((np.min(levels, axis=1) > 1e-12) & ~facets.is_lost)


# --- Gradients


def facet_gradients(robot: CableRobot, poses: Array, facets: Facets, chosen: Index) -> Array:
    """Give the derivatives of distances to facets, under weight and load, with respect to the pose, exactly.

    A unit normal n turns so that it stays square to its columns S. With t the extreme tensions of the other cables, and
    those of S balancing what is left, `tau_S = -pinv(W_S) (W t + w)`, the distance has the derivative
    `n . (dW tau + dw)`.

    Args:
        robot: The cable robot.
        poses: Poses, shape (k, dof).
        facets: The facets there.
        chosen: Facets asked for at each pose, as columns of `Facets.distances`, shape (k, m).

    Returns:
        Shape (k, m, dof) [N/m, N/rad]; zero for pairs that are flat.
    """
    functions = cable_functions(robot)
    W, w = functions.both(poses)
    dW, dw = functions.derivatives(poses)
    k, m = chosen.shape
    dof, length = robot.dof, facets.length
    W, dW, w, dw = (_scale_moments_along(v, length) for v in (W, dW, w, dw))
    pairs, is_upper = chosen % facets.columns.shape[0], chosen >= facets.columns.shape[0]
    rows: Index = np.arange(k)[:, None]
    normal = np.where(is_upper[:, :, None], 1.0, -1.0) * facets.normals[rows, pairs]
    columns: Index = facets.columns[pairs]  # (k, m, dof - 1)
    pull = np.einsum("kmd,kdn->kmn", normal, W)
    tau: Array = np.where(pull > 0.0, np.asarray(robot.t_max), np.asarray(robot.t_min))
    np.put_along_axis(tau, columns, 0.0, axis=2)
    left = np.einsum("kdn,kmn->kmd", W, tau) + w[:, None]
    W_S = np.take_along_axis(W[:, None].repeat(m, axis=1), columns[:, :, None, :].repeat(dof, axis=2), axis=3)
    held = -np.einsum("kmsd,kmd->kms", np.linalg.pinv(W_S), left)
    np.put_along_axis(tau, columns, held, axis=2)
    moved = np.einsum("kdnx,kmn->kmdx", dW, tau) + dw[:, None]
    return np.einsum("kmd,kmdx->kmx", normal, moved)


def capacity_gradients(robot: CableRobot, poses: ArrayLike) -> tuple[Array, Array]:
    """Give the capacity margins under weight and load and their derivatives with respect to the pose.

    Returns:
        Shapes (k,) [N] and (k, dof) [N/m, N/rad]. Where two facets are equally near, it is the derivative of one.
    """
    points = robot.check_poses(poses)
    facets = compute_facets(robot, points)
    levels = facets.distances(cable_functions(robot).wrench(points))
    nearest = np.argmin(levels, axis=1)[:, None]
    margins = np.take_along_axis(levels, nearest, axis=1)[:, 0]
    return margins, facet_gradients(robot, points, facets, nearest)[:, 0]


def _check_counts(dof: int, n: int) -> None:
    if n < dof:
        raise DefinitionError(
            f"{n} cables hold {dof} freedoms: the wrenches that they can make have no inside and no facets; such a "
            "robot hangs, so ask for its equilibrium and its tensions there"
        )


def scale_moments(wrenches: Array, length: float) -> Array:
    """Divide the moments by a length; wrenches have shape (..., dof)."""
    return np.asarray(wrenches / _weights(wrenches.shape[-1], length))


def _scale_moments_along(values: Array, length: float) -> Array:
    """Divide the moments by a length where wrenches stand along the second axis, shape (k, dof, ...)."""
    weights = _weights(values.shape[1], length)
    return np.asarray(values / weights.reshape(1, -1, *[1] * (values.ndim - 2)))


def _poses_last(W: Array, weights: Array) -> Array:
    """Divide the moments by a length, and let the poses be the last axis, along which all is computed side by side."""
    return np.ascontiguousarray(W.transpose(1, 2, 0)) / weights


def _weights(dof: int, length: float) -> Array:
    return np.array([1.0, 1.0, length] if dof == 3 else [1.0, 1.0, 1.0, length, length, length])
