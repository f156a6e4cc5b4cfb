"""Sweeps: order, random streams, failures and backends."""

from __future__ import annotations

import importlib.util
import os
import sys
import threading

import joblib
import numpy as np
import pytest

from paraopt.errors import BackendError, DefinitionError, MissingBackendError, ParaoptError
from paraopt.sweep import Failure, sweep

BACKENDS = ("sequential", "threading", "loky")


def square(item: int) -> int:
    return item * item


def refuse_three(item: int) -> int:
    if item == 3:
        raise ValueError("three is too many")
    return item


def draw(item: int, generator: np.random.Generator) -> float:
    return item + float(generator.random())


def where(item: int) -> tuple[int, int]:
    return os.getpid(), threading.get_ident()


@pytest.mark.parametrize("backend", BACKENDS)
def test_results_come_in_the_order_of_the_items(backend: str) -> None:
    assert sweep(square, range(20), jobs=2, backend=backend) == [i * i for i in range(20)]


def test_nothing_to_do_gives_nothing() -> None:
    assert sweep(square, [], backend="sequential") == []


def test_items_may_be_a_generator() -> None:
    assert sweep(square, (i for i in (3, 1)), backend="sequential") == [9, 1]


def test_the_backend_is_the_one_that_was_asked_for() -> None:
    """Threads share this process and no thread of it; processes have identities of their own."""
    here = (os.getpid(), threading.get_ident())
    assert set(sweep(where, range(8), jobs=2, backend="sequential")) == {here}
    threads = sweep(where, range(8), jobs=2, backend="threading")
    assert {process for process, _ in threads} == {here[0]}
    assert here[1] not in {thread for _, thread in threads}
    assert here[0] not in {process for process, _ in sweep(where, range(8), jobs=2, backend="loky")}


def test_the_backend_and_its_options_reach_joblib(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    original = joblib.parallel_config

    def spy(**options: object) -> object:
        seen.append(options)
        return original(**options)

    monkeypatch.setattr(joblib, "parallel_config", spy)
    sweep(square, [1], jobs=2, backend="threading", options={"verbose": 0})
    assert seen == [{"backend": "threading", "n_jobs": 2, "verbose": 0}]


def test_the_configuration_ends_with_the_sweep() -> None:
    before = joblib.Parallel().n_jobs
    sweep(square, range(3), jobs=2, backend="threading")
    assert joblib.Parallel().n_jobs == before


@pytest.mark.parametrize("backend", BACKENDS)
def test_random_streams_depend_on_the_seed_alone(backend: str) -> None:
    expected = [i + float(np.random.default_rng(s).random()) for i, s in enumerate(np.random.SeedSequence(5).spawn(6))]
    assert sweep(draw, range(6), seed=5, jobs=2, backend=backend) == expected
    assert sweep(draw, range(6), seed=6, jobs=2, backend=backend) != expected


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_failing_item_is_named_and_does_not_stop_the_others(backend: str) -> None:
    with pytest.raises(ParaoptError, match=r"1 of 5 items .* item 3, 3: ValueError: three is too many") as caught:
        sweep(refuse_three, range(5), jobs=2, backend=backend)
    (failure,) = caught.value.evidence["failures"]
    assert (failure.index, failure.item, failure.kind) == (3, 3, "ValueError")
    assert "refuse_three" in failure.trace
    results = caught.value.evidence["results"]
    assert [r for r in results if not isinstance(r, Failure)] == [0, 1, 2, 4]


def test_failures_may_be_returned_in_their_place() -> None:
    results = sweep(refuse_three, [2, 3, 4], backend="sequential", failures="return")
    assert (results[0], results[2]) == (2, 4)
    assert isinstance(results[1], Failure)
    assert str(results[1]) == "item 1, 3: ValueError: three is too many"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"backend": "punched cards"}, "loky"),
        ({"backend": "multiprocessing"}, "loky"),
        ({"jobs": 0}, "number of jobs is 0"),
        ({"jobs": 1.5}, "number of jobs is 1.5"),
        ({"failures": "ignore"}, "'raise' or 'return'"),
        ({"backend": "sequential", "options": {"n_jobs": 2}}, "cannot start"),
    ],
)
def test_faulty_arguments_are_refused(options: dict, message: str) -> None:
    with pytest.raises(DefinitionError, match=message):
        sweep(square, [1], **options)


@pytest.mark.skipif(importlib.util.find_spec("distributed") is not None, reason="a Dask cluster may be at hand")
def test_dask_that_is_not_installed_is_asked_for() -> None:
    with pytest.raises(MissingBackendError, match="pip install distributed"):
        sweep(square, [1], backend="dask")


def test_what_cannot_be_pickled_is_a_failure_of_the_backend() -> None:
    with pytest.raises(BackendError, match="pickled"):
        sweep(square, [threading.Lock()], jobs=2, backend="loky")


def test_the_bar_counts_the_items_on_the_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert sweep(square, range(3), backend="sequential", progress="squares") == [0, 1, 4]
    out, err = capsys.readouterr()
    assert out == ""
    assert "squares" in err
    assert "3/3" in err


def test_a_bar_without_its_package_is_refused_before_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tqdm", None)
    done: list[int] = []
    with pytest.raises(MissingBackendError, match="tqdm"):
        sweep(done.append, [1], backend="sequential", progress=True)
    assert done == []
