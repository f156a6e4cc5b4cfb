"""Seeders: each finds a first way from start to goal."""

from paraopt.planning.seed.base import Seed, Seeder
from paraopt.planning.seed.first_success import FirstSuccess
from paraopt.planning.seed.mixed import MixedSearch
from paraopt.planning.seed.roadmap import GrownRoadmap, Roadmap
from paraopt.planning.seed.rrt_connect import RRTConnect

__all__ = ["FirstSuccess", "GrownRoadmap", "MixedSearch", "RRTConnect", "Roadmap", "Seed", "Seeder"]
