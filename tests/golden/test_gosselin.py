"""Gosselin's wrist: Lahouar, I.2 (concurrent axes); its eight working and at most eight assembly modes."""

from __future__ import annotations

import functools

import numpy as np
from numpy.testing import assert_allclose

import paraopt as po

Array = np.ndarray
ANGLES = ("alpha", "beta", "gamma")


@functools.cache
def wrist(degrees: float = 80.0) -> po.Robot:
    return po.robots.gosselin_wrist(arcs=(np.radians(degrees), np.radians(degrees)))


def all_postures(robot: po.Robot, impose: dict[str, float], starts: int = 500) -> list[Array]:
    """Find every posture by starting everywhere; two postures differ where some link stands differently."""
    kinematics = robot.kinematics
    X = np.random.default_rng(0).uniform(-np.pi, np.pi, size=(starts, 9))
    batch = kinematics.solve_batch(tuple(impose), np.tile(list(impose.values()), (starts, 1)), X)
    found: list[tuple[Array, Array]] = []
    for x in batch.X[batch.converged]:
        poses = kinematics.poses(x)[0]
        # Newton stops at 1e-9 even where the posture is singular, as half of those of the Agile Eye are
        if not any(np.max(np.abs(poses - other)) < 1e-4 for _, other in found):
            found.append(((x + np.pi) % (2 * np.pi) - np.pi, poses))
    return [x for x, _ in found]


def test_counts_and_ranks() -> None:
    report = po.report_state(wrist().kinematics, wrist().home_configuration)
    assert (report.n_variables, report.n_equations, report.ranks["E"].value, report.mobility) == (9, 9, 6, 3)
    assert [report.ranks[k].value for k in ("M", "N", "K", "[M N]", "[N K]")] == [3, 3, 3, 6, 6]


def test_all_axes_meet_in_the_centre_of_the_plate() -> None:
    """No link has an origin away from the centre, and each keeps its angle between its axes."""
    home = wrist().home_configuration
    poses = dict(zip([k.name for k in wrist().mechanism.links], wrist().kinematics.poses(home.X)[0], strict=True))
    assert_allclose([pose[:3, 3] for pose in poses.values()], 0, atol=0)
    for i in (1, 2, 3):
        first, second = (poses[f"{kind} {i}"][:3, 2] for kind in ("proximal", "distal"))
        assert_allclose(first @ second, np.cos(np.radians(80)), atol=1e-12)


def test_eight_working_modes() -> None:
    """Each leg has its elbow on one side or the other; the product is eight, one for each triple of signs."""
    postures = np.array(all_postures(wrist(), dict.fromkeys(ANGLES, 0.2)))
    elbows = np.sign(postures[:, 3:6]).astype(int)
    assert len(postures) == len({tuple(e) for e in elbows.tolist()}) == 8


def test_eight_assembly_modes_all_regular() -> None:
    postures = all_postures(wrist(), dict(zip(("q1", "q2", "q3"), (2.3, 2.8, 2.5), strict=True)))
    assert len(postures) == 8
    kinematics = wrist().kinematics
    margins = [po.report_state(kinematics, kinematics.configuration(x)) for x in postures]
    assert min(m.parallel_margin for m in margins) > 0.1
    assert min(m.serial_margin for m in margins) > 0.005
    assert all(m.ranks["[M N]"].value == 6 for m in margins)


def test_four_assembly_modes_of_the_agile_eye_do_not_follow_the_drives() -> None:
    """With arcs of 90 degrees four postures remain that are regular: those that Bonev, Chablat and Wenger count."""
    agile_eye = wrist(90.0)
    postures = all_postures(agile_eye, dict(zip(("q1", "q2", "q3"), (2.3, 2.8, 2.5), strict=True)))
    kinematics = agile_eye.kinematics
    serial = np.array([po.report_state(kinematics, kinematics.configuration(x)).serial_margin for x in postures])
    assert len(postures) == 8
    assert np.count_nonzero(serial < 1e-6) == 4
    assert np.count_nonzero(serial > 0.1) == 4
