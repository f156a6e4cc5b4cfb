"""All planar platforms with three legs are machines with three degrees of freedom that their drives control."""

from __future__ import annotations

import numpy as np
import pytest

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
from solutions import home_of

Legs = tuple[str, str, str]
PLATFORMS = list(planar_platforms())
# every type of leg, and as many platforms anywhere
SAMPLE = [PLATFORMS[i] for i in np.random.default_rng(0).choice(len(PLATFORMS), 18, replace=False)]
SAMPLE += [tuple(LEG_TYPES[k] for k in sorted((i, (i + 5) % 18, (i + 11) % 18))) for i in range(18)]


def judge(legs: Legs) -> tuple[PlatformReport, float, bool]:
    """Judge a platform; also the clearance of its solids at home, and whether its limits hold there."""
    robot = planar_platform(*legs)
    home = home_of(robot)
    low, high = robot.limits.bounds(robot.mechanism)
    clearance = float("nan")
    if robot.shapes:
        kinematics = po.Kinematics(robot.mechanism, backend="virtual machine")
        robot.__dict__["kinematics"] = kinematics  # the scene would compile its own
        clearance = float(po.Scene(robot).clearances(home[None])[0][0])
    return analyse_platform(robot), clearance, bool(np.all((low < home) & (home < high)))


def check_regular(legs: Legs, report: PlatformReport, clearance: float, within: bool) -> None:
    assert report.reason == "", f"{legs}: {report.reason}"
    assert report.mobility == 3
    assert report.poses == 6, f"{legs}: only {report.poses} random poses were reached"
    # built closed, so that nothing but rounding is left
    assert report.residual < 1e-14
    assert report.parallel_margin > 0.05
    assert report.serial_margin > 0.05
    assert clearance > 0
    assert within


@pytest.mark.parametrize("legs", SAMPLE, ids="-".join)
def test_a_sample_of_the_platforms(legs: Legs) -> None:
    check_regular(legs, *judge(legs))


@pytest.mark.parametrize("seed", range(8))
def test_random_dimensions(seed: int) -> None:
    """Exactly closed at home, with rank 9, whatever the dimensions."""
    random = np.random.default_rng(seed)
    legs = tuple(random.choice(LEG_TYPES, 3))
    turns = np.deg2rad([210, 330, 90]) + random.uniform(-0.5, 0.5, 3)
    rim = np.column_stack([np.cos(turns), np.sin(turns)])
    base, platform = rim * random.uniform(0.5, 0.8, (3, 1)), rim[[1, 2, 0]] * random.uniform(0.1, 0.3, (3, 1))
    elbows = np.column_stack([random.uniform(0.3, 0.7, 3), random.choice([-1, 1], 3) * random.uniform(0.1, 0.3, 3)])
    pose = (*random.uniform(-0.1, 0.1, 2), random.uniform(-0.5, 0.5))
    robot = planar_platform(
        *legs, base=tuple(map(tuple, base.tolist())), platform=tuple(map(tuple, platform.tolist())),
        elbows=tuple(map(tuple, elbows.tolist())), pose=pose,
    )  # fmt: skip
    report = analyse_platform(robot, seed=seed)
    assert report.residual < 1e-14
    assert (report.mobility, report.reason) == (3, "")


@pytest.mark.slow
def test_all_1140_platforms_and_those_with_rejected_legs(capsys: pytest.CaptureFixture[str]) -> None:
    """In one sweep on all cores; exceptions are exactly the machines with two or three legs that hold only rotation."""
    platforms = list(planar_platforms(LEG_TYPES + REJECTED_LEG_TYPES))
    with capsys.disabled():
        results = po.sweep(judge, platforms, progress="planar platforms")
    accepted = 0
    for legs, (report, clearance, within) in zip(platforms, results, strict=True):
        rejected = sum(passive_chain(leg) == "PP" for leg in legs)
        if rejected == 0:
            accepted += 1
            check_regular(legs, report, clearance, within)
        elif rejected == 1:
            assert report.reason == "", f"{legs}: {report.reason}"
        else:
            assert "slides without turning" in report.reason, f"{legs}: {report.reason}"
            assert len(report.drives) == rejected
            assert report.mobility == 3
    assert accepted == 1140
