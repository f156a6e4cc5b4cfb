"""Planar platforms against their source, Lahouar, I.2.1.2 (table I.1, I.1), and special machines against reasoning."""

from __future__ import annotations

import cmath
import dataclasses
import inspect
from itertools import product
from math import comb

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.robots.planar_platform import (
    LEG_TYPES,
    REJECTED_LEG_TYPES,
    analyse_platform,
    passive_chain,
    planar_platform,
    planar_platforms,
)
from solutions import all_solutions, home_of, uncompiled


def pairs(sequence: str) -> set[str]:
    return {f"{sequence[:k]}_{sequence[k]}_{sequence[k + 1 :]}" for k in range(3)}


# --- Counts of the source


def test_the_18_types_are_those_of_the_source() -> None:
    """Seven sequences (all but PPP), one driven joint, and no passive chain PP: six for each of RR, PR, RP."""
    sequences = {"".join(s) for s in product("RP", repeat=3)} - {"PPP"}
    every = set().union(*(pairs(s) for s in sequences))
    assert len(every) == 21
    assert {leg for leg in every if passive_chain(leg) == "PP"} == set(REJECTED_LEG_TYPES)
    assert set(LEG_TYPES) == every - set(REJECTED_LEG_TYPES)
    assert len(LEG_TYPES) == 18
    assert [passive_chain(leg) for leg in LEG_TYPES] == ["RR"] * 6 + ["PR"] * 6 + ["RP"] * 6


def test_eight_pairs_are_symmetric() -> None:
    """Printed: of the 18 legs, 8 pairs are each other turned round, which leaves 10."""
    turned = {leg: leg[::-1] for leg in LEG_TYPES}
    assert set(turned.values()) == set(LEG_TYPES)
    assert sum(leg != other for leg, other in turned.items()) == 2 * 8


def test_the_platforms_are_1140() -> None:
    """I.1: all legs alike, plus two alike, plus all different."""
    platforms = list(planar_platforms())
    assert len(platforms) == len({tuple(sorted(p)) for p in platforms}) == 1140
    by_kind = [sum(len(set(p)) == kind for p in platforms) for kind in (1, 2, 3)]
    assert by_kind == [18, 18 * 17, comb(18, 3)]


def test_an_unknown_leg_is_refused_with_the_known_ones() -> None:
    with pytest.raises(po.UnknownNameError, match="'R_P_R'"):
        planar_platform("RPR")
    with pytest.raises(po.DefinitionError, match="leg 2, 'RR_R_', has a part of no length"):
        planar_platform("RR_R_", "RR_R_", elbows=((0.5, 0.2), (0.0, 0.0), (0.5, 0.2)))


# --- The same machines described in another way


def test_three_legs_with_driven_slides_are_the_3_rpr() -> None:
    """Its joints at the platform are cut there, and variables here: drives move alike."""
    welded = planar_platform("R_P_R", "R_P_R", "R_P_R")
    A, b, pose = corners(welded)
    cut = po.robots.three_rpr(base=A, platform=b, pose=pose, strokes=(0.01, 5.0))
    assert_allclose(drive_rates(welded), drive_rates(cut), rtol=0, atol=1e-9)


def test_three_legs_driven_at_the_ground_are_the_3_rrr() -> None:
    welded = planar_platform("_R_RR", "_R_RR", "_R_RR")
    A, b, pose = corners(welded)
    arms = np.array([complex(*p) for p in b]) * cmath.exp(1j * pose[2])
    lines = complex(*pose[:2]) + arms - np.array([complex(*p) for p in A])
    elbows = inspect.signature(planar_platform).parameters["elbows"].default
    bends = np.array([complex(*e) for e in elbows])
    upper, lower = np.abs(lines * bends), np.abs(lines * (1 - bends))
    cut = po.robots.three_rrr(
        base=A, platform=b, pose=pose, proximal=tuple(upper), distal=tuple(lower), elbows=tuple(-np.sign(bends.imag))
    )
    assert_allclose(drive_rates(welded), drive_rates(cut), rtol=0, atol=1e-9)


def corners(robot: po.Robot) -> tuple[tuple, tuple, tuple]:
    """Ends of the legs on the base and on the platform, where the last joints of all legs are hinges; and the pose."""
    links = [link for link in robot.mechanism.links if isinstance(link, po.Series) and link.father == "base"]
    ends = [c for c in robot.mechanism.closures if isinstance(c, po.Weld)]
    pose = tuple(robot.home[n] for n in ("x", "y", "theta"))
    return tuple(k.at[:2] for k in links), tuple((-c.at[0], -c.at[1]) for c in ends), pose


def drive_rates(robot: po.Robot) -> np.ndarray:
    kinematics = uncompiled(robot)
    T = kinematics.tangent(kinematics.configuration(home_of(robot)).X, ("x", "y", "theta"))
    return T[0, : len(robot.mechanism.active)]


@pytest.mark.parametrize(
    "legs", [("_R_RR", "_R_RP", "_P_RR"), ("R_P_P", "_P_RP", "P_P_R"), ("R_R_R", "R_P_R", "RP_P_")], ids="-".join
)
def test_working_modes(legs: tuple[str, str, str]) -> None:
    """Two for RRR, RRP and PRR, one for the others: the product, where a stroke of RPR has one sign."""
    robot = planar_platform(*legs)
    pose = {n: robot.home[n] for n in ("x", "y", "theta")}
    found = all_solutions(uncompiled(robot), pose, starts=300, span=1.0)
    for number, leg in enumerate(legs, start=1):
        if leg == "R_P_R":
            found = found[found[:, robot.mechanism.index(f"P{number}.2")] > 0]
    assert len(found) == robot.facts["working modes"] in (8, 1, 2)


# --- Exceptions and their reasons


@pytest.mark.parametrize(
    ("legs", "drives", "freedoms"),
    [
        (("_R_PP", "P_R_P", "R_P_R"), ("R1.1", "R2.2"), "1 freedom"),
        (("RR_R_", "PP_R_", "PP_R_"), ("R2.3", "R3.3"), "1 freedom"),
        (("_R_PP", "P_R_P", "PP_R_"), ("R1.1", "R2.2", "R3.3"), "2 freedoms"),
    ],
)
def test_two_legs_that_hold_only_the_rotation_are_too_many(
    legs: tuple[str, str, str], drives: tuple[str, ...], freedoms: str
) -> None:
    """Printed: a platform with a passive chain PP is not controllable, or hard to assemble for given drives."""
    report = analyse_platform(planar_platform(*legs))
    assert report.mobility == 3
    assert report.parallel_margin < 1e-12
    assert report.reason.startswith("with its drives held the platform slides without turning at every pose")
    assert freedoms in report.reason
    assert report.drives == drives


def test_one_leg_that_holds_only_the_rotation_is_not() -> None:
    report = analyse_platform(planar_platform("_R_PP", "R_P_R", "R_P_R"))
    assert (report.reason, report.mobility, report.drives) == ("", 3, ())


def rails(directions: tuple[float, float, float]) -> po.Robot:
    """Three legs P_R_R whose passive rails on the base point in given directions [rad]."""
    base, platform = ((-0.5, -0.3), (0.5, -0.4), (0.0, 0.6)), ((-0.1, -0.2), (0.15, -0.15), (-0.15, 0.1))
    elbows = [
        0.2 * cmath.exp(1j * d) / (complex(*b) - complex(*A))
        for d, A, b in zip(directions, base, platform, strict=True)
    ]
    bends = tuple((e.real, e.imag) for e in elbows)
    return planar_platform("P_R_R", "P_R_R", "P_R_R", base, platform, bends, pose=(0.0, 0.0, 0.0))


def test_parallel_passive_rails_let_the_platform_slide() -> None:
    """Three pushes across parallel rails are parallel forces: they cannot hold the platform along the rails."""
    report = analyse_platform(rails((0.4, 0.4, 0.4)))
    assert report.reason.startswith("with its drives held the platform slides without turning at every pose")
    assert report.drives == ("R1.2", "R2.2", "R3.2")
    assert analyse_platform(rails((0.4, 0.4, 0.9))).reason == ""


def test_parallel_slides_in_a_leg_are_a_serial_exception() -> None:
    """Both slides of PPR along one line: they move against each other while the platform stands."""
    straight = ((0.5, 0.0), (0.44, 0.12), (0.44, 0.105))
    report = analyse_platform(planar_platform("_P_PR", "R_P_R", "R_P_R", elbows=straight))
    assert report.reason == "with its platform held the drives move at every pose (1 freedom)"
    assert report.serial_margin < 1e-12
    assert report.poses == 6  # reached by the drives, since the straight leg stops the platform


def test_a_joint_too_many_is_seen_as_mobility() -> None:
    robot = planar_platform()
    links = [
        dataclasses.replace(link, father="extra") if link.name == "leg 1.2" else link for link in robot.mechanism.links
    ]
    links.append(po.Series("extra", "leg 1.1", at=(0.05, 0.02), joint=po.Revolute("extra")))
    mechanism = dataclasses.replace(robot.mechanism, links=links)
    report = analyse_platform(dataclasses.replace(robot, mechanism=mechanism, shapes={}))
    assert (report.mobility, report.reason) == (4, "it has 4 degrees of freedom at every pose")


def test_only_planar_poses_are_judged() -> None:
    with pytest.raises(po.DefinitionError, match="not x, y, theta"):
        analyse_platform(po.robots.two_rpr())
