"""The iteration that closes the loops, as one compiled function: no Python between its steps, nor between samples."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import partial

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.errors import BackendError
from paraopt.kinematics.c_source import generate_newton
from paraopt.kinematics.codegen import Backend, load_library

Array = NDArray[np.float64]


class NewtonLoop:
    """Run the damped Newton iteration of `solve_closure` on a batch, where a C compiler exists.

    Args:
        opening: X to the scaled residual, and to the entries of the scaled Jacobian that are not zero by structure.
        correcting: (entries, residual, free, damping) to the damped Newton step, scaled, by the four operations alone.
        scale: Scale of each variable [m or rad], shape (n_variables,).
        backend: See `CompiledFunction`.

    Raises:
        BackendError: `backend` is "compiled" and there is no compiler, or the compilation failed.
    """

    def __init__(self, opening: ca.Function, correcting: ca.Function, scale: Array, backend: Backend = "auto") -> None:
        self.name = "paraopt_newton"
        self._entry = None
        generate = partial(_generate, scale=scale.tolist(), name=self.name)
        library = load_library([opening, correcting], backend, self.name, generate, wide=True)
        if library is not None:
            self._entry = getattr(library, f"{self.name}_batch")
            self._entry.argtypes = [ctypes.c_longlong, ctypes.c_void_p]

    @property
    def is_compiled(self) -> bool:
        """Tell whether the loop can be run."""
        return self._entry is not None

    def __call__(
        self, X: Array, free: Array, tolerance: float, iterations: int, damping: float, step_limit: float
    ) -> tuple[Array, Array, Array]:
        """Close the loops from n starts.

        Args:
            X: Starts [m or rad], shape (n, n_variables).
            free: 1 for the variables that may move, 0 for the others; shape (n_variables,).
            tolerance: Bound on the scaled residual [1].
            iterations: Bound on the number of iterations.
            damping: First damping [1].
            step_limit: Largest change of a variable in one iteration, in characteristic lengths or radians.

        Returns:
            The points of smallest residual, shape (n, n_variables); their residuals, inf where a start is not finite,
            shape (n,); and the numbers of iterations, shape (n,).

        Raises:
            BackendError: Nothing is compiled, or the memory did not suffice.
        """
        if self._entry is None:
            raise BackendError(f"{self.name} is not compiled here; solve_closure runs without it")
        n, width = X.shape
        # one room for everything, since asking an array for its place costs as much as a small solve
        room = np.empty(width + 4 + n * (width + 2))
        room[:width], room[width : width + 4] = free, (tolerance, iterations, damping, step_limit)
        best = room[width + 4 : -2 * n or None].reshape(n, width)
        best[...] = X
        flag = self._entry(n, room.ctypes.data)
        if flag != 0:
            raise BackendError(f"compiled {self.name} returned {flag}")
        residual, count = room[width + 4 + n * width :].reshape(2, n)
        return best, residual, count


def _generate(functions: Sequence[ca.Function], scale: Sequence[float], name: str) -> str:
    opening, correcting = functions
    return generate_newton(opening, correcting, scale, name)
