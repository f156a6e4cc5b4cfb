"""The library: one file per robot of the literature, with its source."""

from paraopt.robots.delta import delta
from paraopt.robots.five_bar import five_bar
from paraopt.robots.hexa import hexa
from paraopt.robots.lee import lee
from paraopt.robots.logabex import logabex
from paraopt.robots.raf import raf
from paraopt.robots.six_three import six_three
from paraopt.robots.stewart import stewart
from paraopt.robots.three_upu import three_upu
from paraopt.robots.two_delta import two_delta

__all__ = [
    "delta",
    "five_bar",
    "hexa",
    "lee",
    "logabex",
    "raf",
    "six_three",
    "stewart",
    "three_upu",
    "two_delta",
]
