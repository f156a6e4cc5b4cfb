"""Read cable robots of CASPR: its XML files of bodies, cables, operational spaces and trajectories.

CASPR describes chains of links with many kinds of joints; a `CableRobot` is one free platform, in space or in a plane.
A model of one link that moves freely is read whole. What cannot be expressed (a second link, a joint that carries
forces of its own, a cable that pushes or pulls by itself) is refused by name; what is left out without harm is listed
in `ignored`.

Conventions, from CASPR's own sources: lengths in metres, forces in newtons, angles in radians. Gravity is 9.81 m/s^2
against the world's z (CASPR writes it in the link's frame; a `CableRobot` in the world's). R = Rx(a) Ry(b) Rz(g) for
Euler angles; a quaternion has its real part first. Attachments on a link count from its joint or from its centre of
mass, as `attachment_reference` says. Inertia is the matrix as written (its products are not negated), about the centre
of mass or about the joint. A pulley's `cable_entry_vector` points as the cable runs in. The world of the robot that is
read has its origin where the platform's joint sits on the base, so that its pose is CASPR's q. Planes keep their two
axes: (x, y) of the robot are CASPR's (x, y), (x, z) or (y, z); in the (x, z) plane CASPR counts its angle about y, from
z to x, so it changes sign here.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, unknown_name
from paraopt.io.caspr_motion import DEGREES, CasprTrajectory, read_trajectory_element
from paraopt.io.caspr_parts import PLANES, Body, CableEnds, choose_set, read_cables
from paraopt.io.xml_tree import Element, read_xml
from paraopt.modes.cable import CableRobot

Array = NDArray[np.float64]

GRAVITY = 9.81
SPACES = ("position", "orientation_euler_xyz", "pose_euler_xyz")
ENDINGS = {
    "bodies": ("bodies", "body_properties"),
    "cables": ("cables", "cable_properties"),
    "trajectories": ("trajectories",),
    "spaces": ("operational_spaces", "op"),
}


@dataclass(frozen=True)
class OperationalSpace:
    """Name coordinates of a point of the platform in which tasks are told.

    Attributes:
        set: Name of the set it belongs to.
        name: Its name.
        kind: position, orientation_euler_xyz or pose_euler_xyz.
        offset: The point in the platform's frame [m].
        axes: Coordinates, of x, y, z and the angles a, b, g.
    """

    set: str
    name: str
    kind: str
    offset: tuple[float, ...]
    axes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class CasprModel:
    """Hold what was read of a CASPR model.

    Attributes:
        robot: The cable robot.
        joint: CASPR's type of the platform's joint.
        cable_set: Name of the cables that were taken.
        origin: Where the origin of the robot's world lies in CASPR's [m], shape (3,).
        spaces: Operational spaces of each set, by its name.
        trajectories: Trajectories of the pose, by their names.
        operational_trajectories: Trajectories in an operational space, by their names.
        ignored: What the files say and the robot does not, one sentence each.
    """

    robot: CableRobot
    joint: str
    cable_set: str
    origin: Array
    spaces: Mapping[str, tuple[OperationalSpace, ...]]
    trajectories: Mapping[str, CasprTrajectory]
    operational_trajectories: Mapping[str, CasprTrajectory]
    ignored: tuple[str, ...]


def load_caspr(
    folder: str | os.PathLike[str] | None = None,
    *,
    bodies: str | os.PathLike[str] | None = None,
    cables: str | os.PathLike[str] | None = None,
    spaces: str | os.PathLike[str] | None = None,
    trajectories: str | os.PathLike[str] | None = None,
    cable_set: str | None = None,
) -> CasprModel:
    """Read a model of CASPR.

    Args:
        folder: Folder of the model; its files are found by their endings (..._bodies.xml, ..._cables.xml,
            ..._operational_spaces.xml, ..._trajectories.xml).
        bodies: File of the bodies, where it is not found so.
        cables: File of the cables.
        spaces: File of the operational spaces.
        trajectories: File of the trajectories.
        cable_set: Which set of cables; the one that the file calls its default when None.

    Returns:
        The robot and what comes with it. CASPR knows no limits of speed: give the robot some with
        `dataclasses.replace(model.robot, velocity=..., acceleration=...)`.

    Raises:
        DefinitionError: A file is missing, is no XML or not of this format, a number is wrong, or the model has what a
            `CableRobot` cannot express; file, line, element and value are named.
        UnknownNameError: There is no such set of cables; the message lists them.
        OSError: A file cannot be read.

    Source: LauCASPR2016.
    """
    paths = {"bodies": bodies, "cables": cables, "spaces": spaces, "trajectories": trajectories}
    for key, given in paths.items():
        if given is None and folder is not None:
            paths[key] = _find(Path(folder), key)
    if paths["bodies"] is None or paths["cables"] is None:
        raise DefinitionError(f"a model needs a file of bodies and one of cables; found {_told(paths)}")
    ignored: list[str] = []
    body = Body(read_xml(paths["bodies"]))
    ignored += body.ignored
    root = read_xml(paths["cables"])
    chosen = choose_set(root, cable_set)
    ends = read_cables(chosen, body, ignored)
    robot = _build(body, ends, chosen, f"CASPR model, {_told({k: paths[k] for k in ('bodies', 'cables')})}")
    sets = {} if paths["spaces"] is None else _read_spaces(read_xml(paths["spaces"]), ignored)
    motions: tuple[dict[str, CasprTrajectory], dict[str, CasprTrajectory]] = ({}, {})
    if paths["trajectories"] is not None:
        motions = _read_trajectories(read_xml(paths["trajectories"]), body, ignored)
    return CasprModel(
        robot, body.type, chosen.attribute("id"), body.place, MappingProxyType(sets), MappingProxyType(motions[0]),
        MappingProxyType(motions[1]), tuple(ignored),
    )  # fmt: skip


def _find(folder: Path, key: str) -> Path | None:
    pattern = re.compile(rf"(.*_)?({'|'.join(ENDINGS[key])})\.xml", re.IGNORECASE)
    if not folder.is_dir():
        raise DefinitionError(f"{folder} is no folder")
    found = sorted(p for p in folder.iterdir() if pattern.fullmatch(p.name))
    if len(found) > 1:
        raise DefinitionError(f"{folder} has {len(found)} files of {key}: {', '.join(p.name for p in found)}; name one")
    return found[0] if found else None


def _told(paths: Mapping[str, Any]) -> str:
    return ", ".join(Path(p).name for p in paths.values() if p is not None) or "none"


def _build(body: Body, ends: Sequence[CableEnds], chosen: Element, source: str) -> CableRobot:
    exits = np.array([e.exit - body.place for e in ends])
    at = np.array([e.at for e in ends])
    gravity = np.array([0.0, 0.0, -GRAVITY])
    inertia: Any = body.inertia
    if body.planar:
        normal = ({0, 1, 2} - set(PLANES[body.type][:2])).pop()
        gaps = np.abs(exits - at)[:, normal]
        size = float(np.max(np.abs(exits)))
        if np.any(gaps > 1e-9 * size):
            worst = ends[int(np.argmax(gaps))]
            raise chosen.error(
                f"cable {worst.name!r} leaves the plane of joint type {body.type} by {np.max(gaps):g} m; in a "
                "CableRobot it lies in the plane"
            )
        inertia = float(body.inertia[normal, normal])
    try:
        return CableRobot(
            name=body.name,
            exits=body.plane(exits),
            attachments=body.plane(at),
            mass=body.mass,
            t_min=[e.low for e in ends],
            t_max=[e.high for e in ends],
            home=dict(zip(body.names, body.home.tolist(), strict=True)),
            centre=body.plane(body.centre),
            inertia=inertia,
            planar=body.planar,
            gravity=body.plane(gravity),
            cables=tuple(e.name for e in ends),
            pulleys=tuple(e.pulley for e in ends) if any(e.pulley for e in ends) else None,
            ranges=body.ranges,
            tool=body.plane(body.end) if np.any(body.end) else None,
            source=source,
        )
    except DefinitionError as error:
        raise DefinitionError(f"{body.link.file} with cable set {chosen.attribute('id')!r}: {error}") from error


def _read_spaces(root: Element, ignored: list[str]) -> dict[str, tuple[OperationalSpace, ...]]:
    sets: dict[str, tuple[OperationalSpace, ...]] = {}
    for group in root:
        if group.tag not in ("operational_set", "op_set"):
            raise group.error("is not read; an operational_set belongs here")
        members = []
        for node in group:
            if node.tag not in SPACES:
                raise node.error(str(unknown_name("kind of operational space", node.tag, SPACES)))
            if node.child("link").whole() != 1:
                raise node.child("link").error("an operational space belongs to link 1, the platform")
            axes = tuple(node.child("axes").attribute("active_axes"))
            allowed = {"position": "xyz", "orientation_euler_xyz": "abg", "pose_euler_xyz": "xyzabg"}[node.tag]
            if len(set(axes)) != len(axes) or not set(axes) <= set(allowed):
                raise node.child("axes").error(f"active_axes is {''.join(axes)!r}; letters of {allowed!r}, each once")
            offset = node.find("offset")
            place = (0.0, 0.0, 0.0) if offset is None else tuple(offset.vector(3).tolist())
            members.append(OperationalSpace(group.attribute("id"), node.attribute("name"), node.tag, place, axes))
        _keep(sets, group, tuple(members), ignored)
    return sets


def _read_trajectories(
    root: Element, body: Body, ignored: list[str]
) -> tuple[dict[str, CasprTrajectory], dict[str, CasprTrajectory]]:
    joint: dict[str, CasprTrajectory] = {}
    task: dict[str, CasprTrajectory] = {}
    groups: Iterable[Element] = [root] if root.tag == "joint_trajectories" else root
    for group in groups:
        if group.tag not in ("joint_trajectories", "operational_trajectories"):
            raise group.error("is not read; joint_trajectories or operational_trajectories belong here")
        of_pose = group.tag == "joint_trajectories"
        for node in group:
            if node.tag == "file_trajectory":
                ignored.append(
                    f"{node.file}, line {node.line}: {node.tag} {node.attributes.get('id')!r}, kept elsewhere"
                )
                continue
            if node.tag not in DEGREES:
                raise node.error(str(unknown_name("kind of trajectory", node.tag, [*DEGREES, "file_trajectory"])))
            if of_pose:
                read = read_trajectory_element(node, "q", body.names, body.turned, not body.planar)
            else:
                read = read_trajectory_element(node, "y", None, lambda y, _: y, False)
            _keep(joint if of_pose else task, node, read, ignored)
    return joint, task


def _keep(store: dict[str, Any], node: Element, value: Any, ignored: list[str]) -> None:
    """Keep the first of a name: published models repeat some."""
    name = node.attribute("id")
    if name in store:
        ignored.append(f"{node.file}, line {node.line}: a further <{node.tag}> {name!r}")
    else:
        store[name] = value
