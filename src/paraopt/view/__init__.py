"""Look at a robot and its motion: a page that plays it, and figures of what happens along it."""

from paraopt.view.cable_figures import draw_cable_workspace, draw_lengths, draw_tensions
from paraopt.view.cable_motion import save_cables, write_cable_page
from paraopt.view.cable_scene import draw_cable_scene
from paraopt.view.content import Body, CableLine, Mark, PathLine, Phase, Readout
from paraopt.view.figures import draw_actuators, draw_margins, draw_series, save_figure
from paraopt.view.legged_actuators import draw_leg_actuators
from paraopt.view.legged_figures import draw_balance, draw_footfalls, draw_support_margin
from paraopt.view.legged_filmstrip import draw_filmstrip
from paraopt.view.legged_motion import draw_legged, list_page_phases, save_legged, write_legged_page
from paraopt.view.link_graph import draw_link_graph
from paraopt.view.motion import draw_motion, list_page_bodies, list_page_cables, mark_link, write_motion_page
from paraopt.view.page import build_page, write_page
from paraopt.view.path_figure import draw_path
from paraopt.view.robot_figure import draw_robot
from paraopt.view.search_figure import draw_search

__all__ = [
    "Body",
    "CableLine",
    "Mark",
    "PathLine",
    "Phase",
    "Readout",
    "build_page",
    "draw_actuators",
    "draw_balance",
    "draw_cable_scene",
    "draw_cable_workspace",
    "draw_filmstrip",
    "draw_footfalls",
    "draw_leg_actuators",
    "draw_legged",
    "draw_lengths",
    "draw_link_graph",
    "draw_margins",
    "draw_motion",
    "draw_path",
    "draw_robot",
    "draw_search",
    "draw_series",
    "draw_support_margin",
    "draw_tensions",
    "list_page_bodies",
    "list_page_cables",
    "list_page_phases",
    "mark_link",
    "save_cables",
    "save_figure",
    "save_legged",
    "write_cable_page",
    "write_legged_page",
    "write_motion_page",
    "write_page",
]
