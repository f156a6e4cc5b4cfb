"""Seeders: each finds a first way from start to goal."""

from paraopt.planning.seed.base import Seed, Seeder
from paraopt.planning.seed.mixed import MixedSearch

__all__ = ["MixedSearch", "Seed", "Seeder"]
