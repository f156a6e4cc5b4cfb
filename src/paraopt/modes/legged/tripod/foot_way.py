"""The way of a foot through the air against what stands still."""

from __future__ import annotations

import numpy as np

from paraopt.errors import InfeasibleError
from paraopt.modes.legged.tripod.geometry import LEGS
from paraopt.modes.legged.tripod.swing import Swing
from paraopt.modes.legged.tripod.walker import WalkingTripod


def check_foot_way(walker: WalkingTripod, swing: Swing, clearance: float, phase: str = "", count: int = 101) -> None:
    """Refuse a way of a foot that comes too near to what stands still; no pose of the platform can cure that.

    Args:
        walker: The machine.
        swing: The way.
        clearance: Distance to keep from obstacles and standing feet [m].
        phase: How messages call the phase.
        count: Number of places that are looked at.

    Raises:
        InfeasibleError: It is too near; the message names the foot, what it comes near to, and by how much.
    """
    scene, own = walker.scene, f"foot {swing.leg}"
    still = {"world", walker.robot.mechanism.base.name, *(f"foot {i}" for i in LEGS)}
    links = [{scene.bodies[pair.first].link, scene.bodies[pair.second].link} for pair in scene.pairs]
    pairs = np.array([k for k, both in enumerate(links) if own in both and both <= still], dtype=np.intp)
    if not pairs.size:
        return
    s = np.linspace(0.0, 1.0, count)
    # wherever the platform is, the foot is where its frame says
    X = walker.configurations(walker.geometry.rest_pose(np.asarray(swing.feet)), swing.all_frames(s))
    distances = scene.distances(X, pairs, np.zeros((count, X.shape[1], 1))).values
    k, j = np.unravel_index(int(np.argmin(distances)), distances.shape)
    if distances[k, j] < clearance:
        where = f"phase {phase!r}: " if phase else ""
        raise InfeasibleError(
            f"{where}foot {swing.leg}, lifted by {1e3 * swing.lift:.3g} mm, comes as near as "
            f"{1e3 * distances[k, j]:.3g} mm to {scene.pairs[pairs[j]].name} at s = {s[k]:.2f} of its way, asked "
            f"{1e3 * clearance:g} mm; lift it higher, or place it elsewhere",
            leg=swing.leg,
            margin=float(distances[k, j]),
        )
