"""The Logabex: four stacked platforms, 24 degrees of freedom (Lahouar, I.2), stage by stage against lengths by hand."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.closure import build_closure
from paraopt.robots import logabex
from paraopt.spatial import transform

Array = np.ndarray
COORDINATES = ("x", "y", "z", "alpha", "beta", "gamma")


@functools.cache
def robot(stages: int = 4) -> po.Robot:
    return logabex(stages)


@functools.cache
def kinematics() -> po.Kinematics:
    """Give the functions of the four stages uncompiled: a compiler needs longer for them than these tests do."""
    return po.Kinematics(robot().mechanism, backend="virtual machine")


def home() -> dict[str, float]:
    return {name: robot().home[name] for name in robot().mechanism.operational}


def test_counts_and_ranks() -> None:
    """Printed: four Stewart platforms, 24 degrees of freedom; the rest is four times models.md §2."""
    r = robot()
    report = po.report_state(kinematics(), kinematics().inverse(home(), start=r.home).configuration)
    assert (report.n_variables, report.n_equations, report.mobility, report.idle) == (96, 72, 24, ())
    assert [report.ranks[k].value for k in ("E", "M", "N", "K", "[N K]", "[M N]")] == [72, 24, 48, 24, 72, 72]
    assert (len(r.mechanism.active), len(r.mechanism.operational)) == (24, 24)
    assert min(report.parallel_margin, report.serial_margin) > 0.02


def test_lengths_of_all_legs() -> None:
    """Random shapes of the arm: each leg is the distance between its joints on two platforms."""
    r = robot()
    ends = {c.link_A: (c.link_B, np.array(c.point_B)) for c in r.mechanism.closures}
    feet = {k.name: (k.father, np.array(k.at)) for k in r.mechanism.links if k.name.startswith("leg")}
    start = kinematics().inverse(home(), start=r.home).configuration
    random = np.random.default_rng(0)
    spread = np.tile([0.03, 0.03, 0.02, 0.12, 0.12, 0.12], 4)
    for _ in range(5):
        x = start.operational + random.uniform(-spread, spread)
        cfg = kinematics().inverse(dict(zip(r.mechanism.operational, x.tolist(), strict=True)), start)
        placed: dict[str, Array] = {"base": np.eye(4)}
        for k in range(4):
            pose = x[6 * k : 6 * k + 6]
            placed[f"platform {k + 1}"] = transform(pose[:3], pose[3:])
        lengths = []
        for key in (name.removeprefix("q") for name in r.mechanism.active):
            (above, p), (below, a) = ends[f"rod {key}"], feet[f"leg {key}"]
            X_A, X_B = placed[below], placed[above]
            lengths.append(np.linalg.norm(X_B[:3, :3] @ p + X_B[:3, 3] - X_A[:3, :3] @ a - X_A[:3, 3]))
        assert_allclose(cfg.configuration.active, lengths, atol=1e-9)


def test_each_closure_contains_two_platforms_and_one_leg() -> None:
    """An equation holds at most 3 variables of its leg and 12 coordinates, at any height of the stack."""
    graph = build_closure(robot(6).mechanism)
    per_row = np.asarray(graph.E.sparsity().T.colind())  # row pointers of E
    assert np.max(np.diff(per_row)) <= 3 + 12
    entries = [build_closure(robot(n).mechanism).E.nnz() for n in (2, 3, 4, 5)]
    assert len(set(np.diff(entries))) == 1  # each stage adds as many entries as the one before


def test_one_stage_is_a_stewart_platform() -> None:
    r = robot(1)
    report = po.report_state(r.kinematics, r.home_configuration)
    assert (report.n_variables, report.n_equations, report.mobility) == (24, 18, 6)
    assert r.mechanism.operational == tuple(f"p1.{c}" for c in COORDINATES)


def test_no_stage_is_refused() -> None:
    with pytest.raises(po.DefinitionError, match="number of stages is 0"):
        logabex(0)
