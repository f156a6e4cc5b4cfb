"""Postures: what tells two solutions apart, whatever angles describe them."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from paraopt.kinematics.model import Kinematics
from paraopt.mechanism import LinkClosure, Mobile, Series

Array = NDArray[np.float64]


class PostureReader:
    """Map configurations to numbers that are equal where the machine is in the same posture.

    A posture is the place of every link's origin and of every point named in a closure, the line of every joint that
    turns about one axis, and the rotation of every free link. Angles modulo 2 pi, the two pairs of angles of a
    universal joint for one direction, the spin of a leg about itself, and a stroke with its opposite on the leg turned
    by half a turn are therefore one posture.

    Args:
        kinematics: The mechanism's functions.
    """

    def __init__(self, kinematics: Kinematics) -> None:
        self.kinematics = kinematics
        mechanism = kinematics.mechanism
        place = {link.name: i for i, link in enumerate(mechanism.links)}
        points = {(i, (0.0, 0.0, 0.0)) for i in place.values()}
        for constraint in mechanism.constraints:
            for field in fields(constraint):  # type: ignore[arg-type]
                if isinstance(constraint, LinkClosure) and field.name.startswith("point_"):
                    link = getattr(constraint, f"link_{field.name[-1]}")
                    points.add((place[link], tuple(getattr(constraint, field.name))))
        ordered = sorted(points)
        self._point_links = np.array([i for i, _ in ordered])
        self._points = np.array([p for _, p in ordered])
        # about z in the plane, all lines are parallel and say nothing
        turning = [] if mechanism.planar else [
            (place[link.name], "xyz".index(angles[0].axis)) for link in mechanism.links if isinstance(link, Series)
            if len(angles := [m for m in link.motions if m.kind == "angle"]) == 1
        ]  # fmt: skip
        self._turning = np.array(turning, dtype=int).reshape(-1, 2)
        self._mobile = np.array([place[k.name] for k in mechanism.links if isinstance(k, Mobile)], dtype=int)

    def __call__(self, X: Array) -> Array:
        """Read n configurations.

        Args:
            X: Values of all variables [m or rad], shape (n, n_variables).

        Returns:
            Their postures, lengths in characteristic lengths [1], shape (n, n_numbers).
        """
        poses = self.kinematics.poses(X)
        R, p = poses[..., :3, :3], poses[..., :3, 3]
        at = self._point_links
        places = p[:, at] + np.einsum("nkij,kj->nki", R[:, at], self._points)
        axes = R[:, self._turning[:, 0], :, self._turning[:, 1]].swapaxes(0, 1) if len(self._turning) else R[:, :0, 0]
        lines = axes[..., :, None] * axes[..., None, :]
        n = len(poses)
        parts = [places.reshape(n, -1) / self.kinematics.mechanism.length, lines.reshape(n, -1)]
        return np.hstack([*parts, R[:, self._mobile].reshape(n, -1)])


def turn_towards(kinematics: Kinematics, X: Array, target: Array) -> Array:
    """Add whole turns to angles so that they come near to a target, inside their ranges where that is possible.

    Args:
        kinematics: The mechanism's functions.
        X: Values [m or rad], shape (n, n_variables).
        target: Values to be near to, shape (n_variables,).

    Returns:
        The same places with other angles, shape (n, n_variables); what they are where gauges read angles, which may
        count turns.
    """
    if kinematics.gauges:
        return X
    variables = kinematics.mechanism.variables
    angle = np.array([v.kind == "angle" for v in variables])
    low, high = (np.array([v.range[k] for v in variables]) for k in (0, 1))
    turn = 2.0 * np.pi
    near = np.where(angle, X - turn * np.round((X - target) / turn), X)
    raised = np.where(angle & (near < low - _SLACK), near + turn * np.ceil((low - near - _SLACK) / turn), near)
    return np.where(angle & (raised > high + _SLACK), raised - turn * np.ceil((raised - high - _SLACK) / turn), raised)


_SLACK = 1e-9  # round-off of an angle after several turns [rad]


def find_out_of_range(kinematics: Kinematics, X: Array) -> tuple[str, ...]:
    """Name the variables that are outside their ranges at one configuration."""
    variables = kinematics.mechanism.variables
    return tuple(
        v.name for v, x in zip(variables, X, strict=True) if not v.range[0] - _SLACK <= x <= v.range[1] + _SLACK
    )
