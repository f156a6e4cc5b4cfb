"""Random solids, for properties that hold whatever they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import paraopt as po
from paraopt.shapes import Cone, ConvexPolyhedron, HalfSpace, Shape

Array = np.ndarray
# separate bodies are known to 1e-8, depths to some 1e-4 where round solids are deep in each other
APART, DEEP = 1e-7, 5e-4


def draw_pose(random: np.random.Generator, spread: float) -> Array:
    X = np.eye(4)
    X[:3, :3] = Rotation.random(random_state=int(random.integers(1 << 30))).as_matrix()
    X[:3, 3] = random.uniform(-spread, spread, 3)
    return X


DRAW: dict[str, Callable[[np.random.Generator], dict[str, Any]]] = {
    "Box": lambda r: {"size": r.uniform(0.05, 0.5, 3)},
    "Sphere": lambda r: {"radius": r.uniform(0.05, 0.3)},
    "Cylinder": lambda r: {"radius": r.uniform(0.05, 0.3), "length": r.uniform(0.05, 0.8)},
    "Capsule": lambda r: {"radius": r.uniform(0.05, 0.3), "length": r.uniform(0.05, 0.8)},
    "Cone": lambda r: {"radius": r.uniform(0.05, 0.3), "length": r.uniform(0.05, 0.8)},
    "HalfSpace": lambda r: {},
    "ConvexPolyhedron": lambda r: {"vertices": r.normal(size=(r.integers(4, 16), 3)) * r.uniform(0.05, 0.3, 3)},
}
CLASSES: dict[str, type[Shape]] = {
    "Box": po.Box, "Sphere": po.Sphere, "Cylinder": po.Cylinder, "Capsule": po.Capsule, "Cone": Cone,
    "HalfSpace": HalfSpace, "ConvexPolyhedron": ConvexPolyhedron,
}  # fmt: skip


def build(kind: str, sizes: dict[str, Any], pose: Array) -> Shape:
    return CLASSES[kind](pose=pose, **sizes)
