"""A motion of a cable robot as files: figures, a page with tensions beside it, and what its winches are told."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from paraopt.errors import DefinitionError, unknown_name
from paraopt.io import build_program, cbu_template, csv_template, winch_columns
from paraopt.modes.cable import CableCertificate, CableRobot, MotionChain, WinchMotion, cable_functions
from paraopt.modes.cable.distribution import coordinate_places
from paraopt.planning import Trajectory
from paraopt.scene import Scene
from paraopt.view.cable_figures import draw_lengths, draw_tensions
from paraopt.view.cable_scene import draw_cable_scene
from paraopt.view.content import PathLine, Phase, Readout
from paraopt.view.figures import save_figure
from paraopt.view.motion import list_page_bodies, list_page_cables
from paraopt.view.page import write_page


def save_cables(
    folder: str | os.PathLike[str],
    scene: Scene,
    motion: Trajectory | MotionChain,
    certificate: CableCertificate,
    *,
    period: float = 1e-2,
    names: Sequence[str] = (),
) -> dict[str, Path]:
    """Write what the cables of a motion do: figures (PNG), a page (HTML), commands of the winches (CSV, .cbu).

    Args:
        folder: Where to; made when missing. Each file appears whole or not at all.
        scene: The robot among its obstacles.
        motion: A motion of its robot, or a chain of them.
        certificate: Its certificate, which holds the tensions and the cable robot.
        period: Time between commands of the winches [s].
        names: Names of the motions of a chain, for the page.

    Returns:
        The files by name: "scene", "lengths", "tensions", "page", "winches", "program".

    Raises:
        DefinitionError: A variable that bears the name of a cable is not its length.
        InfeasibleError: A command exceeds a limit of its winch; nothing is written then.
    """
    target, robot = Path(folder), certificate.robot
    _check_names(robot, motion)
    columns = winch_columns(robot, digits=6)  # micrometres
    paid = WinchMotion(robot, motion)
    programs = {
        name: build_program(paid, template, period, fields={"robot": robot.name} if name == "program" else None)
        for name, template in (("winches", csv_template(columns)), ("program", cbu_template(columns)))
    }
    how = f"{motion.duration:.2f} s"
    figures = {
        "scene": draw_cable_scene(scene, motion),
        "lengths": draw_lengths(robot, motion, title=f"{robot.name}: lengths of the cables, {how}"),
        "tensions": draw_tensions(certificate.tensions, title=f"{robot.name}: tensions of the cables, {how}"),
    }
    return {
        **{name: save_figure(figure, target / f"{name}.png") for name, figure in figures.items()},
        "page": write_cable_page(target / "cables.html", scene, motion, certificate, names=names),
        "winches": programs["winches"].write(target / "winches.csv"),
        "program": programs["program"].write(target / "winches.cbu"),
    }


def write_cable_page(
    path: str | os.PathLike[str],
    scene: Scene,
    motion: Trajectory | MotionChain,
    certificate: CableCertificate,
    *,
    names: Sequence[str] = (),
    frames_per_second: float = 60.0,
) -> Path:
    """Write the moving robot with the tensions of its cables as one page that opens offline and plays.

    Args:
        path: Target file.
        scene: The robot among its obstacles.
        motion: A motion of its robot, or a chain of them.
        certificate: Its certificate, which holds the tensions.
        names: Names of the motions of a chain.
        frames_per_second: Sampled poses per second; the page interpolates between them.

    Returns:
        The target.
    """
    robot = certificate.robot
    t = np.linspace(0.0, motion.duration, max(2, int(np.ceil(motion.duration * frames_per_second)) + 1))
    X = motion(t)
    known = np.linspace(0.0, motion.duration, len(certificate.needed))
    tensions = np.column_stack([np.interp(t, known, values) for values in certificate.needed.T])
    readouts = []
    if scene.pairs:
        readouts.append(Readout("clearance", "mm", 1e3 * scene.clearances(X)[0]))
    if robot.n_cables <= 4:
        readouts += [
            Readout(f"tension {name}", "N", values, float(low))
            for name, values, low in zip(robot.cables, tensions.T, robot.t_min, strict=True)
        ]
    else:
        readouts.append(Readout("capacity margin", "N", np.interp(t, known, certificate.margins), 0.0))
        readouts.append(Readout("least tension", "N", tensions.min(axis=1), float(np.min(robot.t_min))))
        readouts.append(Readout("largest tension", "N", tensions.max(axis=1), float(np.max(robot.t_max)), "upper"))
    if certificate.hangs:
        unbalanced = 100.0 * np.interp(t, known, certificate.unbalanced)
        bound = 100.0 * certificate["unbalanced / weight"].bound
        readouts.append(Readout("sway", "% of weight", unbalanced, bound, "upper"))
    origin = X[:, coordinate_places(robot, motion.robot.mechanism)]
    way = np.zeros((len(t), 3))
    for i, axis in enumerate("xy" if robot.planar else "xyz"):
        way[:, i] = origin[:, robot.coordinates.index(axis)]
    borders = motion.borders if isinstance(motion, MotionChain) else np.array([0.0, motion.duration])
    phases = [Phase(*v) for v in zip(names, borders[:-1], borders[1:], strict=True)] if len(names) > 1 else []
    return write_page(
        path,
        title=f"{robot.name}: {'certified' if certificate.passed else 'NOT certified'} tensions",
        bodies=list_page_bodies(scene),
        cables=list_page_cables(scene),
        phases=phases,
        times=t,
        poses=scene.robot.kinematics.poses(X),
        paths=[PathLine("path of the platform", way)],
        readouts=readouts,
        up="y" if robot.planar and np.any(robot.gravity) else "z",
        caption=f"{motion.duration:.3f} s",
    )


def _check_names(robot: CableRobot, motion: Trajectory | MotionChain) -> None:
    """Refuse to tell winches what is no length."""
    mechanism = motion.robot.mechanism
    if missing := [c for c in robot.cables if c not in mechanism.names]:
        raise unknown_name(f"length of a cable of {robot.name!r}", missing[0], mechanism.active)
    X = motion(np.linspace(0.0, motion.duration, 101))
    lengths = cable_functions(robot).lengths(X[:, coordinate_places(robot, mechanism)])
    off = np.max(np.abs(X[:, list(mechanism.indices(robot.cables))] - lengths), axis=0)
    # over a pulley the winch pays out another length, which the program takes from the pose
    off[[pulley is not None for pulley in robot.pulleys or (None,) * robot.n_cables]] = 0.0
    if np.max(off) > 1e-6:
        i = int(np.argmax(off))
        raise DefinitionError(
            f"variable {robot.cables[i]!r} is not the length of the cable of this name of {robot.name!r}: they are "
            f"{off[i]:.3g} m apart; name the cables as the lengths (`read_hanging(robot, robot.mechanism.active)`)"
        )
