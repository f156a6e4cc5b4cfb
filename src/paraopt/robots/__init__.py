"""The library: one file per robot of the literature, with its source."""

from paraopt.robots.delta import delta
from paraopt.robots.five_bar import five_bar
from paraopt.robots.gipo import gipo, gipo_machine
from paraopt.robots.gosselin import gosselin_wrist
from paraopt.robots.hayward import hayward_wrist
from paraopt.robots.hexa import hexa
from paraopt.robots.larm import larm_hanging, larm_planar, larm_spatial
from paraopt.robots.lee import lee
from paraopt.robots.logabex import logabex
from paraopt.robots.lynx import lynx
from paraopt.robots.planar_platform import planar_platform
from paraopt.robots.raf import raf
from paraopt.robots.serial_2r import serial_2r
from paraopt.robots.serial_2rp import serial_2rp
from paraopt.robots.six_three import six_three
from paraopt.robots.stewart import stewart
from paraopt.robots.three_rpr import three_rpr, three_rpr_innocenti
from paraopt.robots.three_rrr import three_rrr
from paraopt.robots.three_upu import three_upu
from paraopt.robots.tripod import tripod, walking_tripod
from paraopt.robots.two_delta import two_delta
from paraopt.robots.two_rpr import two_rpr

__all__ = [
    "delta",
    "five_bar",
    "gipo",
    "gipo_machine",
    "gosselin_wrist",
    "hayward_wrist",
    "hexa",
    "larm_hanging",
    "larm_planar",
    "larm_spatial",
    "lee",
    "logabex",
    "lynx",
    "planar_platform",
    "raf",
    "serial_2r",
    "serial_2rp",
    "six_three",
    "stewart",
    "three_rpr",
    "three_rpr_innocenti",
    "three_rrr",
    "three_upu",
    "tripod",
    "two_delta",
    "two_rpr",
    "walking_tripod",
]
