"""The tripod as a machine that walks: its dimensions, the robot with free feet, and what stands around."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics import Configuration
from paraopt.modes.legged.machine import Foot, LeggedMachine
from paraopt.modes.legged.tripod.chain import TripodModel, tripod_model
from paraopt.modes.legged.tripod.frames import read_feet, read_frame
from paraopt.modes.legged.tripod.geometry import (
    LEGS,
    POSE,
    TripodGeometry,
    foot_names,
    lock_names,
)
from paraopt.robot import Robot
from paraopt.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class WalkingTripod:
    """Hold a tripod with free feet in its scene.

    Attributes:
        geometry: Its dimensions.
        scene: The robot, with a pose for each foot, among obstacles.
        sole: Point of contact of each foot in its frame [m].

    Raises:
        DefinitionError: The robot's feet are not free, or it is not of this geometry.
    """

    geometry: TripodGeometry
    scene: Scene
    sole: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        mechanism = self.robot.mechanism
        missing = [n for i in LEGS for n in foot_names(i) if n not in mechanism.operational]
        if missing:
            raise DefinitionError(
                f"robot {self.robot.name!r} does not walk: {missing[:2]} ... are no operational variables; build it "
                "with free feet"
            )
        unknown = sorted(set(mechanism.names) - {*self.model.names, *mechanism.operational})
        if unknown:
            raise DefinitionError(f"robot {self.robot.name!r} is no tripod: it has the variables {unknown}")
        X = self.configurations(self.geometry.home_pose, self.geometry.home_feet)
        gap = float(self.robot.kinematics.scaled_residual(X)[0])
        if not gap <= 1e-9:
            raise DefinitionError(
                f"robot {self.robot.name!r} is not of this geometry: its loops are open by {gap:.2g} (scaled) at home"
            )

    @property
    def robot(self) -> Robot:
        """Give the robot."""
        return self.scene.robot

    @property
    def model(self) -> TripodModel:
        """Give the closed forms."""
        return tripod_model(self.geometry)

    @cached_property
    def machine(self) -> LeggedMachine:
        """Give the legged machine: feet 1, 2 and 3, each on its sole."""
        feet = [Foot(f"foot {i}", foot_names(i), f"foot {i}", self.sole, upright=(0, 0, 1)) for i in LEGS]
        return LeggedMachine(self.robot, feet)

    @cached_property
    def ranges(self) -> tuple[Array, Array]:
        """Give the least and greatest value of each variable [m or rad], shape (n_variables,) each."""
        low, high = self.robot.limits.bounds(self.robot.mechanism)
        return low, high

    def configurations(self, poses: ArrayLike, feet: ArrayLike) -> Array:
        """Give whole configurations in closed form; see `TripodModel.configurations`."""
        return self.model.configurations(tuple(self.robot.mechanism.names), poses, feet)

    def configuration(self, pose: ArrayLike, feet: ArrayLike) -> Configuration:
        """Give the configuration of a platform pose (6,) on feet (3, 6), checked by the general closures.

        Raises:
            SolveError: The loops are open.
        """
        return self.robot.kinematics.configuration(self.configurations(read_frame(pose), read_feet(feet))[0])

    def read(self, configuration: Configuration) -> tuple[Array, Array]:
        """Read the pose of the platform (6,) and the frames of the feet (3, 6) off a configuration [m, rad]."""
        pose = np.array([configuration[n] for n in POSE])
        return pose, np.array([[configuration[n] for n in foot_names(i)] for i in LEGS])

    def held_in_swing(self, leg: int) -> tuple[str, ...]:
        """Name what does not move while a leg is in the air: the frames of the standing feet and the locked joints."""
        return (*(n for i in LEGS if i != leg for n in foot_names(i)), *lock_names(leg))
