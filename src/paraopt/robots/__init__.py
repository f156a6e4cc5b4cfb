"""The library: one file per robot of the literature, with its source."""

from paraopt.robots.delta import delta
from paraopt.robots.five_bar import five_bar
from paraopt.robots.gipo import gipo
from paraopt.robots.gosselin import gosselin_wrist
from paraopt.robots.hayward import hayward_wrist
from paraopt.robots.hexa import hexa
from paraopt.robots.larm import larm_planar, larm_spatial
from paraopt.robots.lee import lee
from paraopt.robots.logabex import logabex
from paraopt.robots.lynx import lynx
from paraopt.robots.raf import raf
from paraopt.robots.six_three import six_three
from paraopt.robots.stewart import stewart
from paraopt.robots.three_upu import three_upu
from paraopt.robots.tripod import tripod
from paraopt.robots.two_delta import two_delta

__all__ = [
    "delta",
    "five_bar",
    "gipo",
    "gosselin_wrist",
    "hayward_wrist",
    "hexa",
    "larm_planar",
    "larm_spatial",
    "lee",
    "logabex",
    "lynx",
    "raf",
    "six_three",
    "stewart",
    "three_upu",
    "tripod",
    "two_delta",
]
