"""Compiled functions: the same numbers as the virtual machine, the cache, and life without a compiler."""

from __future__ import annotations

import logging
import os
import re
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import paraopt as po
from paraopt.closure import build_closure
from paraopt.kinematics import CompiledFunction, find_compiler
from paraopt.kinematics.c_source import generate_source
from paraopt.kinematics.functions import FunctionSet
from support import raf_robot, two_rpr

BACKENDS = ["virtual machine", "compiled"] if find_compiler() else ["virtual machine"]
needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="no C compiler on this machine")


def build_function(factor: float = 2.0) -> ca.Function:
    """A matrix, a vector and a number in; a matrix and a vector out: rows and columns differ everywhere."""
    A, b, c = ca.SX.sym("A", 2, 3), ca.SX.sym("b", 3), ca.SX.sym("c")
    return ca.Function("paraopt_example", [A, b, c], [ca.vertcat(A, A) * c, factor * ca.sin(A @ b)])


def reference(A: np.ndarray, b: np.ndarray, c: float) -> tuple[np.ndarray, np.ndarray]:
    return np.vstack([A, A]) * c, 2.0 * np.sin(A @ b)


def libraries(folder: Path) -> dict[str, int]:
    """Name the compiled functions of a cache, with the time at which each was made [ns]."""
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("*.so")}


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PARAOPT_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("PARAOPT_COMPILE", raising=False)
    return tmp_path / "cache"


# --- Same numbers


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_point(backend: Any) -> None:
    function = CompiledFunction(build_function(), backend)
    A, b = np.arange(6.0).reshape(2, 3), np.array([0.1, 0.2, 0.3])
    results = function(A, b, 0.5)
    for result, expected in zip(results, reference(A, b, 0.5), strict=True):
        assert_allclose(result, expected, rtol=1e-15, atol=1e-15)
    # flat arguments, lists and transposed views are the same numbers
    for other in (function(A.ravel(), b[:, None], [0.5]), function(A.T.copy().T, b.tolist(), np.float64(0.5))):
        for result, expected in zip(other, results, strict=True):
            assert_array_equal(result, expected)


@pytest.mark.parametrize("backend", BACKENDS)
def test_results_are_not_overwritten_by_the_next_call(backend: Any) -> None:
    function = CompiledFunction(build_function(), backend)
    (first, _), (second, _) = (function(np.full((2, 3), v), np.ones(3), 1.0) for v in (1.0, 2.0))
    assert (first[0, 0], second[0, 0]) == (1.0, 2.0)


@pytest.mark.parametrize("backend", BACKENDS)
# below, at, above and well above the 64 points that the virtual machine takes at once
@pytest.mark.parametrize("n", [0, 1, 2, 3, 63, 64, 65, 130])
def test_batch_is_the_points_one_by_one(backend: Any, n: int) -> None:
    function = CompiledFunction(build_function(), backend)
    random = np.random.default_rng(n)
    A, b, c = random.normal(size=(n, 2, 3)), random.normal(size=(n, 3)), random.normal(size=(n, 1))
    first, second = function.batch(A, b, c)
    assert (first.shape, second.shape) == ((n, 4, 3), (n, 2))
    for i in range(n):
        for result, expected in zip((first[i], second[i]), reference(A[i], b[i], c[i, 0]), strict=True):
            # the sum of three products may be rounded in another order
            assert_allclose(result, expected, rtol=1e-15, atol=1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("shared", [(0,), (1,), (2,), (0, 1), (1, 2), (0, 2)])
def test_batch_broadcasts_one_point_to_all(backend: Any, shared: tuple[int, ...]) -> None:
    function = CompiledFunction(build_function(), backend)
    random, n = np.random.default_rng(1), 70
    arguments = [random.normal(size=(n, 2, 3)), random.normal(size=(n, 3)), random.normal(size=(n, 1))]
    full = [np.repeat(a[:1], n, axis=0) if k in shared else a for k, a in enumerate(arguments)]
    given = [a[0] if k in shared else a for k, a in enumerate(arguments)]
    for result, expected in zip(function.batch(*given), function.batch(*full), strict=True):
        assert_array_equal(result, expected)


@pytest.mark.parametrize("backend", BACKENDS)
def test_batch_of_shared_arguments_only_is_one_point(backend: Any) -> None:
    A, b = np.arange(6.0).reshape(2, 3), np.ones(3)
    first, second = CompiledFunction(build_function(), backend).batch(A, b, 0.5)
    assert (first.shape, second.shape) == ((1, 4, 3), (1, 2))
    assert_allclose(first[0], reference(A, b, 0.5)[0], rtol=1e-15)


@pytest.mark.parametrize("backend", BACKENDS)
def test_bound_function_reads_and_writes_its_buffers(backend: Any) -> None:
    function = CompiledFunction(build_function(), backend)
    bound, other = function.bind(), function.bind()
    for k in range(3):
        bound.inputs[0][...], bound.inputs[1][...], bound.inputs[2][...] = k, 0.1, 2.0
        bound()
        for result, expected in zip(bound.outputs, reference(np.full((2, 3), k), np.full(3, 0.1), 2.0), strict=True):
            assert_allclose(result, expected, rtol=1e-15)
    other()
    assert not np.any(other.outputs[0])
    assert np.all(bound.outputs[0] == 4.0)


ARGUMENTS: dict[str, Callable[[FunctionSet], CompiledFunction]] = {
    "residual": lambda f: f.residual,
    "jacobians": lambda f: f.jacobians,
    "scaled_jacobian": lambda f: f.scaled_jacobian,
    "poses": lambda f: f.poses,
    "step": lambda f: f.step,
    "tangent": lambda f: f.tangent(3),
    "curvature": lambda f: f.curvature(6),
    "pose_velocity": lambda f: f.pose_velocity(3),
}


@needs_compiler
@pytest.mark.parametrize("name", ARGUMENTS)
def test_raf_functions_are_the_same_compiled_and_not(name: str) -> None:
    graph = build_closure(raf_robot().mechanism)
    slow = ARGUMENTS[name](FunctionSet(graph, "virtual machine"))
    fast = ARGUMENTS[name](raf_robot().kinematics.functions)
    assert fast.is_compiled
    assert not slow.is_compiled
    random, n = np.random.default_rng(2), 70
    arguments = []
    for k, (rows, columns) in enumerate(fast.in_shapes):
        if (rows, columns) == (1, 1):
            values = np.full((n, 1), 1e-3)  # a damping that keeps the normal equations regular
        elif k == 1 and name in ("step", "tangent", "curvature"):
            values = random.integers(0, 2, size=(n, rows)).astype(float)  # which variables are free
        else:
            values = random.uniform(-1, 1, size=(n, rows, columns))
        arguments.append(values)
    for a, b in zip(fast.batch(*arguments), slow.batch(*arguments), strict=True):
        assert a.shape == b.shape
        # the same operations in the same order, up to the library's sines; the bound is the one that is promised
        assert_allclose(a, b, rtol=1e-12, atol=1e-12 * max(1.0, np.max(np.abs(b))))
    point = [a[5] for a in arguments]
    for a, b, whole in zip(fast(*point), slow(*point), fast.batch(*arguments), strict=True):
        assert_allclose(a, b, rtol=1e-12, atol=1e-12 * max(1.0, np.max(np.abs(b))))
        assert_array_equal(a, whole[5])


# --- Bad arguments


@pytest.mark.parametrize("backend", BACKENDS)
def test_bad_shapes_are_refused(backend: Any) -> None:
    function = CompiledFunction(build_function(), backend)
    A, b, c = np.zeros((5, 2, 3)), np.zeros((5, 3)), np.zeros((5, 1))
    for bad, message in (
        ((A[0], b[0, :2], 1.0), "input 1 of paraopt_example has 2 numbers; it must have 3"),
        ((A, b[0], 1.0), "input 0 of paraopt_example has 30 numbers; it must have 6"),
        ((A[0], b[0]), "takes 3 inputs; 2 were given"),
        ((A[0], b[0], 1.0, 2.0), "takes 3 inputs; 4 were given"),
    ):
        with pytest.raises(po.DefinitionError, match=message):
            function(*bad)
    for bad, message in (
        ((A, b[:4], c), r"inputs of paraopt_example have \[5, 4, 5\] points"),
        ((A, b, c[:2]), r"inputs of paraopt_example have \[5, 5, 2\] points"),
        ((A[:, :, :2], b, c), r"input 0 of paraopt_example has shape \(5, 2, 2\)"),
        ((A, b[:, :2], c), r"input 1 of paraopt_example has shape \(5, 2\)"),
    ):
        with pytest.raises(po.DefinitionError, match=message):
            function.batch(*bad)


@pytest.mark.parametrize("backend", ["virtual machine"])  # compiled code reads memory that is not its own
def test_batches_of_one_and_of_many_points_do_not_mix(backend: Any) -> None:
    function = CompiledFunction(build_function(), backend)
    try:
        first, _ = function.batch(np.ones((1, 2, 3)), np.ones((5, 3)), 1.0)
    except po.DefinitionError:
        return
    assert_array_equal(first, np.ones((5, 4, 3)))  # else as if the one point were for all


def test_wrong_number_of_batches_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="takes 3 inputs; 2 were given"):
        CompiledFunction(build_function(), "virtual machine").batch(np.ones((5, 2, 3)), np.ones((5, 3)))


def test_unknown_backend_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="backend is 'fast'"):
        CompiledFunction(build_function(), "fast")  # type: ignore[arg-type]


# --- Cache


@needs_compiler
def test_second_construction_takes_the_library_from_the_cache(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "calls"
    wrapper = tmp_path / "counting-cc"
    wrapper.write_text(f'#!/bin/sh\necho "$@" >> {log}\nexec {find_compiler()} "$@"\n')
    wrapper.chmod(wrapper.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PARAOPT_CC", str(wrapper))

    def compilations() -> int:
        return sum("-shared" in line for line in log.read_text().splitlines())

    first = CompiledFunction(build_function(), "compiled")
    made = libraries(cache)
    assert (compilations(), len(made)) == (1, 1)
    second = CompiledFunction(build_function(), "compiled")
    assert (compilations(), libraries(cache)) == (1, made)
    assert_array_equal(first(np.ones((2, 3)), np.ones(3), 1.0)[1], second(np.ones((2, 3)), np.ones(3), 1.0)[1])
    # another constant in the graph is another function
    changed = CompiledFunction(build_function(factor=3.0), "compiled")
    assert (compilations(), len(libraries(cache))) == (2, 2)
    assert_allclose(changed(np.ones((2, 3)), np.ones(3), 1.0)[1], 3.0 * np.sin([3.0, 3.0]), rtol=1e-15)
    # nothing but whole libraries stays behind
    assert {path.suffix for path in cache.iterdir()} == {".so"}


@needs_compiler
def test_key_changes_with_the_mechanism_and_not_with_the_run(cache: Path) -> None:
    for base, expected in ((4.0, 1), (4.0, 1), (4.0000001, 2)):
        assert FunctionSet(build_closure(two_rpr(base)), "compiled").residual.is_compiled
        assert len(libraries(cache)) == expected


@needs_compiler
def test_key_changes_with_the_compiler(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    CompiledFunction(build_function(), "compiled")
    other = tmp_path / "other-cc"
    other.symlink_to(str(find_compiler()))
    monkeypatch.setenv("PARAOPT_CC", str(other))
    CompiledFunction(build_function(), "compiled")
    assert len(libraries(cache)) == 2


@needs_compiler
def test_cache_that_cannot_be_made_is_replaced_by_a_temporary_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("PARAOPT_CACHE", str(tmp_path / "file" / "cache"))
    function = CompiledFunction(build_function(), "compiled")
    assert function.is_compiled
    assert_array_equal(function(np.ones((2, 3)), np.zeros(3), 2.0)[0], np.full((4, 3), 2.0))
    assert (tmp_path / "file").read_text() == "not a folder"


@needs_compiler
def test_cache_that_cannot_be_written_is_replaced_by_a_temporary_one(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache.mkdir()
    cache.chmod(0o500)
    if hasattr(os, "geteuid") and os.geteuid() == 0:  # root writes everywhere: it is told what others are told
        ask = os.access
        monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != cache and ask(path, mode))
    assert CompiledFunction(build_function(), "compiled").is_compiled
    assert not libraries(cache)


@needs_compiler
@pytest.mark.parametrize("kept", ["other bytes", "first half", "all but the end", "nothing"])
def test_damaged_library_is_made_again(
    kept: str, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    CompiledFunction(build_function(), "compiled")
    (name,) = libraries(cache)
    whole = (cache / name).read_bytes()
    other = tmp_path / "other cache"  # this process has already loaded the first one
    other.mkdir()
    # loading the first half of a library ends the process
    parts = {"other bytes": b"half a library", "first half": whole[: len(whole) // 2], "all but the end": whole[:-1]}
    (other / name).write_bytes(parts.get(kept, b""))
    monkeypatch.setenv("PARAOPT_CACHE", str(other))
    function = CompiledFunction(build_function(), "compiled")
    assert function.is_compiled
    assert_array_equal(function(np.ones((2, 3)), np.zeros(3), 2.0)[0], np.full((4, 3), 2.0))
    assert "is damaged and made again" in caplog.text
    made = libraries(other)
    CompiledFunction(build_function(), "compiled")
    assert libraries(other) == made


# --- The code itself


@needs_compiler
def test_absent_arrays_inside_are_replaced(cache: Path) -> None:
    """An inner function whose second input is zero throughout and whose first output nobody wants."""
    a, b = ca.SX.sym("a", 2), ca.SX.sym("b", 2)
    inner = ca.Function("inner", [a, b], [ca.sin(a), ca.cos(a) + b, ca.sin(b) * ca.cos(a)], {"never_inline": True})
    x = ca.MX.sym("x", 2)
    outer = ca.Function("paraopt_outer", [x], [inner(x, ca.MX(2, 1))[1]])
    compiled = CompiledFunction(outer, "compiled")
    # one rounding of the cosine
    assert_allclose(compiled([0.3, -2.0])[0], np.cos([0.3, -2.0]), rtol=0, atol=2e-16)


def test_generated_code_has_no_branches() -> None:
    """Compilers compute sine and cosine of one angle together only where no branch stands between them."""
    code = generate_source([build_function()])
    assert "=arg0_[" in code
    assert not re.search(r"arg\[\d+\] ?\? arg\[\d+\]\[|if \(res\[", code)


# --- Compilers that are hidden, absent or broken


def test_compilation_can_be_switched_off(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PARAOPT_COMPILE", "0")
    assert find_compiler() is None
    function = CompiledFunction(build_function(), "auto")
    assert not function.is_compiled
    assert not libraries(cache)
    assert_array_equal(function(np.ones((2, 3)), np.zeros(3), 2.0)[0], np.full((4, 3), 2.0))
    with pytest.raises(po.BackendError, match="no C compiler was found for 'paraopt_example'"):
        CompiledFunction(build_function(), "compiled")


def test_no_compiler_on_the_path(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    for name in ("PARAOPT_CC", "CC"):
        monkeypatch.delenv(name, raising=False)
    assert find_compiler() is None
    assert not CompiledFunction(build_function()).is_compiled


def test_stated_compiler_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = tmp_path / "mine"
    mine.write_text("#!/bin/sh\n")
    mine.chmod(0o700)
    monkeypatch.setenv("CC", str(mine))
    assert find_compiler() == str(mine)
    monkeypatch.setenv("PARAOPT_CC", "/bin/false")
    assert find_compiler() == "/bin/false"


BROKEN = {
    "fails": "/bin/false",
    "makes nothing": "/bin/true",
    "is no program": "no program",
}


@pytest.mark.parametrize("compiler", BROKEN.values(), ids=BROKEN.keys())
def test_broken_compiler_falls_back_with_a_warning(
    compiler: str, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    if compiler == "no program":
        path = tmp_path / "no-program"
        path.write_bytes(b"\x7fnot a program")
        path.chmod(0o700)
        compiler = str(path)
    monkeypatch.setenv("PARAOPT_CC", compiler)
    with caplog.at_level(logging.WARNING, logger="paraopt"):
        function = CompiledFunction(build_function(), "auto")
    assert not function.is_compiled
    assert [r.levelname for r in caplog.records] == ["WARNING"]
    assert "'paraopt_example' runs in the virtual machine" in caplog.text
    assert_array_equal(function(np.ones((2, 3)), np.zeros(3), 2.0)[0], np.full((4, 3), 2.0))
    assert list(cache.rglob("*")) == []


def test_broken_compiler_is_an_error_where_one_is_insisted_on(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PARAOPT_CC", "/bin/false")
    with pytest.raises(po.BackendError, match="/bin/false failed on paraopt_example") as caught:
        CompiledFunction(build_function(), "compiled")
    assert "/bin/false" in caught.value.evidence["command"]


def test_compiler_that_makes_nothing_is_an_error_where_one_is_insisted_on(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PARAOPT_CC", "/bin/true")
    with pytest.raises(po.BackendError, match="/bin/true reported success on paraopt_example but made no library"):
        CompiledFunction(build_function(), "compiled")
