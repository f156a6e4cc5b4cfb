"""What holds in general: ranks at configurations around one, to tell a singular place from the machine itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.model import Kinematics
from paraopt.kinematics.ranks import RANK_TOLERANCE, compute_rank, null_space
from paraopt.kinematics.solve import solve_closure

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SampleOptions:
    """Choose the configurations that stand for the general case.

    Attributes:
        count: Number of configurations.
        step: Length of the motion that leads from one to the next, in characteristic lengths and radians.
        seed: Seed of their directions.

    Raises:
        DefinitionError: The count is below 1, or the step is not a finite number above 0.
    """

    count: int = 6
    step: float = 0.3
    seed: int = 0

    def __post_init__(self) -> None:
        if not (isinstance(self.count, int) and self.count >= 1):
            raise DefinitionError(f"count of samples is {self.count!r}; it must be a whole number above 0")
        if not (np.isfinite(self.step) and self.step > 0):
            raise DefinitionError(f"step of the samples is {self.step!r}; it must be finite and above 0")


def sample_configurations(
    kinematics: Kinematics, configuration: Configuration, options: SampleOptions | None = None
) -> Array:
    """Walk away from a configuration in random directions that the closures allow.

    Args:
        kinematics: The mechanism's functions.
        configuration: Where to start.
        options: Number, step and seed.

    Returns:
        Closed configurations [m or rad], the first one being the given, shape (n, n_variables); n is smaller than asked
        when some walks could not be closed. Joint ranges are not looked at.
    """
    options = options or SampleOptions()
    random = np.random.default_rng(options.seed)
    scale = kinematics.graph.variable_scale
    found = [configuration.X.copy()]
    modest = replace(kinematics.options, step_limit=0.2)
    free = np.ones(len(scale))
    here = np.tile(configuration.X, (options.count, 1))
    for _ in range(2):  # a second step leaves places from which all first steps look alike
        (E,) = kinematics.functions.scaled_jacobian.batch(here)
        for k, matrix in enumerate(E):
            V = null_space(matrix)
            direction = random.normal(size=V.shape[1])
            length = max(float(np.linalg.norm(direction)), 1e-300)
            here[k] += scale * (V @ (direction * options.step / length))
        closed = solve_closure(kinematics.functions, here, free, modest)
        here = closed.X
        found += list(closed.X[closed.converged])
        here[~closed.converged] = configuration.X
    return np.array(found)


@dataclass(frozen=True, eq=False)
class GeneralState:
    """Hold what holds in general around a configuration.

    Attributes:
        X: The configurations that were looked at, the given one first, shape (n, n_variables).
        ranks: Largest rank of the scaled "E", "M", "N", "K", "[N K]" and "[M N]".
        internal: Internal mobility: motions of passive variables alone, nothing else moving.
        idle: Names of the variables that take part in internal mobilities.
    """

    X: Array
    ranks: Mapping[str, int]
    internal: int
    idle: tuple[str, ...]


def find_general_state(
    kinematics: Kinematics, configuration: Configuration, options: SampleOptions | None = None
) -> GeneralState:
    """Compute ranks at configurations around one and keep the largest.

    Args:
        kinematics: The mechanism's functions.
        configuration: Where to start.
        options: Choice of the configurations.

    Returns:
        Ranks and internal mobility of the general case.
    """
    X = sample_configurations(kinematics, configuration, options)
    (E,) = kinematics.functions.scaled_jacobian.batch(X)
    blocks = split_columns(kinematics, E)
    ranks = {
        name: max(compute_rank(matrix, whole=whole).value for matrix, whole in zip(stack, E, strict=True))
        for name, stack in blocks.items()
    }
    N = blocks["N"]
    internal = N.shape[2] - ranks["N"]
    passive = kinematics.mechanism.passive
    idle: tuple[str, ...] = ()
    if internal:
        spans = np.array([np.linalg.norm(_smallest_directions(matrix, internal), axis=1) for matrix in N
                          if compute_rank(matrix, whole=E[0]).value == ranks["N"]])  # fmt: skip
        # a variable takes part if it does anywhere; what is zero is zero to round-off over the smallest singular value
        idle = tuple(n for n, share in zip(passive, np.max(spans, axis=0), strict=True) if share > 1e-6)
    return GeneralState(X, ranks, internal, idle)


def split_columns(kinematics: Kinematics, E: Array) -> dict[str, Array]:
    """Cut scaled Jacobians (n, n_equations, n_variables) into the matrices whose ranks tell the state."""
    mechanism = kinematics.mechanism
    a, split = len(mechanism.active), E.shape[2] - len(mechanism.operational)
    return {
        "E": E,
        "M": E[:, :, :a],
        "N": E[:, :, a:split],
        "K": E[:, :, split:],
        "[N K]": E[:, :, a:],
        "[M N]": E[:, :, :split],
    }


def useful_motions(kinematics: Kinematics, E: Array, internal: int, tolerance: float = RANK_TOLERANCE) -> Array:
    """Give an orthonormal basis of the motions that the closures allow, internal mobilities left out.

    Args:
        kinematics: The mechanism's functions.
        E: Scaled Jacobian at a closed configuration [1], shape (n_equations, n_variables).
        internal: Number of internal mobilities.
        tolerance: See `compute_rank`.

    Returns:
        Scaled motions [1], shape (n_variables, useful mobility).
    """
    V = null_space(E, tolerance)
    if not internal or not V.shape[1]:
        return V
    a, p = len(kinematics.mechanism.active), len(kinematics.mechanism.passive)
    U = np.zeros((len(V), internal))
    U[a : a + p] = _smallest_directions(E[:, a : a + p], internal)
    # what is left of V when the internal motions are taken out of it
    left, _, _ = np.linalg.svd(V - U @ (U.T @ V), full_matrices=False)
    return left[:, : V.shape[1] - internal]


def _smallest_directions(matrix: Array, count: int) -> Array:
    """Give the right singular vectors of the smallest singular values, shape (n_columns, count)."""
    if not matrix.shape[0]:
        return np.eye(matrix.shape[1])[:, :count]
    vectors = np.linalg.svd(matrix, full_matrices=True)[2]
    return vectors[matrix.shape[1] - count :].T
