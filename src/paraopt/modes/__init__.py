"""Machines with rules of their own: cables that only pull, feet that stand and lift."""

from paraopt.modes import cable

__all__ = ["cable"]
