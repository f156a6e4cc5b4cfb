"""Files of a cable robot's motion: what is written, what is refused, and what the figures show."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import paraopt as po
from cable_robots import planar
from paraopt.errors import DefinitionError, InfeasibleError
from paraopt.io import cbu_template, read_program, winch_columns
from paraopt.modes.cable import (
    CableCertificate,
    CableRobot,
    MotionChain,
    Pulley,
    WinchLimits,
    cable_functions,
    read_hanging,
    verify_cables,
)

START = {"x": 0.4, "y": 0.45, "z": -0.7, "gamma": 0.0}


@functools.cache
def case() -> tuple[po.Scene, po.Trajectory, CableRobot, CableCertificate]:
    machine = po.robots.larm_hanging(velocity=0.3, acceleration=1.0)
    ball = po.Sphere(name="ball", radius=0.05, pose=po.transform((0.8, 0.8, -0.9)))
    scene = po.Scene(machine, [ball, po.HalfSpace(name="floor", pose=po.transform((0, 0, -1.1)))])
    problem = po.Problem(scene, START, START | {"z": -0.5}, po.Margins(clearance=0.001, singularity=0.01))
    trajectory = po.plan(problem).trajectory
    robot = read_hanging(machine, machine.mechanism.active)
    return scene, trajectory, robot, verify_cables(robot, trajectory, count=301, stability_count=11)


def test_all_files_are_written_and_say_the_same(tmp_path: Path) -> None:
    scene, trajectory, robot, certificate = case()
    files = po.view.save_cables(tmp_path, scene, trajectory, certificate, period=0.02)
    assert list(files) == ["scene", "lengths", "tensions", "page", "winches", "program"]
    assert all(f.stat().st_size > 500 for f in files.values())
    program = read_program(files["program"], cbu_template(winch_columns(robot, digits=6)))
    told = program.values[:-1, 1:]
    exact = trajectory(0.02 * np.arange(len(told)))[:, list(trajectory.robot.mechanism.indices(robot.cables))]
    assert np.max(np.abs(told - exact)) <= 0.5e-6 + 1e-12
    page = files["page"].read_text()
    assert all(f"tension {q}" in page for q in robot.cables)
    assert "sway" in page


def test_winches_behind_pulleys_are_told_what_they_pay_out(tmp_path: Path) -> None:
    robot = planar(
        pulleys=[None, *[Pulley(0.03, (1, 0, 0))] * 3], gravity=(0, -9.81), t_min=1.0, velocity=1.0, acceleration=5.0
    )
    start, goal = {"x": 0.4, "y": 0.45, "theta": 0.0}, {"x": 0.6, "y": 0.55, "theta": 0.1}
    scene = po.Scene(robot.robot)
    trajectory = po.plan(po.Problem(scene, start, goal, dynamics=(WinchLimits(robot),))).trajectory
    certificate = verify_cables(robot, trajectory, count=301)
    files = po.view.save_cables(tmp_path, scene, trajectory, certificate, period=0.02)
    program = read_program(files["program"], cbu_template(winch_columns(robot, digits=6)))
    times = np.minimum(program.times, trajectory.duration)
    poses = trajectory(times)[:, list(trajectory.robot.mechanism.indices(robot.coordinates))]
    assert np.max(np.abs(program.values[:, 1:] - cable_functions(robot).lengths(poses))) <= 0.5e-6 + 1e-12


def test_a_chain_has_named_parts(tmp_path: Path) -> None:
    scene, trajectory, _, certificate = case()
    path = po.view.write_cable_page(
        tmp_path / "page.html", scene, MotionChain([trajectory]), certificate, names=["up we go"]
    )
    assert "up we go" not in path.read_text()  # one part needs no name
    assert len(po.view.draw_cable_scene(scene, MotionChain([trajectory]), times=[0.0, 0.1, 0.2], columns=2).axes) == 3


def test_tensions_are_not_taken_for_lengths(tmp_path: Path) -> None:
    scene, trajectory, _, _ = case()
    unnamed = verify_cables(read_hanging(scene.robot), trajectory, count=301, stability_count=11)
    with pytest.raises(DefinitionError, match="variable 't1' is not the length"):
        po.view.save_cables(tmp_path, scene, trajectory, unnamed)
    assert not list(tmp_path.iterdir())


def test_winches_are_not_told_what_they_cannot_do(tmp_path: Path) -> None:
    scene, trajectory, robot, _ = case()
    slow = verify_cables(replace(robot, velocity=0.1), trajectory, count=301, stability_count=11)
    with pytest.raises(InfeasibleError, match="velocity of 'q"):
        po.view.save_cables(tmp_path, scene, trajectory, slow)
    assert not list(tmp_path.iterdir())


def test_pictures_at_instants() -> None:
    scene, trajectory, _, _ = case()
    figure = po.view.draw_cable_scene(scene, trajectory)
    assert len(figure.axes) == 4
    picture = figure.axes[0].get_images()[0].get_array()
    assert picture is not None
    assert 0.01 < np.mean(np.asarray(picture)[..., 3] > 0.5) < 0.5  # something is drawn, and most is free
    with pytest.raises(DefinitionError, match="nothing to draw"):
        po.view.draw_cable_scene(scene, trajectory, times=[])
    with pytest.raises(DefinitionError, match="time is in"):
        po.view.draw_cable_scene(scene, trajectory, times=[trajectory.duration + 1.0])
