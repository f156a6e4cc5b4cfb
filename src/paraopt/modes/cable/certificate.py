"""The verdict on a motion of a cable robot: what its cables feel at every time, by inverse dynamics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import CertificateError, DefinitionError
from paraopt.modes.cable.chain import MotionChain
from paraopt.modes.cable.distribution import BatchAim, TensionBatch, coordinate_places, dynamic_tensions
from paraopt.modes.cable.equilibrium import judge_stability
from paraopt.modes.cable.facets import capacity_margins, scale_moments
from paraopt.modes.cable.hanging import EquilibriumOptions
from paraopt.modes.cable.model import CableRobot
from paraopt.modes.cable.sway import pulling_force, unbalanced_part
from paraopt.modes.cable.wrench import cable_functions
from paraopt.planning import Check, Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CableTolerances:
    """State what the certificate of a cable robot's motion forgives.

    Attributes:
        balance: Largest wrench that tensions leave unbalanced where they could balance it all, over weight and load
            [1].
        sway: Largest wrench that a hanging platform's tensions leave unbalanced, over weight and load [1].
        stability: How equilibria are judged; the default options when None.
    """

    balance: float = 1e-9
    sway: float = 0.05
    stability: EquilibriumOptions | None = None


@dataclass(frozen=True, eq=False)
class CableCertificate:
    """Hold the verdict on the tensions of a motion.

    Attributes:
        robot: The cable robot.
        tensions: Tensions along the motion; those of least norm where there is a choice.
        needed: Tensions without regard to their limits [N], shape (k, n): those that a hanging platform asks for;
            the distributed ones where there is a choice.
        margins: Distance of the wrench to the boundary of the available set, or where the platform hangs the least
            distance of a tension to a limit [N], shape (k,); negative beyond.
        unbalanced: What tensions leave, over weight and load [1], shape (k,).
        curvature: Least curvature of the energy along the motions that keep the lengths, over weight times length [1],
            inf where cables alone hold the platform, shape (m,).
        checks: The lines of the certificate.
    """

    robot: CableRobot
    tensions: TensionBatch
    needed: Array
    margins: Array
    unbalanced: Array
    curvature: Array
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Tell whether every check holds."""
        return all(check.passed for check in self.checks)

    @property
    def hangs(self) -> bool:
        """Tell whether there are fewer cables than freedoms, so that weight holds the rest."""
        return self.robot.n_cables < self.robot.dof

    @property
    def deflection(self) -> float:
        """Bound how far a steady push of the unbalanced size moves a hanging platform, in characteristic lengths [1].

        It is the most over the motion of what is unbalanced over the least curvature of the energy: a shift by so many
        characteristic lengths, or a turn by so many radians. A push that changes fast may move it twice as far.
        """
        where = np.linspace(0.0, 1.0, len(self.unbalanced)), np.linspace(0.0, 1.0, len(self.curvature))
        firm = np.interp(where[0], where[1], self.curvature)
        return float(np.max(np.where(firm > 0.0, self.unbalanced / np.maximum(firm, 1e-300), np.inf)))

    def __getitem__(self, name: str) -> Check:
        for check in self.checks:
            if check.name == name:
                return check
        raise DefinitionError(f"no check is called {name!r}; there are {[c.name for c in self.checks]}")

    @property
    def summary(self) -> str:
        """Say in a few lines what the cables feel."""
        times = self.tensions.t if self.tensions.t is not None else np.zeros(1)
        low, high = float(np.min(self.robot.t_min)), float(np.max(self.robot.t_max))
        lines = [
            f"tensions {np.min(self.needed):.3f} to {np.max(self.needed):.3f} N at {len(times)} times "
            f"(limits {low:g} to {high:g} N): {'certified' if self.passed else 'NOT certified'}"
        ]
        if self.hangs:
            sway, firm = self["unbalanced / weight"], self["stability"]
            lines.append(
                f"unbalanced inertia up to {100 * sway.value:.2f} % of the weight at {sway.time:.3f} s (allowed "
                f"{100 * sway.bound:g} %): a steady push of that size moves the platform off its path by at most "
                f"{1e3 * self.deflection * self.robot.length_scale:.1f} mm or {np.degrees(self.deflection):.1f} deg"
            )
            lines.append(
                f"equilibria {'stable' if firm.passed else 'NOT stable'}: least curvature of the energy "
                f"{firm.value:.4f} of weight times length at {firm.time:.3f} s"
            )
        return "\n".join(lines)

    def __str__(self) -> str:
        failed = sum(not check.passed for check in self.checks)
        head = "certified" if self.passed else f"NOT certified: {failed} check(s) fail"
        return "\n".join([f"{head}, tensions at {len(self.needed)} times", *(str(check) for check in self.checks)])

    def check_passed(self) -> CableCertificate:
        """Give itself where every check holds.

        Raises:
            CertificateError: Some check fails; the message lists them.
        """
        if self.passed:
            return self
        told = "\n".join(str(check) for check in self.checks if not check.passed)
        raise CertificateError(f"the tensions of {self.robot.name!r} are not certified:\n{told}", certificate=self)


def verify_cables(
    robot: CableRobot,
    motion: Trajectory | MotionChain,
    *,
    count: int = 4001,
    stability_count: int = 401,
    aim: BatchAim = "least norm",
    tolerances: CableTolerances | None = None,
) -> CableCertificate:
    """Look densely at what the cables of a motion feel, and judge it against their limits.

    The dynamics `W t + w = 0` with weight, load and inertia are solved at every time, without the rows by which the
    motion was timed.

    * With at least as many cables as freedoms, the distance of the wrench to the boundary of the available set tells
      whether tensions within the limits exist; they are then distributed and must balance the wrench.
    * With fewer, the tensions are what the wrench asks for; what is left unbalanced is bounded, and the equilibria that
      the platform follows must be stable.

    Args:
        robot: The cable robot.
        motion: A motion of its `robot`, or a chain of them.
        count: Number of times at which tensions are looked at.
        stability_count: Number of times at which stability is judged.
        aim: How tensions are distributed where there is a choice, see `distribute_batch`.
        tolerances: What is forgiven.

    Returns:
        The certificate.

    Raises:
        DefinitionError: The motion is that of a mechanism without the robot's coordinates.
    """
    tolerances = tolerances or CableTolerances()
    t = np.linspace(0.0, motion.duration, count)
    found = dynamic_tensions(robot, motion, t, aim)
    force = pulling_force(robot) or float(np.max(robot.t_max))  # on a level plane the platform feels no weight
    checks: list[Check] = []

    def add(name: str, values: Array, bound: float, unit: str, sense: str, where: object = "", at: Array = t) -> None:
        i = int(np.argmax(values) if sense == "<=" else np.argmin(values))
        value = float(values[i])
        passed = value <= bound if sense == "<=" else value >= bound
        place = where[i] if isinstance(where, list) else str(where)
        checks.append(Check(name, value, bound, unit, float(at[i]), place, bool(passed), sense))

    if robot.n_cables < robot.dof:
        needed, unbalanced = _solve_hanging(robot, found.poses, found.wrench)
        unbalanced /= force
        curvature, times = _judge_stability(robot, motion, stability_count, tolerances)
        margins = np.min(np.minimum(needed - robot.t_min, robot.t_max - needed), axis=1)
    else:
        needed, unbalanced = found.values, found.residual / force
        curvature, times = np.full(1, np.inf), t[:1]
        margins = capacity_margins(robot, found.poses, found.wrench)
        add("capacity margin", margins, 0.0, "N", ">=")
    below, above = needed - robot.t_min, robot.t_max - needed
    add("tension above t_min", *_least(below, robot), ">=", _names(below, robot))
    add("tension below t_max", *_least(above, robot), ">=", _names(above, robot))
    if robot.n_cables < robot.dof:
        add("unbalanced / weight", unbalanced, tolerances.sway, "1", "<=")
        threshold = (tolerances.stability or EquilibriumOptions()).stability
        add("stability", curvature, threshold, "1", ">=", at=times)
    else:
        add("unbalanced / weight", unbalanced, tolerances.balance, "1", "<=")
    return CableCertificate(robot, found, needed, margins, unbalanced, curvature, tuple(checks))


def _least(distances: Array, robot: CableRobot) -> tuple[Array, float, str]:
    """Give the least distance at each time, and how far below zero round-off may bring it."""
    return np.min(distances, axis=1), -1e-12 * float(np.max(robot.t_max)), "N"


def _names(distances: Array, robot: CableRobot) -> list[str]:
    return [robot.cables[i] for i in np.argmin(distances, axis=1)]


def _solve_hanging(robot: CableRobot, poses: Array, wrench: Array) -> tuple[Array, Array]:
    """Give the tensions that wrenches ask for [N], shape (k, n), and the norm of what they leave [N], shape (k,)."""
    W = cable_functions(robot).wrench_matrix(poses)
    A = scale_moments(W.transpose(0, 2, 1), robot.length_scale).transpose(0, 2, 1)
    b = scale_moments(wrench, robot.length_scale)
    t = -np.einsum("knd,kd->kn", np.linalg.pinv(A), b)
    return t, np.linalg.norm(unbalanced_part(robot, poses, wrench), axis=1)


def _judge_stability(
    robot: CableRobot, motion: Trajectory | MotionChain, count: int, tolerances: CableTolerances
) -> tuple[Array, Array]:
    """Give the least curvature of the energy at `count` poses of a motion, at rest, and their times."""
    t = np.linspace(0.0, motion.duration, count)
    poses = motion(t)[:, coordinate_places(robot, motion.robot.mechanism)]
    functions = cable_functions(robot)
    at_rest = _solve_hanging(robot, poses, functions.wrench(poses))[0]
    options = tolerances.stability
    least = [judge_stability(robot, p, tension, options).least for p, tension in zip(poses, at_rest, strict=True)]
    return np.array(least), t
