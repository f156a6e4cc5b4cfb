"""Maps: what holds where in the workspace."""

from paraopt.workspace.conditioning import ConditioningMap, map_conditioning

__all__ = ["ConditioningMap", "map_conditioning"]
