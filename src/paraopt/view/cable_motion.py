"""A motion of a cable robot as files: figures of lengths and tensions, and what its winches are told."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from paraopt.errors import DefinitionError, unknown_name
from paraopt.io import build_program, cbu_template, csv_template, winch_columns
from paraopt.modes.cable import CableCertificate, CableRobot, MotionChain, cable_functions
from paraopt.modes.cable.distribution import coordinate_places
from paraopt.planning import Trajectory
from paraopt.view.cable_figures import draw_lengths, draw_tensions
from paraopt.view.figures import save_figure


def save_cables(
    folder: str | os.PathLike[str],
    motion: Trajectory | MotionChain,
    certificate: CableCertificate,
    *,
    period: float = 1e-2,
) -> dict[str, Path]:
    """Write what the cables of a motion do: figures of lengths and tensions (PNG), commands of the winches (CSV, .cbu).

    Args:
        folder: Where to; made when missing. Each file appears whole or not at all.
        motion: The motion, or a chain of them.
        certificate: Its certificate, which holds the tensions and the cable robot.
        period: Time between commands of the winches [s].

    Returns:
        The files by name: "lengths", "tensions", "winches", "program".

    Raises:
        DefinitionError: A variable that bears the name of a cable is not its length.
        InfeasibleError: A command exceeds a limit of its winch; nothing is written then.
    """
    target, robot = Path(folder), certificate.robot
    _check_names(robot, motion)
    columns = winch_columns(robot, digits=6)  # micrometres
    programs = {
        name: build_program(motion, template, period, fields={"robot": robot.name} if name == "program" else None)
        for name, template in (("winches", csv_template(columns)), ("program", cbu_template(columns)))
    }
    title = f"{robot.name}: {{}}, {motion.duration:.2f} s"
    return {
        "lengths": save_figure(
            draw_lengths(robot, motion, title=title.format("lengths of the cables")), target / "lengths.png"
        ),
        "tensions": save_figure(
            draw_tensions(certificate.tensions, title=title.format("tensions of the cables")), target / "tensions.png"
        ),
        "winches": programs["winches"].write(target / "winches.csv"),
        "program": programs["program"].write(target / "winches.cbu"),
    }


def _check_names(robot: CableRobot, motion: Trajectory | MotionChain) -> None:
    """Refuse to tell winches what is no length."""
    mechanism = motion.robot.mechanism
    if missing := [c for c in robot.cables if c not in mechanism.names]:
        raise unknown_name(f"length of a cable of {robot.name!r}", missing[0], mechanism.active)
    X = motion(np.linspace(0.0, motion.duration, 101))
    lengths = cable_functions(robot).lengths(X[:, coordinate_places(robot, mechanism)])
    off = np.max(np.abs(X[:, list(mechanism.indices(robot.cables))] - lengths), axis=0)
    if np.max(off) > 1e-6:
        i = int(np.argmax(off))
        raise DefinitionError(
            f"variable {robot.cables[i]!r} is not the length of the cable of this name of {robot.name!r}: they are "
            f"{off[i]:.3g} m apart; name the cables as the lengths (`read_hanging(robot, robot.mechanism.active)`)"
        )
