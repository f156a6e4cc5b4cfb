"""Limited jerk, with ruckig: along a path, and from point to point of the actuators."""

from paraopt.planning.retime_ruckig.jerk_limited import JerkLimited
from paraopt.planning.retime_ruckig.joint_move import JointMove

__all__ = ["JerkLimited", "JointMove"]
