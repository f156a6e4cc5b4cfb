"""Sweeps: one function over many items, on the cores of this machine or on a cluster.

Maps, studies over designs and tests of whole families are written once with `sweep`; joblib carries the work. The
default runs in processes of this machine; `backend="dask"` sends the same work to the cluster of the current
`dask.distributed.Client`.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Literal

import joblib
import numpy as np
from joblib.parallel import BACKENDS, EXTERNAL_BACKENDS

from paraopt.errors import BackendError, DefinitionError, MissingBackendError, ParaoptError


@dataclass(frozen=True, eq=False)
class Failure:
    """Hold what is known of an item whose evaluation raised an exception.

    Attributes:
        index: Position of the item in the sweep, from 0.
        item: The item.
        kind: Name of the exception's class.
        message: Its message.
        trace: Its traceback as text, since it may come from another process.
    """

    index: int
    item: Any
    kind: str
    message: str
    trace: str

    def __str__(self) -> str:
        return f"item {self.index}, {self.item!r}: {self.kind}: {self.message}"


def sweep(
    function: Callable[..., Any],
    items: Iterable[Any],
    *,
    jobs: int = -1,
    backend: str = "loky",
    options: Mapping[str, Any] | None = None,
    seed: int | None = None,
    failures: Literal["raise", "return"] = "raise",
    progress: bool | str = False,
) -> list[Any]:
    """Evaluate a function for every item, in parallel, and give the results in the order of the items.

    Every item is evaluated whatever happens to the others. The results do not depend on the number of jobs nor on the
    backend: with a seed each item has a random stream of its own.

    Args:
        function: Called as `function(item)`, or as `function(item, generator)` when a seed is given. In processes and
            on a cluster, the function, the items and the results must be picklable.
        items: What to evaluate it for.
        jobs: Number of workers; -1 for one per core.
        backend: Backend of joblib: "loky" (processes), "threading", "sequential", or "dask" (the cluster of
            the current `dask.distributed.Client`).
        options: Further options of the backend, such as `{"scheduler_host": "tcp://head:8786"}` for Dask.
        seed: Seed of the random streams; no stream is handed over when None.
        failures: "raise" raises once all items are done; "return" puts a `Failure` in the place of each missing result.
        progress: Whether to draw a progress bar on the standard error, or its label.

    Returns:
        One result for each item.

    Raises:
        DefinitionError: An argument has no meaning.
        MissingBackendError: The backend, or the progress bar's package, is not installed.
        BackendError: The backend failed: a worker died, or something could not be pickled.
        ParaoptError: Some items failed; the message names the first, and `evidence` holds "failures" and "results".
    """
    if failures not in ("raise", "return"):
        raise DefinitionError(f"failures is {failures!r}; it must be 'raise' or 'return'")
    if not isinstance(jobs, int) or jobs == 0:
        raise DefinitionError(f"number of jobs is {jobs!r}; it must be a whole number, not 0; -1 is one per core")
    items = list(items)
    streams: list[Any] = [()] * len(items)
    if seed is not None:
        streams = [(np.random.default_rng(s),) for s in np.random.SeedSequence(seed).spawn(len(items))]
    tasks = [
        joblib.delayed(_evaluate)(function, i, item, stream)
        for i, (item, stream) in enumerate(zip(items, streams, strict=True))
    ]
    with _parallel(jobs, backend, options or {}) as parallel:
        draw = _find_progress_bar(progress)
        try:
            results = list(draw(parallel(tasks), len(items)))
        except Exception as error:  # those of the items are caught where they arise: this is one of the backend
            raise BackendError(
                f"backend {backend!r} of the sweep failed: {type(error).__name__}: {error}; can the function, "
                "its items and its results be pickled?"
            ) from error
    failed = [r for r in results if isinstance(r, Failure)]
    if failed and failures == "raise":
        raise ParaoptError(
            f"{len(failed)} of {len(items)} items of the sweep failed; the first is {failed[0]}",
            failures=failed,
            results=results,
        )
    return results


def _evaluate(function: Callable[..., Any], index: int, item: Any, stream: tuple[Any, ...]) -> Any:
    try:
        return function(item, *stream)
    except Exception as error:  # whatever a user's function raises belongs to its item; it may not survive pickling
        return Failure(index, item, type(error).__name__, str(error), traceback.format_exc())


@contextmanager
def _parallel(jobs: int, backend: str, options: Mapping[str, Any]) -> Iterator[joblib.Parallel]:
    # joblib's "multiprocessing" cannot hand over results one by one, as the progress bar wants; "loky" replaced it
    known = sorted({*BACKENDS, *EXTERNAL_BACKENDS} - {"multiprocessing"})
    if backend not in known:
        raise DefinitionError(f"backend of the sweep is {backend!r}; it must be one of {known}")
    with ExitStack() as stack:
        try:
            stack.enter_context(joblib.parallel_config(backend=backend, n_jobs=jobs, **options))
            parallel = joblib.Parallel(return_as="generator")
        except (TypeError, ValueError) as error:  # an option that it does not know, or no client of a cluster
            if backend == "dask" and find_spec("distributed") is None:
                raise MissingBackendError("backend 'dask' of the sweep needs 'pip install distributed'") from error
            raise DefinitionError(f"backend {backend!r} of the sweep cannot start: {error}") from error
        yield parallel


def _find_progress_bar(progress: bool | str) -> Callable[[Iterable[Any], int], Iterable[Any]]:
    if progress is False:
        return lambda results, total: results
    try:
        from tqdm import tqdm
    except ImportError as error:
        raise MissingBackendError("a progress bar needs 'tqdm': pip install 'paraopt[cli]'") from error
    return lambda results, total: tqdm(results, total=total, desc=None if progress is True else progress)
