"""Machines with rules of their own: cables that only pull, feet that stand and lift."""

from paraopt.modes import cable, legged

__all__ = ["cable", "legged"]
