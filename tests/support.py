"""What several test files share: numerical derivatives, machines that are built once, and closed configurations.

Tests import it as `from support import ...`; pytest puts this folder on the path.
"""

from __future__ import annotations

import functools
import inspect
import typing
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import paraopt as po

Array = NDArray[np.float64]


# --- Derivatives


def finite_difference(function: Callable[[Array], ArrayLike], x: ArrayLike, step: float | ArrayLike = 1e-3) -> Array:
    """Differentiate numerically by the five-point rule.

    The error is about `step^4` times the fifth derivative over 30, plus `1.5 e / step` where e is the noise of the
    function's values: with a step of 1e-3 and smooth functions of order one, some 1e-12.

    Args:
        function: From an array of shape (n,) to an array of any shape.
        x: Where to differentiate, shape (n,).
        step: Distance between the points, in the units of x; one number or one for each component.

    Returns:
        The derivative, of the shape of the function's values with one more axis, of size n, at the end.
    """
    x = np.array(x, dtype=float)
    steps = np.broadcast_to(np.asarray(step, dtype=float), x.shape)
    columns = []
    for k, h in enumerate(steps):
        value = {}
        for i in (-2, -1, 1, 2):
            moved = x.copy()
            moved[k] += i * h
            value[i] = np.array(function(moved), dtype=float)
        columns.append((8.0 * (value[1] - value[-1]) - (value[2] - value[-2])) / (12.0 * h))
    return np.stack(columns, axis=-1)


def assert_derivative(
    derivative: ArrayLike,
    function: Callable[[Array], ArrayLike],
    x: ArrayLike,
    *,
    step: float | ArrayLike = 1e-3,
    tolerance: float = 1e-8,
) -> None:
    """Compare a derivative with finite differences of the function it belongs to.

    Args:
        derivative: What is claimed, of the shape that `finite_difference` gives.
        function: The function.
        x: Where, shape (n,).
        step: See `finite_difference`.
        tolerance: Largest allowed difference, relative to the largest component, and to 1 where all are smaller.
    """
    claimed, measured = np.asarray(derivative, dtype=float), finite_difference(function, x, step)
    assert claimed.shape == measured.shape, f"shape {claimed.shape}, by finite differences {measured.shape}"
    bound = tolerance * max(1.0, float(np.max(np.abs(measured), initial=0.0)))
    error = np.abs(claimed - measured)
    worst = np.unravel_index(int(np.argmax(error)), error.shape) if error.size else ()
    assert np.all(error <= bound), (
        f"component {tuple(int(i) for i in worst)}: claimed {claimed[worst]:.12g}, by finite differences "
        f"{measured[worst]:.12g}, error {error[worst]:.3g} above {bound:.3g}"
    )


# --- Machines, built once for all tests: their compiled functions are the costly part


@functools.cache
def raf_robot() -> po.Robot:
    """Give the RAF robot of the library; do not change it."""
    return po.robots.raf()


@functools.cache
def five_bar_robot() -> po.Robot:
    """Give the five-bar of the library; do not change it."""
    return po.robots.five_bar()


def two_rpr(base: float = 4.0, **options: Any) -> po.Mechanism:
    """Describe a planar 2-RPR: two legs of variable length, hinged on the ground and at a common point.

    The serial singularities are legs of no length, the parallel ones legs along one line.
    """
    return po.Mechanism(
        name="2-RPR",
        planar=True,
        links=[
            po.Base(),
            po.Series("leg 1", "base", at=(0, 0), joint=po.Revolute("phi1")),
            po.Series("rod 1", "leg 1", joint=po.Prismatic("rho1", axis="x")),
            po.Series("leg 2", "base", at=(base, 0), joint=po.Revolute("phi2")),
            po.Series("rod 2", "leg 2", joint=po.Prismatic("rho2", axis="x")),
            po.Mobile("tip", coordinates=("x", "y")),
        ],
        closures=[po.Coincidence("rod 1", (0, 0), "tip", (0, 0)), po.Coincidence("rod 2", (0, 0), "tip", (0, 0))],
        active=("rho1", "rho2"),
        operational=("x", "y"),
        **options,
    )


def two_rpr_values(x: float, y: float, base: float = 4.0) -> dict[str, float]:
    """Close the loops of `two_rpr` by hand, legs pulled out."""
    return {
        "rho1": float(np.hypot(x, y)),
        "rho2": float(np.hypot(x - base, y)),
        "phi1": float(np.arctan2(y, x)),
        "phi2": float(np.arctan2(y, x - base)),
        "x": x,
        "y": y,
    }


def vector(mechanism: po.Mechanism, values: Mapping[str, float]) -> Array:
    """Write values by name in the order of the mechanism's variables."""
    return np.array([values[name] for name in mechanism.names])


@functools.cache
def raf_configurations(count: int = 12, seed: int = 0) -> tuple[po.Configuration, ...]:
    """Solve the RAF at random poses of the middle of its workspace, on the branch of its home."""
    robot = raf_robot()
    random = np.random.default_rng(seed)
    poses = random.uniform((-0.06, -0.06, 0.45), (0.06, 0.06, 0.56), size=(count, 3))
    return tuple(
        robot.kinematics.inverse(dict(zip("xyz", p, strict=True)), start=robot.home_configuration).configuration
        for p in poses.tolist()
    )


# --- The library


def library_robots() -> list[str]:
    """List the names of the functions of `paraopt.robots` that build a robot."""
    built = {n: getattr(po.robots, n) for n in po.robots.__all__}
    return [n for n, f in built.items() if inspect.isfunction(f) and typing.get_type_hints(f).get("return") is po.Robot]


@functools.cache
def library_robot(name: str) -> po.Robot:
    """Build a robot with its defaults; the virtual machine spares the compiler 25 machines. Do not change it."""
    robot = getattr(po.robots, name)()
    assert isinstance(robot, po.Robot)
    robot.__dict__["kinematics"] = po.Kinematics(robot.mechanism, "virtual machine")
    return robot
