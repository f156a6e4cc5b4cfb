"""A planned motion as figures and as a page: what the other modules of the room draw, taken from the planning room."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import unknown_name
from paraopt.mechanism import Mechanism
from paraopt.mechanism.links import as_point
from paraopt.planning import Certificate, Problem, Seed, Trajectory
from paraopt.scene import Scene
from paraopt.scene.pairs import WORLD
from paraopt.shapes import Cable, Shape
from paraopt.view.content import Body, CableLine, Mark, PathLine, Phase, Readout
from paraopt.view.figures import draw_actuators, draw_margins
from paraopt.view.page import write_page
from paraopt.view.path_figure import draw_path
from paraopt.view.space import list_link_kinds

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


def list_page_bodies(scene: Scene) -> tuple[Body, ...]:
    """List the solids of a scene with the kind that decides their colour; cables are listed by `list_page_cables`."""
    kinds = {**list_link_kinds(scene.robot.mechanism), "world": "obstacle"}
    solids = [(b, b.shape) for b in scene.bodies if isinstance(b.shape, Shape)]
    return tuple(Body(b.name, shape, -1 if b.frame == WORLD else b.frame, kinds[b.link]) for b, shape in solids)


def list_page_cables(scene: Scene) -> tuple[CableLine, ...]:
    """List the cables of a scene, those of its robot and its own."""
    cables = [(b, b.shape) for b in scene.bodies if isinstance(b.shape, Cable)]
    return tuple(CableLine(b.name, (b.frame, b.frame_B), np.array(c.points), c.radius) for b, c in cables)


def mark_link(
    mechanism: Mechanism, label: str, link: str, point: Sequence[float] | None = None, color: str = ""
) -> Mark:
    """Mark a link, or a point of it, for a phase of a page whose poses are those of `Kinematics.poses`.

    Args:
        mechanism: The mechanism.
        label: What it means, such as "fixed foot".
        link: Name of the link.
        point: Point in the link's frame [m], shape (3,) or (2,) in the plane; None colours the link's solids.
        color: "#RRGGBB", or "" for that of the label.

    Returns:
        The mark.

    Raises:
        UnknownNameError: There is no such link.
    """
    links = [k.name for k in mechanism.links]
    if link not in links:
        raise unknown_name(f"link of mark {label!r}:", link, links)
    at = None if point is None else as_point(point, f"point of mark {label!r}")
    return Mark(label, links.index(link), at, color)


def list_cable_ends(scene: Scene, X: Array) -> Array:
    """Follow the ends of the cables of a scene [m]; shape (n, n_cables, 2, 3)."""
    poses = scene.robot.kinematics.poses(X)
    links = [k.name for k in scene.robot.mechanism.links]
    frames = np.array([[links.index(link) for link in c.links] for c in scene.all_cables], dtype=int).reshape(-1, 2)
    points = np.array([c.points for c in scene.all_cables], dtype=float).reshape(-1, 2, 3)
    X_WL = poses[:, frames]
    return np.asarray(np.einsum("ncsij,csj->ncsi", X_WL[..., :3, :3], points) + X_WL[..., :3, 3])


def trace(problem: Problem, X: Array) -> Array:
    """Follow the robot's tool point; shape (n, 3) [m]."""
    mechanism = problem.robot.mechanism
    carrier = next(v.link for v in mechanism.variables if v.role == "operational")
    link, point = problem.robot.tool or (carrier, (0.0, 0.0, 0.0))
    poses = problem.robot.kinematics.poses(X)[:, [k.name for k in mechanism.links].index(link)]
    return poses[:, :3, :3] @ np.asarray(point) + poses[:, :3, 3]


def draw_motion(problem: Problem, seed: Seed, trajectory: Trajectory, certificate: Certificate) -> dict[str, Figure]:
    """Draw the figures of a planned motion.

    Args:
        problem: What was asked.
        seed: The first way.
        trajectory: The timed motion.
        certificate: Its certificate.

    Returns:
        Figures by name: "path", "actuators", "margins".
    """
    mechanism = problem.robot.mechanism
    state = trajectory.state(np.linspace(0.0, trajectory.duration, 801))
    names, a = tuple(mechanism.active), len(mechanism.active)
    line = trace(problem, state.X)
    lines = [PathLine("seed", trace(problem, seed.X), dashed=True), PathLine("refined path", line)]
    low, high = problem.bounds.bounds(mechanism)
    velocity, acceleration = (problem.bounds.of(q, names) for q in ("velocity", "acceleration"))
    return {
        "path": draw_path(
            lines,
            problem.scene.obstacles,
            start=line[0],
            goal=line[-1],
            cables=list_cable_ends(problem.scene, state.X[:: len(state.X) // 4]),
            title=f"{problem.robot.name}: path in space",
        ),
        "actuators": draw_actuators(
            state.t,
            names,
            state.X[:, :a],
            state.velocity[:, :a],
            state.acceleration[:, :a],
            units=[v.unit for v in mechanism.variables[:a]],
            position_limits=np.column_stack([low[:a], high[:a]]),
            velocity_limits=np.column_stack([-velocity, velocity]),
            acceleration_limits=np.column_stack([-acceleration, acceleration]),
            title=f"{problem.robot.name}: actuators, {trajectory.method}",
        ),
        "margins": draw_margins(
            certificate.t,
            certificate.clearance if problem.scene.pairs else None,
            problem.margins.clearance,
            {"parallel": certificate.parallel_margin, "serial": certificate.serial_margin},
            problem.margins.singularity,
            title=f"{problem.robot.name}: margins along the motion",
        ),
    }


def write_motion_page(
    path: str | os.PathLike[str],
    problem: Problem,
    seed: Seed,
    trajectory: Trajectory,
    certificate: Certificate,
    frames_per_second: float = 60.0,
    phases: Sequence[Phase] = (),
) -> Path:
    """Write the moving robot and its obstacles as one page that opens offline and plays.

    Args:
        path: Target file.
        problem: What was asked.
        seed: The first way.
        trajectory: The timed motion.
        certificate: Its certificate.
        frames_per_second: Sampled poses per second; the page interpolates between them.
        phases: Named parts of the motion with what stands out in them, see `mark_link`.

    Returns:
        The target.
    """
    count = max(2, int(np.ceil(trajectory.duration * frames_per_second)) + 1)
    t = np.linspace(0.0, trajectory.duration, count)
    X = trajectory(t)
    mechanism = problem.robot.mechanism

    def at(values: Array) -> Array:
        return np.interp(t, certificate.t, values)

    readouts = []
    if problem.scene.pairs:
        clearance = 1e3 * at(certificate.clearance)
        readouts.append(Readout("clearance", "mm", clearance, 1e3 * problem.margins.clearance))
    readouts.append(Readout("parallel margin", "", at(certificate.parallel_margin), problem.margins.singularity))
    for i, variable in enumerate(mechanism.variables[: len(mechanism.active)]):
        unit, factor = {"length": ("mm", 1e3), "angle": ("deg", 180.0 / np.pi), "force": ("N", 1.0)}[variable.kind]
        readouts.append(Readout(variable.name, unit, X[:, i] * factor))
    return write_page(
        path,
        title=f"{problem.robot.name}: certified motion"
        if certificate.passed
        else f"{problem.robot.name}: NOT certified",
        bodies=list_page_bodies(problem.scene),
        cables=list_page_cables(problem.scene),
        phases=phases,
        times=t,
        poses=problem.robot.kinematics.poses(X),
        paths=[PathLine("seed", trace(problem, seed.X), dashed=True), PathLine("refined path", trace(problem, X))],
        readouts=readouts[:6],
        caption=f"{trajectory.duration:.3f} s, {trajectory.method}",
    )
