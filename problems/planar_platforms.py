"""Which planar platforms with three legs are controlled by their three drives, and what is wrong with the others?

A leg has three joints R or P, one of them driven; the thesis counts 18 useful types of legs, hence 1140 platforms
(Lahouar, I.2.1.2, table I.1 and I.1), and rejects three types that hold nothing but the rotation of the platform when
their drive is held. Every platform is assembled and judged by the ranks of its equations at home and at random poses.

Expected: all 1140 have three degrees of freedom and are controlled. With the rejected types there are 1771 platforms:
513 with one such leg are controlled too; the 118 with two or three of them slide freely with their drives held.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from typing import Literal

import tyro

import paraopt as po
from paraopt.robots.planar_platform import (
    LEG_TYPES,
    REJECTED_LEG_TYPES,
    PlatformReport,
    analyse_platform,
    passive_chain,
    planar_platform,
    planar_platforms,
)


@dataclass(frozen=True)
class Parameters:
    """Assemble and judge planar platforms."""

    legs: Literal["accepted", "all"] = "all"
    """The 18 types of legs, or also the three rejected ones."""
    only: tuple[str, ...] = ()
    """Types of legs to choose from instead, such as R_P_R P_R_R."""
    poses: int = 6
    """Number of random poses beside home."""
    seed: int = 0
    """Seed of the poses."""
    jobs: int = -1
    """Number of workers; -1 for one per core."""
    backend: str = "loky"
    """Backend of joblib: loky, threading, sequential or dask."""


def judge(item: tuple[tuple[str, str, str], int, int]) -> PlatformReport:
    """Assemble one platform and judge it."""
    legs, poses, seed = item
    return analyse_platform(planar_platform(*legs), poses=poses, seed=seed)


def main(p: Parameters) -> int:
    """Judge all platforms, print the exceptions with their reasons, and say whether one of them was unexpected."""
    types = p.only or (LEG_TYPES if p.legs == "accepted" else LEG_TYPES + REJECTED_LEG_TYPES)
    platforms = list(planar_platforms(types))
    items = [(legs, p.poses, p.seed) for legs in platforms]
    try:
        reports = po.sweep(judge, items, jobs=p.jobs, backend=p.backend, progress="platforms")
    except po.ParaoptError as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    exceptions = [(legs, r) for legs, r in zip(platforms, reports, strict=True) if r.reason]
    regular = [r for r in reports if not r.reason]
    for legs, report in exceptions:
        print(f"{' '.join(f'{leg:<6}' for leg in legs)}  {report.reason}: {', '.join(report.drives)} act alike")
    print(f"{len(platforms)} platforms, largest residual at home {max(r.residual for r in reports):.1e}")
    if regular:
        margins = (min(r.parallel_margin for r in regular), min(r.serial_margin for r in regular))
        print(f"{len(regular)} controlled, least margins at home: parallel {margins[0]:.3f}, serial {margins[1]:.3f}")
    for reason, count in Counter(report.reason for _, report in exceptions).items():
        print(f"{count} exceptions: {reason}")
    # what the thesis says of the types that it rejects: two of them are too many
    unexpected = [legs for legs, _ in exceptions if sum(passive_chain(leg) == "PP" for leg in legs) < 2]
    return 1 if unexpected else 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Parameters, description=__doc__)))
