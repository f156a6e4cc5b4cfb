"""Measure contenders side by side: one short run of each in turn, round after round, so that what else the machine
does meanwhile falls on all of them."""

from __future__ import annotations

import gc
import math
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Rate:
    """Hold what one contender reached.

    Attributes:
        seconds: Median time of one unit of work [s].
        spread: Distance between the quartiles over the median [1].
        ratio: Median over the rounds of the reference's time over this one's [1]; above 1 is faster than the reference.
    """

    seconds: float
    spread: float
    ratio: float

    @property
    def per_second(self) -> float:
        return 1.0 / self.seconds


def race(
    contenders: Mapping[str, Callable[[], object]],
    reference: str,
    units: int = 1,
    rounds: int = 15,
    slice_seconds: float = 0.02,
) -> dict[str, Rate]:
    """Time functions without arguments, in turn.

    Args:
        contenders: The functions by name.
        reference: Name of the one that the others are compared with.
        units: Units of work that one call does.
        rounds: How often each is timed.
        slice_seconds: How long each is run in a round.
    """
    calls = {name: _calibrate(act, slice_seconds) for name, act in contenders.items()}
    times: dict[str, list[float]] = {name: [] for name in contenders}
    gc.collect()
    gc.disable()
    try:
        for _ in range(rounds):
            for name, act in contenders.items():
                count = calls[name]
                begin = time.perf_counter()
                for _ in range(count):
                    act()
                times[name].append((time.perf_counter() - begin) / (count * units))
    finally:
        gc.enable()
    return {name: _rate(times[name], times[reference]) for name in contenders}


def _calibrate(act: Callable[[], object], slice_seconds: float) -> int:
    act()  # what is made at the first use is made here
    begin = time.perf_counter()
    act()
    once = max(time.perf_counter() - begin, 1e-7)
    return max(1, math.ceil(slice_seconds / once))


def _rate(times: list[float], reference: list[float]) -> Rate:
    low, median, high = statistics.quantiles(times, n=4)
    ratio = statistics.median(theirs / ours for ours, theirs in zip(times, reference, strict=True))
    return Rate(median, (high - low) / median, ratio)
