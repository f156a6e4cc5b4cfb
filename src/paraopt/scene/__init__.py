"""Space: a robot among obstacles, the pairs that are checked, and clearance with its gradient."""

from paraopt.scene.pairs import Body, Pair, SkippedPair
from paraopt.scene.scene import Clearance, Distances, Scene

__all__ = ["Body", "Clearance", "Distances", "Pair", "Scene", "SkippedPair"]
