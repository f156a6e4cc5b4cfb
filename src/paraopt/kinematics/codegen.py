"""Compiled functions: generated C, cached on disk, where a compiler exists; CasADi's virtual machine otherwise."""

from __future__ import annotations

import atexit
import ctypes
import functools
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from paraopt.errors import BackendError, DefinitionError
from paraopt.kinematics import c_source
from paraopt.kinematics.c_source import generate_source

logger = logging.getLogger("paraopt")

Backend = Literal["auto", "compiled", "virtual machine"]
Array = NDArray[np.float64]

_FLAGS = ("-fPIC", "-shared", "-fno-math-errno", "-ffp-contract=off")


def find_compiler() -> str | None:
    """Find a C compiler: the one named by `PARAOPT_CC` or `CC`, else cc, gcc or clang; None when there is none.

    `PARAOPT_COMPILE=0` in the environment hides it.
    """
    if os.environ.get("PARAOPT_COMPILE", "1") == "0":
        return None
    for candidate in (os.environ.get("PARAOPT_CC"), os.environ.get("CC"), "cc", "gcc", "clang"):
        if candidate and (path := shutil.which(candidate)):
            return path
    return None


def cache_folder() -> Path:
    """Give the folder of compiled functions: `PARAOPT_CACHE`, else the user's cache folder, else a temporary one."""
    home = os.environ.get("XDG_CACHE_HOME")
    if stated := os.environ.get("PARAOPT_CACHE"):
        folder = Path(stated)
    else:
        folder = (Path(home) if home else Path("~/.cache").expanduser()) / "paraopt"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError as error:
        logger.info("cache folder %s cannot be used (%s)", folder, error)
    return _temporary_folder()


@functools.cache
def _temporary_folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="paraopt-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@functools.cache
def _compiler_identity(compiler: str) -> str:
    done = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False)
    return f"{compiler}|{done.stdout.splitlines()[:1]}|{platform.machine()}|{platform.system()}"


class CompiledFunction:
    """Evaluate a CasADi function on NumPy arrays, one point or a batch at a time.

    Arrays are row-major, so that a batch of (n, rows, columns) needs no copy. Calls at one point share buffers: give
    each thread its own by `bind`. Batches may run side by side.

    Args:
        function: A function of SX or MX expressions; inputs and outputs are treated as dense.
        backend: "auto" compiles when a compiler is found, "compiled" insists on it, "virtual machine" never does.

    Raises:
        BackendError: `backend` is "compiled" and there is no compiler, or the compilation failed.
    """

    def __init__(self, function: ca.Function, backend: Backend = "auto") -> None:
        self._start(function, load_library([function], backend))

    @classmethod
    def together(cls, functions: Sequence[ca.Function], backend: Backend = "auto") -> list[CompiledFunction]:
        """Compile several functions into one library: what they share is compiled once.

        Args:
            functions: Functions of different names.
            backend: As for one function.

        Returns:
            The compiled functions in the same order.
        """
        library = load_library(functions, backend)
        made = []
        for function in functions:
            compiled = cls.__new__(cls)
            compiled._start(function, library)
            made.append(compiled)
        return made

    def _start(self, function: ca.Function, library: ctypes.CDLL | None) -> None:
        self.name = function.name()
        self.in_shapes = [tuple(function.size_in(i)) for i in range(function.n_in())]
        self.out_shapes = [tuple(function.size_out(i)) for i in range(function.n_out())]
        self._in_sizes = [r * c for r, c in self.in_shapes]
        self._out_sizes = [r * c for r, c in self.out_shapes]
        self._batch_entry = self._point_entry = None
        if library is not None:
            self._batch_entry = getattr(library, f"{self.name}_batch")
            self._batch_entry.argtypes = [ctypes.c_longlong, *[ctypes.c_void_p] * 4]
            self._point_entry = getattr(library, f"{self.name}_point")
            self._point_entry.argtypes = [ctypes.c_void_p]
            return
        self._function = _make_full(_row_major(function))
        self._chunk = 64
        self._single = self._function.buffer()
        self._mapped = self._function.map(self._chunk)
        self._many = self._mapped.buffer()

    @property
    def is_compiled(self) -> bool:
        """Tell whether generated C is used."""
        return self._batch_entry is not None

    def __call__(self, *arguments: Any) -> tuple[Array, ...]:
        """Evaluate at one point.

        Args:
            arguments: One array for each input, of the input's shape or flat.

        Returns:
            One array of shape (rows, columns) for each output; columns of width 1 come as vectors.
        """
        bound = self._bound
        if len(arguments) != len(bound.inputs):
            raise DefinitionError(f"{self.name} takes {len(bound.inputs)} inputs; {len(arguments)} were given")
        for k, (buffer, argument) in enumerate(zip(bound.inputs, arguments, strict=True)):
            array = np.asarray(argument, dtype=float)
            if array.size != buffer.size:
                raise DefinitionError(f"input {k} of {self.name} has {array.size} numbers; it must have {buffer.size}")
            buffer[...] = array.reshape(buffer.shape)
        bound()
        return tuple([output.copy() for output in bound.outputs])

    def bind(self) -> BoundFunction:
        """Give the function with buffers of its own, for loops that call it at one point after the other."""
        return BoundFunction(self)

    @cached_property
    def _bound(self) -> BoundFunction:
        return self.bind()

    def batch(self, *arguments: Any) -> tuple[Array, ...]:
        """Evaluate at n points without a Python loop in compiled code.

        Args:
            arguments: For each input an array (n, ...) of the input's shape per point, or one point for all.

        Returns:
            One array (n, rows, columns), or (n, rows) for columns of width 1, for each output.
        """
        if len(arguments) != len(self._in_sizes):
            raise DefinitionError(f"{self.name} takes {len(self._in_sizes)} inputs; {len(arguments)} were given")
        arrays, counts = [], []
        for k, (argument, size, shape) in enumerate(zip(arguments, self._in_sizes, self.in_shapes, strict=True)):
            array = np.ascontiguousarray(argument, dtype=float)
            one = array.ndim == 0 or array.shape == shape or (shape[1] == 1 and array.shape == (shape[0],))
            if one and array.size == size:
                counts.append(1)
            elif array.ndim and array.size == array.shape[0] * size:
                counts.append(array.shape[0])
            else:
                raise DefinitionError(f"input {k} of {self.name} has shape {array.shape}; it must be (n, {shape})")
            arrays.append(array)
        several = {count for count in counts if count != 1}
        if len(several) > 1:
            raise DefinitionError(f"inputs of {self.name} have {counts} points; they must agree, or be one for all")
        n = several.pop() if several else 1
        steps = [0 if count == 1 else size for count, size in zip(counts, self._in_sizes, strict=True)]
        results = [np.zeros((n, size)) for size in self._out_sizes]  # compiled code writes the non-zero entries only
        self._run(n, arrays, steps, results)
        return tuple(r if s[1] == 1 else r.reshape(n, *s) for r, s in zip(results, self.out_shapes, strict=True))

    def trigger(self, inputs: Sequence[Array], outputs: Sequence[Array]) -> tuple[Callable[[], int | None], object]:
        """Build what evaluates the function from given input buffers into given output buffers.

        Args:
            inputs: Contiguous arrays.
            outputs: Contiguous arrays.

        Returns:
            A function without arguments, which returns a true value where it failed, and what must live as long as it.
        """
        if self._point_entry is None:
            buffer, run = self._function.buffer()
            for k, array in enumerate(inputs):
                buffer.set_arg(k, array.reshape(-1).data)
            for k, array in enumerate(outputs):
                buffer.set_res(k, array.reshape(-1).data)
            return run, (buffer, inputs, outputs)
        for array in outputs:
            array.fill(0.0)  # compiled code writes the non-zero entries only
        arguments = _pointers(inputs), _pointers(outputs)
        both = (ctypes.c_void_p * 2)(*[ctypes.addressof(a) for a in arguments])
        # no frame of Python's own between the caller and the compiled code: it would cost as much as a small function
        return functools.partial(self._point_entry, ctypes.addressof(both)), (inputs, outputs, arguments, both)

    def _run(self, n: int, arrays: list[Array], steps: list[int], results: list[Array]) -> None:
        if n == 0:
            return
        if self._batch_entry is not None:
            pointers_in, pointers_out = _pointers(arrays), _pointers(results)
            steps_in = (ctypes.c_longlong * len(steps))(*steps)
            steps_out = (ctypes.c_longlong * len(results))(*self._out_sizes)
            flag = self._batch_entry(n, pointers_in, steps_in, pointers_out, steps_out)
            if flag != 0:
                raise BackendError(f"compiled {self.name} returned {flag}")
            return
        flat_in = [a.reshape(-1, size) for a, size in zip(arrays, self._in_sizes, strict=True)]
        flat_out = [r.reshape(n, -1) for r in results]
        done = 0
        while done < n:
            take = self._chunk if n - done >= self._chunk else 1
            buffer, trigger = self._many if take > 1 else self._single
            held = []
            for k, (block, step) in enumerate(zip(flat_in, steps, strict=True)):
                part = np.tile(block, (take, 1)) if step == 0 else block[done : done + take]
                held.append(np.ascontiguousarray(part).reshape(-1))
                buffer.set_arg(k, held[-1].data)
            for k, block in enumerate(flat_out):
                buffer.set_res(k, block[done : done + take].reshape(-1).data)
            trigger()
            done += take


class BoundFunction:
    """Call a compiled function on fixed buffers: fill `inputs`, call, read `outputs`; nothing is allocated or copied.

    Attributes:
        inputs: One array for each input, to be written in place.
        outputs: One array for each output, overwritten by each call but for entries that are zero by structure: these
            are written once, so do not write into the arrays.

    Args:
        function: The function.
    """

    def __init__(self, function: CompiledFunction) -> None:
        def build(shapes: list[tuple[int, int]]) -> tuple[Array, ...]:
            return tuple(np.zeros(shape[0] if shape[1] == 1 else shape) for shape in shapes)

        self.inputs, self.outputs = build(function.in_shapes), build(function.out_shapes)
        self._name = function.name
        self._trigger, self._kept = function.trigger(self.inputs, self.outputs)

    def __call__(self) -> None:
        """Evaluate.

        Raises:
            BackendError: The compiled function reported a failure.
        """
        if self._trigger():
            raise BackendError(f"compiled {self._name} failed", inputs=self.inputs)


def _pointers(arrays: Sequence[Array]) -> Any:
    return (ctypes.c_void_p * len(arrays))(*[a.ctypes.data for a in arrays])


def _row_major(function: ca.Function) -> ca.Function:
    """Transpose inputs and outputs, because CasADi stores columns first and NumPy rows first; outputs stay sparse."""
    symbol = ca.SX.sym if function.is_a("SXFunction") else ca.MX.sym
    inputs = [symbol(f"i{k}", *reversed(function.size_in(k))) for k in range(function.n_in())]
    return ca.Function(function.name(), inputs, [o.T for o in function.call([i.T for i in inputs])])


def _make_full(function: ca.Function) -> ca.Function:
    """Make outputs full by one call of the function: as expressions, each of their zeros would be an instruction."""
    inputs = [ca.MX.sym(f"i{k}", *function.size_in(k)) for k in range(function.n_in())]
    return ca.Function(function.name(), inputs, [ca.densify(o) for o in function.call(inputs)])


def load_library(
    functions: Sequence[ca.Function],
    backend: Backend,
    name: str | None = None,
    generate: Callable[[Sequence[ca.Function]], str] = generate_source,
    wide: bool = False,
) -> ctypes.CDLL | None:
    """Compile functions or take them from the cache; None where the virtual machine is to be used.

    Args:
        functions: Functions of different names.
        backend: See `CompiledFunction`.
        name: Name of the library; that of the first function when None.
        generate: What writes the C code of the functions; one of `c_source`.
        wide: Whether the code is written for the wide vectors that some processors have.

    Returns:
        The library.

    Raises:
        BackendError: `backend` is "compiled" and there is no compiler, or the compilation failed.
    """
    if backend not in ("auto", "compiled", "virtual machine"):
        raise DefinitionError(f"backend is {backend!r}; it must be 'auto', 'compiled' or 'virtual machine'")
    if backend == "virtual machine":
        return None
    compiler = find_compiler()
    names = ", ".join(repr(f.name()) for f in functions)
    if compiler is None:
        if backend == "compiled":
            raise BackendError(f"no C compiler was found for {names}; install one or use backend='auto'")
        return None
    try:
        command = [compiler, *(_wide_flags(compiler) if wide else _optimisation(functions)), *_FLAGS]
        rows_first = [_row_major(f) for f in functions]
        return _load(rows_first, command, name or functions[0].name(), generate)
    except (BackendError, OSError) as error:
        if backend == "compiled":
            if isinstance(error, BackendError):
                raise
            raise BackendError(f"{names} could not be compiled with {compiler}: {error}", compiler=compiler) from error
        logger.warning("%s runs in the virtual machine: %s", names, error)
        return None


def _load(
    functions: Sequence[ca.Function],
    command: Sequence[str],
    name: str,
    generate: Callable[[Sequence[ca.Function]], str],
) -> ctypes.CDLL:
    """Compile functions into one library, or take it from the cache."""
    compiler, *flags = command
    graphs = [f.serialize() for f in functions]
    recipe = "|".join([ca.__version__, _compiler_identity(compiler), *flags, _generator_text(), *graphs])
    recipe += repr(getattr(generate, "keywords", ""))  # what a partial function was given beside the graphs
    key = hashlib.sha256(recipe.encode()).hexdigest()[:32]
    folder, stem = cache_folder(), f"{name}-{key}"
    for made in sorted(folder.glob(f"{stem}-*.so")):
        if _is_whole(made):
            return ctypes.CDLL(str(made))
        logger.warning("%s is damaged and made again", made)
        made.unlink(missing_ok=True)
    return ctypes.CDLL(str(_compile(generate(functions), [f.name() for f in functions], command, folder, stem)))


def _is_whole(library: Path) -> bool:
    """Tell whether a library holds what its name says; loading one that was cut short may end the process."""
    return library.stem.endswith(f"-{_digest(library)}")


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


@functools.cache
def _generator_text() -> str:
    """Read the module that writes the C code: libraries made by another version of it are not used."""
    return Path(c_source.__file__).read_text(encoding="utf-8")


@functools.cache
def _wide_flags(compiler: str) -> tuple[str, ...]:
    """Let a compiler use the vectors of this processor, as far as that does not change results.

    The flags are part of the name of what is compiled: another processor on the same cache makes its own.
    """
    ask = [compiler, "-march=native", "-dM", "-E", "-x", "c", os.devnull]
    done = subprocess.run(ask, capture_output=True, text=True, check=False)
    # at -O1 compilers leave the upper halves of registers dirty, which slows what runs afterwards
    return ("-O2", "-mavx2") if done.returncode == 0 and "__AVX2__" in done.stdout else ("-O2",)


def _optimisation(functions: Sequence[ca.Function]) -> tuple[str, ...]:
    """Optimise plain expressions fully; long chains of calls (the factorisations) gain nothing and compile slowly."""
    return ("-O3" if all(f.is_a("SXFunction") for f in functions) else "-O1",)


def _compile(code: str, names: Sequence[str], command: Sequence[str], folder: Path, stem: str) -> Path:
    """Compile functions into a library whose name tells what it was made from and what it holds."""
    with tempfile.TemporaryDirectory(dir=folder, prefix=".build-") as build:
        source = Path(build) / "functions.c"
        source.write_text(code)
        product = source.with_suffix(".so")
        full = [*command, str(source), "-o", str(product), "-lm"]
        done = subprocess.run(full, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise BackendError(f"{command[0]} failed on {', '.join(names)}: {done.stderr.strip()[:500]}", command=full)
        if not product.exists():
            raise BackendError(f"{command[0]} reported success on {', '.join(names)} but made no library", command=full)
        target = folder / f"{stem}-{_digest(product)}.so"
        os.replace(product, target)
        return target
