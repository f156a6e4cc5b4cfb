"""What an equilibrium of a hanging platform is: pose, tensions, what is slack, and how firmly it holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.modes.cable.model import CableRobot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EquilibriumOptions:
    """Choose how equilibria are found and judged.

    Attributes:
        residual: Bound on the force over the weight, and on the moment over weight times length, that is left [1].
        slack: Tension below which a cable counts as slack, over the weight [1].
        stability: Curvature of the energy, over weight times length, below which an equilibrium is not stable [1].
        merge_distance: Poses closer than this are one, in characteristic lengths and radians.
        missing_probability: Estimated probability that a stable equilibrium is missing, below which the search ends.
        max_starts: Bound on the number of starts.
        max_found: Number of different equilibria at which the search gives up counting.
        seed: Seed of the starts.

    Raises:
        DefinitionError: A number is not above 0, or the probability is not below 1.
    """

    residual: float = 1e-9
    slack: float = 1e-7
    stability: float = 1e-6
    merge_distance: float = 1e-4
    missing_probability: float = 0.05
    max_starts: int = 400
    max_found: int = 40
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("residual", "slack", "stability", "merge_distance", "missing_probability", "max_starts",
                     "max_found"):  # fmt: skip
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and np.isfinite(value) and value > 0):
                raise DefinitionError(f"{name} of the equilibria is {value!r}; it must be finite and above 0")
        if not isinstance(self.seed, (int, np.integer)) or self.seed < 0:
            raise DefinitionError(f"seed of the equilibria is {self.seed!r}; it must be a whole number, not below 0")
        if self.missing_probability >= 1:
            raise DefinitionError(f"missing_probability is {self.missing_probability}; it must be below 1")


@dataclass(frozen=True, eq=False)
class Stability:
    """Hold the second variation of the energy along the motions that keep the lengths of the taut cables.

    Attributes:
        curvatures: Its eigenvalues over weight times characteristic length, least first [1]; none where the taut cables
            leave no motion.
        softest: Motion of least curvature, of length one: the origin's in characteristic lengths and the turn in the
            world [rad], shape (dof,); zero where none is left.
        threshold: Curvature below which the equilibrium is not stable [1].

    Source: CarricatoMerlet2013.
    """

    curvatures: Array
    softest: Array
    threshold: float

    @property
    def least(self) -> float:
        """Give the least curvature [1]; inf where the cables alone hold the platform."""
        return float(self.curvatures[0]) if len(self.curvatures) else np.inf

    @property
    def is_stable(self) -> bool:
        """Tell whether the platform returns when it is disturbed a little."""
        return self.least > self.threshold

    @property
    def verdict(self) -> str:
        """Say it in one word: "stable", "neutral" at the edge of stability, or "unstable"."""
        return "stable" if self.is_stable else "neutral" if self.least >= -self.threshold else "unstable"


@dataclass(frozen=True, eq=False)
class HangingPose:
    """Hold one equilibrium.

    Attributes:
        robot: The cable robot.
        pose: Values of the robot's coordinates [m, rad], shape (dof,).
        R: Rotation of the platform in the world, shape (3, 3).
        tensions: Tension of each cable [N], shape (n,).
        lengths: Distance that each cable spans [m], shape (n,).
        slack: By how much each slack cable is longer than it must be [m], by name.
        loose: Names of the taut cables whose tension is zero: they are about to go slack.
        residual: Largest force over the weight, or moment over weight times length, that is left [1].
        energy: Potential energy of weight and load [J], zero for the platform's origin and frame in the world's.
        stability: Second variation.
    """

    robot: CableRobot
    pose: Array
    R: Array
    tensions: Array
    lengths: Array
    slack: Mapping[str, float]
    loose: tuple[str, ...]
    residual: float
    energy: float
    stability: Stability

    def __getitem__(self, coordinate: str) -> float:
        return float(self.pose[self.robot.coordinates.index(coordinate)])

    @property
    def out_of_limits(self) -> tuple[str, ...]:
        """Name the cables whose tension is out of their limits."""
        broken = (self.tensions < self.robot.t_min) | (self.tensions > self.robot.t_max)
        return tuple(c for c, b in zip(self.robot.cables, broken, strict=True) if b)

    @property
    def findings(self) -> tuple[str, ...]:
        """Tell what is singular or at an end, one sentence for each."""
        found = [f"cable {c!r} is slack by {1e3 * by:.4g} mm" for c, by in self.slack.items()]
        found += [f"the tension of cable {c!r} reaches zero" for c in self.loose]
        if not self.stability.is_stable:
            found.append(
                f"the equilibrium is {self.stability.verdict}: the energy's least curvature is "
                f"{self.stability.least:.3g} of weight times length"
            )
        return tuple(found)

    def __str__(self) -> str:
        values = zip(self.robot.coordinates, self.pose, strict=True)
        pulls = zip(self.robot.cables, self.tensions, strict=True)
        lines = [
            f"{self.robot.name}: {self.stability.verdict}, " + ", ".join(f"{n} {v:.6g}" for n, v in values),
            "  tensions [N]: " + ", ".join(f"{c} {t:.4g}" for c, t in pulls) + f"; residual {self.residual:.1e}",
        ]
        return "\n".join(lines + [f"  {finding}" for finding in self.findings])


@dataclass(frozen=True, eq=False)
class Equilibria(Sequence[HangingPose]):
    """Hold the stable equilibria that were found, lowest energy first, and what speaks for completeness.

    Attributes:
        poses: The equilibria; neutral ones among them say so.
        hits: How many starts ended at each.
        starts: Number of starts.
        missing_probability: Estimated probability that one is missing [1]; see `kinematics.multistart.Search`.
        is_continuous: Whether neutral equilibria seem to form a continuum: the poses are then examples.
    """

    poses: tuple[HangingPose, ...]
    hits: tuple[int, ...]
    starts: int
    missing_probability: float
    is_continuous: bool

    def __len__(self) -> int:
        return len(self.poses)

    def __iter__(self) -> Iterator[HangingPose]:
        return iter(self.poses)

    @overload
    def __getitem__(self, index: int) -> HangingPose: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[HangingPose, ...]: ...

    def __getitem__(self, index: int | slice) -> HangingPose | tuple[HangingPose, ...]:
        return self.poses[index]
