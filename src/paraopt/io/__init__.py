"""In and out: machines as TOML, trajectories as CSV, reports as JSON; files appear whole or not at all."""

from paraopt.io.description import load_mechanism, load_obstacles, load_robot, save_mechanism, save_robot
from paraopt.io.files import write_atomically
from paraopt.io.legged import build_legged_report, tabulate_legged, write_legged_trajectory
from paraopt.io.report import build_report, describe, write_report
from paraopt.io.tables import Table, read_trajectory, write_trajectory

__all__ = [
    "Table",
    "build_legged_report",
    "build_report",
    "describe",
    "load_mechanism",
    "load_obstacles",
    "load_robot",
    "read_trajectory",
    "save_mechanism",
    "save_robot",
    "tabulate_legged",
    "write_atomically",
    "write_legged_trajectory",
    "write_report",
    "write_trajectory",
]
