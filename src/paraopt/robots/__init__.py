"""The library: one file per robot of the literature, with its source."""

from paraopt.robots.five_bar import five_bar
from paraopt.robots.raf import raf

__all__ = ["five_bar", "raf"]
