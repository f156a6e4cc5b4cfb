"""Robots held by cables: the model, tensions, wrench-feasible poses, and their margins along motions."""

from paraopt.modes.cable.model import PLATFORM, CableRobot
from paraopt.modes.cable.winch import Drum, Pulley

__all__ = ["PLATFORM", "CableRobot", "Drum", "Pulley"]
