"""What counts along a swing, as a function of the pose at its beginning, with exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import SolveError
from paraopt.kinematics import MotionSpace
from paraopt.modes.legged.tripod.frames import tilt_frame
from paraopt.modes.legged.tripod.geometry import LEGS, POSE, foot_names
from paraopt.modes.legged.tripod.swing import Swing, follow_swing, hold_locks
from paraopt.modes.legged.tripod.walker import WalkingTripod

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SwingState:
    """Hold a swing from one pose: everything that a better pose is judged by.

    The pose at each instant follows from the first one through the locks, `b(x_k, feet_k) = b(x_0, feet_0)`, so that
    `dx_k / dx_0 = B_k^-1 B_0`.

    Attributes:
        walker: The machine.
        swing: The swing.
        poses: Poses of the platform at its instants [m, rad], shape (n, 6).
    """

    walker: WalkingTripod
    swing: Swing
    poses: Array

    @classmethod
    def at(cls, walker: WalkingTripod, swing: Swing, pose: Array, count: int) -> SwingState:
        """Follow a swing from a pose.

        Raises:
            SolveError: The locks let go of the platform on the way.
        """
        return cls(walker, swing, follow_swing(walker.model, swing, pose, count))

    def moved(self, step: Array) -> SwingState | None:
        """Follow the swing from a pose near by; None where that fails.

        Args:
            step: Change of the first pose, lengths in r_p, shape (6,).
        """
        model, B = self.walker.model, self.lock_matrices
        guess = self.poses + (self.sensitivity @ step) * model.scale
        b = model.locks(self.swing.leg, guess[:1], np.asarray(self.swing.feet)).b
        poses, miss, new_B = hold_locks(model, self.swing.leg, b, self.feet, guess)
        same = np.sign(np.linalg.det(new_B)) == np.sign(np.linalg.det(B))
        # far from where the slopes led: another branch
        near = np.max(np.abs(poses - guess) / model.scale, axis=1) < 0.5
        if not (np.all(miss < 1e-11) and np.all(same) and np.all(near)):
            return None
        return SwingState(self.walker, self.swing, poses)

    @property
    def pose(self) -> Array:
        """Give the first pose, shape (6,)."""
        return self.poses[0]

    @property
    def s(self) -> Array:
        """Give the instants, shape (n,)."""
        return np.linspace(0.0, 1.0, len(self.poses))

    @cached_property
    def feet(self) -> Array:
        """Give the frames of the feet, shape (n, 3, 6)."""
        return self.swing.all_frames(self.s)

    @cached_property
    def lock_matrices(self) -> Array:
        """Give B at each instant, shape (n, 6, 6)."""
        return self.walker.model.locks(self.swing.leg, self.poses, self.feet).B

    @cached_property
    def sensitivity(self) -> Array:
        """Give the change of each pose with the first one, lengths in r_p, shape (n, 6, 6)."""
        B = self.lock_matrices
        return np.asarray(np.linalg.solve(B, np.broadcast_to(B[0], B.shape)))

    @cached_property
    def singular_values(self) -> Array:
        """Give the singular values of the locks' matrix, falling, shape (n, 6)."""
        return np.asarray(np.linalg.svd(self.lock_matrices, compute_uv=False))

    @property
    def smallest(self) -> float:
        """Give the smallest singular value over the swing [1]."""
        return float(np.min(self.singular_values))

    def singular_slopes(self, k: int = 2) -> tuple[Array, Array]:
        """Give the k smallest singular values of each instant and their derivatives with respect to the scaled pose.

        Returns:
            Values, shape (n, k), smallest first; derivatives, shape (n, k, 6).
        """
        model = self.walker.model
        U, values, V = np.linalg.svd(self.lock_matrices)
        slopes = []
        for j in range(5, 5 - k, -1):
            by_pose, _ = model.lock_slopes(self.swing.leg, self.poses, self.feet, U[:, :, j], V[:, j, :])
            slopes.append(np.einsum("np,p,npq->nq", by_pose, model.scale, self.sensitivity))
        return values[:, ::-1][:, :k], np.stack(slopes, axis=1)

    @cached_property
    def X(self) -> Array:
        """Give the configurations, shape (n, n_variables)."""
        return self.walker.configurations(self.poses, self.feet)

    @cached_property
    def motions(self) -> Array:
        """Give the change of all variables with the scaled first pose, shape (n, n_variables, 6)."""
        model = self.walker.model
        by_pose = self.sensitivity * model.scale[:, None]
        _, slopes, _ = model.slopes(self.poses, self.feet)
        whole = np.zeros((len(self.poses), 30 + 6 + 18, 6))
        whole[:, :30] = slopes @ by_pose
        whole[:, 30:36] = by_pose
        return whole[:, model.places(tuple(self.walker.robot.mechanism.names))]

    def distances(self, horizon: float) -> tuple[Array, Array, NDArray[np.intp]]:
        """Measure the pairs of bodies that come nearer than a horizon [m].

        Returns:
            Distances [m], shape (n, k); derivatives with respect to the scaled first pose, (n, k, 6); pairs, (k,).
        """
        scene = self.walker.scene
        pairs = scene.near_pairs(self.X, horizon)
        if not pairs.size:
            return np.zeros((len(self.X), 0)), np.zeros((len(self.X), 0, 6)), pairs
        found = scene.distances(self.X, pairs, self.motions)
        return found.values, found.gradients, pairs

    @cached_property
    def clearance(self) -> float:
        """Give the smallest distance of all pairs over the swing [m]; inf without pairs."""
        return float(np.min(self.walker.scene.clearances(self.X)[0]))

    def standing_margins(self) -> tuple[Array, Array]:
        """Give the distance to parallel singularities on three feet, before and after the swing.

        Returns:
            Margins [1], shape (2,), and derivatives with respect to the scaled first pose, shape (2, 6).
        """
        kinematics, model = self.walker.robot.kinematics, self.walker.model
        held = [n for i in LEGS for n in foot_names(i)]
        space = MotionSpace(kinematics, POSE, POSE, held)
        X = self.X[[0, -1]]
        margins, slope, *_ = space.margin_gradients(X, space.tangent(X))
        return margins.parallel, np.einsum("np,p,npq->nq", slope, model.scale, self.sensitivity[[0, -1]])

    def swing_margins(self) -> Array:
        """Give the distance to parallel singularities along the swing, with the joints locked [1], shape (n,)."""
        kinematics, leg = self.walker.robot.kinematics, self.swing.leg
        names = foot_names(leg)
        space = MotionSpace(kinematics, names, names, self.walker.held_in_swing(leg))
        return space.margins(self.X).parallel


def smallest_from_tilt(walker: WalkingTripod, swing: Swing, angle: float = 0.3, count: int = 41) -> float:
    """Give the smallest singular value of the locks' matrix over a swing from the rest pose, tilted about P_L P_R.

    Args:
        walker: The machine.
        swing: The swing.
        angle: The tilt, the leg's side down [rad]; its size is what the source's manner takes.
        count: Number of instants.

    Returns:
        The value [1]; zero where the locks let go of the platform on the way.
    """
    pose = tilt_frame(walker.geometry.rest_pose(np.asarray(swing.feet)), walker.geometry.azimuth(swing.leg), angle)
    try:
        return SwingState.at(walker, swing, pose, count).smallest
    except SolveError:
        return 0.0
