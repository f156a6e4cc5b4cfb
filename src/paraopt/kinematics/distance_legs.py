"""Recognise a platform on six legs of which each, with its drive held, keeps one distance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.six_distances import SixDistances
from paraopt.mechanism import Base, Coincidence, Link, Mobile, Series

Array = NDArray[np.float64]


def read_six_distances(kinematics: Kinematics, X: Array) -> tuple[Mobile, SixDistances] | None:
    """Read centres, platform points and lengths of six legs, the drives having their values.

    A leg is a chain from the base whose free joints all turn about one point, fixed while the drives are, and whose end
    coincides with a point of the platform. This covers SPS, UPS and their turned kin with driven strokes, and arms that
    turn and push a rod.

    Args:
        kinematics: The mechanism's functions.
        X: Values of all variables, of which those of the drives are used; shape (n_variables,).

    Returns:
        The platform and the problem; None where the mechanism is no such platform.
    """
    mechanism = kinematics.mechanism
    mobiles = [link for link in mechanism.links if isinstance(link, Mobile)]
    constraints = mechanism.constraints
    if mechanism.planar or len(mobiles) != 1 or len(mobiles[0].motions) != 6 or len(constraints) != 6:
        return None
    platform = mobiles[0]
    places = {link.name: k for k, link in enumerate(mechanism.links)}
    tries = np.tile(X, (4, 1))
    free = [k for k, name in enumerate(mechanism.names) if name not in mechanism.active]
    tries[1:, free] = np.random.default_rng(0).uniform(-1.0, 1.0, size=(3, len(free)))
    poses = kinematics.poses(tries)
    base, ends, lengths = [], [], []
    used: set[str] = set()
    for constraint in constraints:
        if not isinstance(constraint, Coincidence):
            return None
        sides = [(constraint.link_A, constraint.point_A), (constraint.link_B, constraint.point_B)]
        if sides[0][0] == platform.name:
            sides.reverse()
        (tip, tip_point), (other, point) = sides
        chain = _chain_from_base(mechanism.links, tip)
        if other != platform.name or chain is None:
            return None
        turning = [link for link in chain if any(m.name not in mechanism.active for m in link.motions)]
        passive = [m for link in turning for m in link.motions if m.name not in mechanism.active]
        if len(passive) < 2 or any(m.kind != "angle" for m in passive) or used & {m.name for m in passive}:
            return None
        used |= {m.name for m in passive}
        centres = poses[:, [places[link.name] for link in turning], :3, 3].reshape(-1, 3)
        tips = poses[:, places[tip], :3, :3] @ np.asarray(tip_point) + poses[:, places[tip], :3, 3]
        far = np.linalg.norm(tips - centres[0], axis=1)
        if np.ptp(centres, axis=0).max() > 1e-9 * mechanism.length or np.ptp(far) > 1e-9 * mechanism.length:
            return None
        base.append(centres[0])
        ends.append(point)
        lengths.append(far[0])
    return platform, SixDistances(np.array(base), np.array(ends), np.array(lengths))


def _chain_from_base(links: Sequence[Link], name: str) -> list[Series] | None:
    known = {link.name: link for link in links}
    chain: list[Series] = []
    link = known[name]
    while isinstance(link, Series):
        chain.insert(0, link)
        link = known[link.father]
    return chain if isinstance(link, Base) and chain else None


def place_platform(kinematics: Kinematics, platform: Mobile, X: Array, R: Array, p: Array) -> Array:
    """Write a pose into the coordinates of a free link, its angles near those that it has.

    Args:
        kinematics: The mechanism's functions.
        platform: The link, with all six coordinates.
        X: Values of all variables, shape (n_variables,).
        R: Rotation, shape (3, 3).
        p: Origin [m], shape (3,).

    Returns:
        The values with the pose, shape (n_variables,).
    """
    X = X.copy()
    index = kinematics.mechanism.index
    for motion in platform.motions[:3]:
        X[index(motion.name)] = p["xyz".index(motion.axis)]
    angles = platform.motions[3:]
    columns = [index(m.name) for m in angles]
    order = "".join(m.axis for m in angles).upper()
    a, b, c = _euler(R, order)
    both = np.array([(a, b, c), (a + np.pi, np.pi - b, c + np.pi)])
    both -= 2.0 * np.pi * np.round((both - X[columns]) / (2.0 * np.pi))
    X[columns] = min(both, key=lambda angles: float(np.linalg.norm(angles - X[columns])))
    return X


def _euler(R: Array, order: str) -> tuple[float, float, float]:
    """Give the angles of three turns about the axes of the moving frame, the middle one in [-pi/2, pi/2]."""
    i, j, k = ("XYZ".index(axis) for axis in order)
    sign = 1.0 if (i, j, k) in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1.0
    b = float(np.arcsin(np.clip(sign * R[i, k], -1.0, 1.0)))
    if abs(R[i, k]) > 1.0 - 1e-12:  # only the sum of the two others counts
        turned = R @ Rotation.from_euler(order[1], b).as_matrix().T
        return float(np.arctan2(turned[(i + 2) % 3, (i + 1) % 3], turned[(i + 1) % 3, (i + 1) % 3])), b, 0.0
    a = np.arctan2(-sign * R[j, k], R[k, k])
    c = np.arctan2(-sign * R[i, j], R[i, i])
    return float(a), b, float(c)
