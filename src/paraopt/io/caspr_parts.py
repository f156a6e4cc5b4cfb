"""The platform and the cables of a CASPR model, as its files tell them; see `caspr.py` for the conventions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from paraopt.errors import DefinitionError, unknown_name
from paraopt.io.caspr_motion import angles_xyz
from paraopt.io.xml_tree import Element
from paraopt.modes.cable import Pulley

Array = NDArray[np.float64]

POSE = ("x", "y", "z", "alpha", "beta", "gamma")
PLANES = {"PLANAR_XY": (0, 1, 1), "PLANAR_XZ": (0, 2, -1), "PLANAR_YZ": (1, 2, 1)}
"""Axes of the plane and sign of the angle, by type of joint."""

QUATERNIONS = ("SPATIAL_QUATERNION", "SPATIAL")
FREE = ("SPATIAL_EULER_XYZ", *QUATERNIONS, *PLANES)
HELD = (
    "R_X", "R_Y", "R_Z", "R_AXIS", "U_XY", "U_YZ", "U_XZ", "P_X", "P_AXIS", "P_XY", "P_XZ", "T_XYZ", "S_EULER_XYZ",
    "S_FIXED_XYZ", "S_QUATERNION", "SPHERICAL",
)  # fmt: skip
STIFF = ("cable_linear_spring", "cable_vsd_torsion_spring", "cable_vsd_flexure_linear", "cable_vsd_polynomial")
OTHERS = {
    "cable_passive_linear_spring": "a passive spring pulls with a force of its own",
    "muscle_hill_type": "a muscle has a law of its own",
    "pneumatic_artificial_muscle": "a muscle has a law of its own",
}


class Body:
    """Hold the platform as the file of bodies describes it."""

    def __init__(self, root: Element) -> None:
        self.ignored: list[str] = []
        links = root if root.tag == "links" else root.child("links")
        for other in links:
            if other.tag != "link_rigid":
                raise other.error("is not read; links are link_rigid")
        found = links.all("link_rigid")
        if len(found) != 1:
            names = ", ".join(repr(e.attributes.get("name", "?")) for e in found)
            raise links.error(
                f"has {len(found)} links ({names}); a chain of links is not read, a CableRobot is one platform"
            )
        self.ignored += [f"{root.file}: <{e.tag}>" for e in root if e is not links and root is not links]
        self.link = found[0]
        self.name = self.link.attributes.get("name") or Path(root.file).stem
        self._read_joint(self.link.child("joint"))
        parent = self.link.child("parent")
        if parent.child("num").whole() != 0:
            raise parent.child("num").error("a platform's parent is the base, link 0")
        self.place = parent.child("location").vector(3)
        self._read_physical(self.link.child("physical"))

    def _read_joint(self, joint: Element) -> None:
        self.type = joint.attribute("type")
        if self.type in HELD:
            raise joint.error(
                f"type {self.type} carries forces of its own, as a CableRobot's free platform cannot; types that are "
                f"read: {', '.join(FREE)}"
            )
        if self.type not in FREE:
            raise joint.error(str(unknown_name("type of joint", self.type, [*FREE, *HELD])))
        if joint.attributes.get("actuated", "false") != "false":
            raise joint.error("is actuated; a CableRobot's platform is driven by cables alone")
        self.planar = self.type in PLANES
        self.names = ("x", "y", "theta") if self.planar else POSE
        self.home = self.turned(joint.vector(None, "q_initial"), joint)
        self.ranges: dict[str, tuple[float, float]] = {}
        if not {"q_min", "q_max"} & set(joint.attributes):
            return
        if self.type in QUATERNIONS:
            self.ignored.append(f"{joint.file}, line {joint.line}: ranges of the quaternion")
            return
        ends = [self.turned(joint.vector(None, key), joint) for key in ("q_min", "q_max")]
        lows, highs = ends if not self.planar else (np.minimum(*ends), np.maximum(*ends))
        self.ranges = {n: (float(a), float(b)) for n, a, b in zip(self.names, lows, highs, strict=True)}

    def _read_physical(self, physical: Element) -> None:
        self.mass = physical.child("mass").number()
        self.centre = physical.child("com_location").vector(3)
        end = physical.find("end_location")
        self.end = np.zeros(3) if end is None else end.vector(3)
        inertia = physical.child("inertia")
        xx, yy, zz, xy, xz, yz = (inertia.child(f"I{k}").number() for k in ("xx", "yy", "zz", "xy", "xz", "yz"))
        self.inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        reference = inertia.attribute("ref")
        if reference == "joint":
            c = self.centre
            self.inertia = self.inertia - self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        elif reference != "com":
            raise inertia.error(f"ref is {reference!r}; it must be com or joint")

    def turned(self, q: Array, element: Element) -> Array:
        """Turn CASPR's joint values, or their derivatives, into coordinates of the pose."""
        width = 7 if self.type in QUATERNIONS else len(self.names)
        if len(q) != width:
            raise element.error(f"has {len(q)} values; joint type {self.type} has {width}")
        if self.planar:
            return q * np.array([1.0, 1.0, PLANES[self.type][2]])
        if width == 6:
            return q
        if not np.linalg.norm(q[3:]) > 1e-9:
            raise element.error("has the quaternion zero, which is no orientation")
        return np.concatenate([q[:3], angles_xyz(Rotation.from_quat(q[[4, 5, 6, 3]]))])

    def plane(self, points: Array) -> Array:
        """Take the two coordinates in the plane, or all three."""
        return points[..., list(PLANES[self.type][:2])] if self.planar else points


@dataclass(frozen=True)
class CableEnds:
    """Hold a cable: its name, exit, attachment, tensions, pulley; points in CASPR's world and the link's frame [m]."""

    name: str
    exit: Array
    at: Array
    low: float
    high: float
    pulley: Pulley | None


def choose_set(root: Element, wanted: str | None) -> Element:
    """Find the set of cables that is wanted, the file's default, or its first."""
    sets = root.all("cable_set")
    if not sets:
        raise root.error("has no <cable_set>")
    name = wanted if wanted is not None else root.attributes.get("default_cable_set") or sets[0].attribute("id")
    found = [s for s in sets if s.attributes.get("id") == name]
    if not found:
        raise unknown_name(f"cable set of {root.file}", name, [s.attributes.get("id", "") for s in sets])
    return found[0]


def read_cables(chosen: Element, body: Body, ignored: list[str]) -> list[CableEnds]:
    """Read the cables of a set; what is left out is added to `ignored`."""
    ends: list[CableEnds] = []
    for element in chosen:
        name = given = element.attributes.get("name") or f"cable {len(ends) + 1}"
        if element.tag in OTHERS:
            raise element.error(f"{name!r} is not read: {OTHERS[element.tag]}")
        if element.tag in STIFF:
            ignored.append(f"{element.file}, line {element.line}: stiffness of {element.tag} {name!r}")
        elif element.tag != "cable_ideal":
            raise element.error(str(unknown_name("kind of cable", element.tag, ["cable_ideal", *STIFF, *OTHERS])))
        if any(e.name == given for e in ends):  # published models repeat some
            name = f"{given} ({len(ends) + 1})"
            ignored.append(f"{element.file}, line {element.line}: name {given!r} stands twice; here {name!r}")
        reference = element.attribute("attachment_reference")
        if reference not in ("joint", "com"):
            raise element.error(f"attachment_reference is {reference!r}; it must be joint or com")
        properties = element.child("properties")
        points = _read_points(element, name, body.centre if reference == "com" else np.zeros(3), ignored)
        low, high = (properties.child(f"force_{k}").number() for k in ("min", "max"))
        ends.append(CableEnds(name, points[0], points[1], low, high, points[2]))
    if not ends:
        raise chosen.error("has no cable")
    return ends


def _read_points(cable: Element, name: str, shift: Array, ignored: list[str]) -> tuple[Array, Array, Pulley | None]:
    points: list[tuple[int, Array, Pulley | None]] = []
    for node in cable.child("attachments"):
        if node.tag == "attachment":
            link = node.child("link").whole()
            if link not in (0, 1):
                raise node.child("link").error(f"cable {name!r} holds link {link}; there are 0 (base) and 1")
            points.append((link, node.child("location").vector(3) + (shift if link else 0.0), None))
        elif node.tag == "base_rotating_pulley":
            if points:
                raise node.error(f"stands in the middle of cable {name!r}; a pulley is its first point")
            radius, axis = node.child("pulley_radius"), node.child("cable_entry_vector")
            try:
                pulley = Pulley(radius.number(), axis.vector(3).tolist())
            except DefinitionError as error:
                raise node.error(str(error)) from error
            points.append((0, node.child("fixed_location").vector(3), pulley))
        else:
            raise node.error(f"of cable {name!r} is not read; points are attachment or base_rotating_pulley")
    links = [link for link, *_ in points]
    if links and links[0] == 1:
        points.reverse()
        links.reverse()
    if len(links) < 2 or links[-1] != 1 or any(links[:-1]):
        raise cable.error(
            f"{name!r} runs over links {links}; a CableRobot's runs once, from the base (0) to the platform (1)"
        )
    if len(links) > 2:
        if any(p[2] for p in points):
            raise cable.error(f"{name!r} runs over a pulley and further points of the base; one of them is read")
        ignored.append(f"{cable.file}, line {cable.line}: the part of {name!r} that stays on the base")
    return points[-2][1], points[-1][1], points[-2][2]
