"""In and out: machines as TOML or of CASPR, trajectories as CSV or controller programs, reports as JSON.

Files appear whole or not at all.
"""

from paraopt.io.caspr import CasprModel, OperationalSpace, load_caspr
from paraopt.io.caspr_motion import CasprTrajectory
from paraopt.io.description import load_mechanism, load_obstacles, load_robot, save_mechanism, save_robot
from paraopt.io.files import write_atomically
from paraopt.io.legged import build_legged_report, tabulate_legged, write_legged_trajectory
from paraopt.io.program import Program, build_program, check_commands, read_program, write_program
from paraopt.io.report import build_report, describe, write_report
from paraopt.io.robobasic import RoboBasic, build_robobasic, robobasic_template
from paraopt.io.robobasic_player import Played, play
from paraopt.io.servos import Servo, ServoController, ServoTable, gipo_servos
from paraopt.io.tables import Table, read_trajectory, write_trajectory
from paraopt.io.template import Column, Template
from paraopt.io.winches import cbu_template, csv_template, winch_columns

__all__ = [
    "CasprModel",
    "CasprTrajectory",
    "Column",
    "OperationalSpace",
    "Played",
    "Program",
    "RoboBasic",
    "Servo",
    "ServoController",
    "ServoTable",
    "Table",
    "Template",
    "build_legged_report",
    "build_program",
    "build_report",
    "build_robobasic",
    "cbu_template",
    "check_commands",
    "csv_template",
    "describe",
    "gipo_servos",
    "load_caspr",
    "load_mechanism",
    "load_obstacles",
    "load_robot",
    "play",
    "read_program",
    "read_trajectory",
    "robobasic_template",
    "save_mechanism",
    "save_robot",
    "tabulate_legged",
    "winch_columns",
    "write_atomically",
    "write_legged_trajectory",
    "write_program",
    "write_report",
    "write_trajectory",
]
