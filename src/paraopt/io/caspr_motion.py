"""Trajectories of CASPR: points with times, joined as CASPR joins them.

Positions and planar angles are joined coordinate by coordinate. The orientation of a spatial platform turns from one
point to the next about one axis, with the same time law from 0 to the angle between them, at rest at every point (the
linear law apart); its velocities in the file must therefore be zero. Lengths are metres, angles radians, times seconds.

Conventions read from CASPR's own sources: the first point stands at time 0 whatever it says; `relative` times count
from the point before, `absolute` ones from the start.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BPoly, PPoly
from scipy.spatial.transform import Rotation

from paraopt.errors import DefinitionError
from paraopt.io.xml_tree import Element

Array = NDArray[np.float64]

DEGREES = {
    "linear_spline_trajectory": 1,
    "cubic_spline_trajectory": 3,
    "quintic_spline_trajectory": 5,
    "cubic_spline_average_velocity_trajectory": 3,
    "parabolic_blend_trajectory": 2,
}
"""Degree of the pieces, by the name of the element."""


@dataclass(frozen=True, eq=False)
class CasprTrajectory:
    """Give the pose in time.

    Attributes:
        id: Its name in the file.
        kind: How points are joined: linear_spline, cubic_spline, quintic_spline, cubic_spline_average_velocity or
            parabolic_blend.
        names: Coordinates of the pose, or y1, y2, ... of an operational space.
        times: Times of the points [s], increasing from 0, shape (n,).
        points: Values at the points [m or rad], shape (n, m).
        velocities: First derivatives at the points, where the kind has them, shape (n, m).
        accelerations: Second derivatives at the points, where the kind has them, shape (n, m).
        blends: Time at each end of a piece that is a parabola [s], shape (n - 1,).
        time_step: Step at which CASPR samples it [s].
        turns: Whether the last three coordinates are angles x-y-z of an orientation.
    """

    id: str
    kind: str
    names: tuple[str, ...]
    times: Array
    points: Array
    velocities: Array
    accelerations: Array
    blends: Array
    time_step: float
    turns: bool

    def __post_init__(self) -> None:
        for key in ("times", "points", "velocities", "accelerations", "blends"):
            values = np.array(getattr(self, key), dtype=float)
            values.flags.writeable = False
            object.__setattr__(self, key, values)

    @property
    def duration(self) -> float:
        """Give the length in time [s]."""
        return float(self.times[-1])

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate the pose or its derivatives.

        Args:
            t: Times in [0, duration] [s], a number or shape (n,).
            order: 0 for values, 1 for velocities, 2 for accelerations. Where the kind jumps, the value after.

        Returns:
            Shape (m,) for a number, (n, m) for an array. Angles of a spatial orientation are in (-pi, pi], the second
            in [-pi/2, pi/2], whatever the file writes.

        Raises:
            DefinitionError: A time is outside, the order is another, or a velocity is asked where the second angle of
                an orientation is a right one: there the others have none.
        """
        times = np.asarray(t, dtype=float)
        if order not in (0, 1, 2):
            raise DefinitionError(f"order is {order!r}; it must be 0, 1 or 2")
        slack = 1e-9 * max(self.duration, 1.0)
        if times.size and not (np.min(times) >= -slack and np.max(times) <= self.duration + slack):
            raise DefinitionError(
                f"time is in [{np.min(times)}, {np.max(times)}] s; trajectory {self.id!r} lasts from 0 to "
                f"{self.duration:g} s"
            )
        flat = np.clip(np.atleast_1d(times), 0.0, self.duration)
        values = np.asarray(self._pieces.derivative(order)(flat) if order else self._pieces(flat))
        if self.turns:
            values[:, -3:] = self._angles(flat, order)
        return values if times.ndim else values[0]

    @cached_property
    def _pieces(self) -> BPoly | PPoly:
        return _join(self.kind, self.times, self.points, self.velocities, self.accelerations, self.blends)

    @cached_property
    def _progress(self) -> BPoly | PPoly:
        """Number of the piece and what part of its turn is done, in time."""
        steps, rest = np.arange(float(len(self.times)))[:, None], np.zeros((len(self.times), 1))
        return _join(self.kind, self.times, steps, rest, rest, self.blends)

    def _angles(self, times: Array, order: int) -> Array:
        turned = Rotation.from_euler("XYZ", np.array(self.points[:, -3:]))  # scipy wants to own them
        ways = (turned[:-1].inv() * turned[1:]).as_rotvec()  # in axes of the platform
        k = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(ways) - 1)
        part = self._progress(times)[:, 0] - k
        angles = angles_xyz(turned[k] * Rotation.from_rotvec(part[:, None] * ways[k]))
        if order == 0:
            return angles
        w = self._progress.derivative(1)(times) * ways[k]
        _, b, g = angles.T
        if np.any((np.abs(np.cos(b)) < 1e-9) & np.any(w != 0.0, axis=1)):
            raise DefinitionError(
                f"trajectory {self.id!r} turns through a second angle of pi/2, where rates have no value"
            )
        rates = _rates(b, g, w)
        if order == 1:
            return rates
        # S q' = w, so S q'' = w' - S' q', S as in `_rates`
        da, db, dg = rates.T
        sb, cb, sg, cg = np.sin(b), np.cos(b), np.sin(g), np.cos(g)
        drift = np.column_stack(
            [
                (-sb * cg * db - cb * sg * dg) * da + cg * dg * db,
                (sb * sg * db - cb * cg * dg) * da - sg * dg * db,
                cb * db * da,
            ]
        )
        return _rates(b, g, self._progress.derivative(2)(times) * ways[k] - drift)


def angles_xyz(turns: Rotation) -> Array:
    """Give the angles of R = Rx Ry Rz [rad], shape (..., 3); the third is 0 where it cannot be told from the first."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Gimbal lock", category=UserWarning)
        return np.asarray(turns.as_euler("XYZ"))


def _rates(b: Array, g: Array, w: Array) -> Array:
    """Solve S q' = w, the angular velocity in axes of the platform, for the rates of angles x-y-z."""
    da = (np.cos(g) * w[:, 0] - np.sin(g) * w[:, 1]) / np.where(np.cos(b) == 0.0, 1.0, np.cos(b))
    db = np.sin(g) * w[:, 0] + np.cos(g) * w[:, 1]
    return np.column_stack([da, db, w[:, 2] - np.sin(b) * da])


def _join(kind: str, times: Array, x: Array, v: Array, a: Array, blends: Array) -> BPoly | PPoly:
    degree = DEGREES[f"{kind}_trajectory"]
    if degree != 2:
        given = [x, v, a][: (degree + 1) // 2]
        return BPoly.from_derivatives(times, np.stack(given, axis=1))
    # a parabola, a straight line, a parabola
    spans = np.diff(times)[:, None]
    bend = np.diff(x, axis=0) / (blends[:, None] * (spans - blends[:, None]))
    first, rate = x[:-1] + bend * blends[:, None] ** 2 / 2, bend * blends[:, None]
    last = x[1:] - bend * blends[:, None] ** 2 / 2
    none = np.zeros_like(bend)
    rows = [[bend / 2, none, x[:-1]], [none, rate, first], [-bend / 2, rate, last]]
    shape = (3, 3 * len(bend), x.shape[1])
    coefficients = np.array(rows).transpose(1, 2, 0, 3).reshape(shape)
    inner = np.column_stack([times[:-1], times[:-1] + blends, times[1:] - blends]).ravel()
    return PPoly(coefficients, np.append(inner, times[-1]))


def read_trajectory_element(
    element: Element, letter: str, names: tuple[str, ...] | None, turn: Callable[[Array, Element], Array], turns: bool
) -> CasprTrajectory:
    """Read a trajectory.

    Args:
        element: The element.
        letter: q or y: how the values are called.
        names: The coordinates after turning; y1, y2, ... as many as there are when None.
        turn: Turns values as written (order 0) into coordinates; the element is for messages.
        turns: Whether the last three coordinates are an orientation.

    Returns:
        The trajectory.

    Raises:
        DefinitionError: A number is missing or wrong, times do not increase, a blend is too long, or an orientation is
            to turn at a point; file, line and element are named.
    """
    kind = element.tag.removesuffix("_trajectory")
    nodes = element.child("points").all("point")
    if len(nodes) < 2:
        raise element.error(f"has {len(nodes)} points; it needs at least two")
    definition = element.attribute("time_definition")
    if definition not in ("relative", "absolute"):
        raise element.error(f"time_definition is {definition!r}; it must be relative or absolute")
    step = float(element.vector(1, "time_step")[0]) if "time_step" in element.attributes else np.nan
    times, blends = [0.0], list[float]()
    points, rates, bends = list[Array](), list[Array](), list[Array]()
    blend = float(element.vector(1, "blend_time_default")[0]) if kind == "parabolic_blend" else 0.0
    needs = {"cubic_spline": 1, "quintic_spline": 2}.get(kind, 0)
    for i, node in enumerate(nodes):
        points.append(turn(node.child(letter).vector(), node.child(letter)))
        width = len(points[0])
        if len(points[-1]) != width or (names is not None and width != len(names)):
            raise node.child(letter).error(f"has {len(points[-1])} values; {len(names) if names else width} are needed")
        ends = kind == "cubic_spline_average_velocity" and i in (0, len(nodes) - 1)
        for order, (store, suffix) in enumerate(((rates, "_dot"), (bends, "_ddot")), start=1):
            values = np.zeros(width)
            if order <= needs or (ends and order == 1):
                node_of = node.child(letter + suffix)
                values = _derivative(turn, node_of, width, turns)
            store.append(values)
        if i:
            time = float(node.vector(1, "time")[0])
            times.append(time if definition == "absolute" else times[-1] + time)
            blends.append(float(node.vector(1, "blend_time")[0]) if node.attributes.get("blend_time") else blend)
            span = times[-1] - times[-2]
            if not span >= 1e-9:
                raise node.error(f"stands at {times[-1]:g} s, not after the point before at {times[-2]:g} s")
            if kind == "parabolic_blend" and not 0.0 < 2 * blends[-1] < span:
                raise node.error(f"has a blend time of {blends[-1]:g} s; it must be above 0 and twice below {span:g} s")
    x, v, t = np.array(points), np.array(rates), np.array(times)
    if kind == "cubic_spline_average_velocity":
        slopes = np.diff(x, axis=0) / np.diff(t)[:, None]
        v[1:-1] = (slopes[:-1] + slopes[1:]) / 2
        if turns:
            v[:, -3:] = 0.0  # an orientation stands at every point
    names = tuple(f"y{i + 1}" for i in range(x.shape[1])) if names is None else names
    return CasprTrajectory(
        element.attribute("id"), kind, names, t, x, v, np.array(bends), np.array(blends), step, turns
    )


def _derivative(turn: Callable[[Array, Element], Array], node: Element, width: int, turns: bool) -> Array:
    values = node.vector()
    if turns:
        if len(values) != width:
            raise node.error(f"has {len(values)} values; {width} are needed")
        if np.any(values[-3:] != 0.0):
            raise node.error("the orientation is to turn at a point; CASPR joins orientations at rest only")
        return values
    return turn(values, node)
