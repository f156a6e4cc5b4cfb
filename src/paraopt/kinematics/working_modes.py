"""Working modes: all inverse solutions, as the product of the few postures of each leg."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import prod

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, SolveError
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.legs import Leg, find_legs
from paraopt.kinematics.model import Kinematics, Start
from paraopt.kinematics.multistart import Search, SearchOptions, search_solutions
from paraopt.kinematics.orientation import LegOrientation
from paraopt.kinematics.platform import find_held, reference_configuration
from paraopt.kinematics.postures import PostureReader, find_out_of_range

Array = NDArray[np.float64]
Mode = str | Sequence[int | str]


@dataclass(frozen=True)
class WorkingModeOptions:
    """Choose how working modes are found.

    Attributes:
        hold: Passive coordinates of free links that keep their value at the start, so that the legs come apart. When
            None: those that no motion around the start changes, such as the rotations of a Delta's platform.
        search: How the postures of each leg are searched.
        respect_ranges: Whether postures outside the joint ranges are left out.
        singular: Smallest scaled singular value of a leg's block, over the largest, below which two postures merge [1].
    """

    hold: Sequence[str] | None = None
    search: SearchOptions = field(default_factory=SearchOptions)
    respect_ranges: bool = True
    singular: float = 1e-5


@dataclass(frozen=True, eq=False)
class LegPostures:
    """Hold all postures of one leg at one pose.

    Attributes:
        leg: The leg.
        values: Values of the leg's variables [m or rad], nearest to the start first, shape (n, n_variables of the leg).
        signs: Sign of the determinant of the leg's block, 0 where it is singular; shape (n,).
        margins: Smallest over largest singular value of the scaled block [1], shape (n,).
        out_of_range: Names of the variables that keep a posture from being used, those of all such postures.
        search: How they were found.
    """

    leg: Leg
    values: Array
    signs: NDArray[np.intp]
    margins: Array
    out_of_range: tuple[str, ...]
    search: Search

    @property
    def count(self) -> int:
        """Give the number of postures."""
        return len(self.values)

    @property
    def labels(self) -> tuple[str, ...]:
        """Label each posture by its sign, "+", "-" or "0", followed by a number where several share it."""
        signs = ["0+-"[int(s)] for s in self.signs]
        return tuple(s if signs.count(s) == 1 else f"{s}{1 + signs[:k].count(s)}" for k, s in enumerate(signs))

    @property
    def is_merged(self) -> bool:
        """Tell whether the leg is at a serial singularity, where two of its postures are one."""
        return bool(np.any(self.signs == 0))


@dataclass(frozen=True, eq=False)
class WorkingModes:
    """Hold all inverse solutions at one pose: one posture of each leg, in every combination.

    A mode is named by a label, such as "+-+", or by the signs of the legs, such as (1, -1, 1). Configurations are built
    when they are asked for: 24 legs of two postures make 16 million of them.

    Attributes:
        kinematics: The mechanism's functions.
        imposed: The pose by name [m or rad].
        held: Passive coordinates of free links that were held, with their values.
        legs: Postures of each leg, in the order of the legs.
        X: Values of the variables that belong to no leg, shape (n_variables,).
        open_rows: Names of the equations without joints that the pose violates.
        tolerance: Bound on the scaled closure residual [1].
    """

    kinematics: Kinematics
    imposed: Mapping[str, float]
    held: Mapping[str, float]
    legs: tuple[LegPostures, ...]
    X: Array
    open_rows: tuple[str, ...] = ()
    tolerance: float = 1e-10

    @property
    def count(self) -> int:
        """Give the number of modes: the product of the numbers of postures."""
        return 0 if self.open_rows else prod(leg.count for leg in self.legs)

    def __len__(self) -> int:
        return self.count

    @property
    def merged(self) -> tuple[str, ...]:
        """Name the legs of which two postures are one here: a serial singularity."""
        return tuple(postures.leg.name for postures in self.legs if postures.is_merged)

    @property
    def missing_probability(self) -> float:
        """Estimate the probability that a posture of some leg was missed [1]; see `Search`."""
        return float(1.0 - prod(1.0 - leg.search.missing_probability for leg in self.legs if leg.count))

    @property
    def reason(self) -> str:
        """Say why there is no mode, naming the legs; empty where there are some."""
        parts = [f"the pose violates {', '.join(map(repr, self.open_rows))}"] if self.open_rows else []
        for postures in self.legs:
            if postures.count:
                continue
            if postures.out_of_range:
                parts.append(f"leg {postures.leg.name!r} would leave the ranges of {', '.join(postures.out_of_range)}")
            else:
                parts.append(
                    f"leg {postures.leg.name!r} does not close (least scaled residual {postures.search.residual:.2g} "
                    f"from {postures.search.starts} starts)"
                )
        return "; ".join(parts)

    @property
    def labels(self) -> Iterator[str]:
        """List the labels of all modes, the mode nearest to the start first."""
        every = itertools.product(*[leg.labels for leg in self.legs]) if self.count else ()
        return (self._join(labels) for labels in every)

    def __iter__(self) -> Iterator[Configuration]:
        for choice in itertools.product(*[range(leg.count) for leg in self.legs]) if self.count else ():
            yield self._build(choice)

    def __getitem__(self, mode: Mode) -> Configuration:
        """Give the configuration of one mode.

        Args:
            mode: A label such as "+-", or one sign (1, -1, 0) or label for each leg.

        Raises:
            DefinitionError: The mode does not name one posture of each leg.
            SolveError: A leg has no posture of that sign at this pose.
        """
        parts = self._read(mode)
        if self.open_rows:
            raise SolveError(
                f"{self.kinematics.mechanism.name!r} has no working mode at {dict(self.imposed)}: {self.reason}",
                modes=self,
            )
        return self._build([self._choose(leg, part) for leg, part in zip(self.legs, parts, strict=True)])

    def signs(self, mode: Mode) -> tuple[int, ...]:
        """Give the signs of the determinants of the legs in one mode."""
        parts = self._read(mode)
        return tuple(int(leg.signs[self._choose(leg, p)]) for leg, p in zip(self.legs, parts, strict=True))

    def label_of(self, configuration: Configuration) -> str:
        """Find the mode of a configuration at the same pose.

        Raises:
            SolveError: A leg of the configuration is in none of its postures.
        """
        reader = PostureReader(self.kinematics)
        target = reader(configuration.X[None])[0]
        labels = []
        for postures in self.legs:
            columns = self.kinematics.mechanism.indices(postures.leg.variables)
            trial = np.tile(configuration.X, (postures.count, 1))
            trial[:, columns] = postures.values
            distances = np.max(np.abs(reader(trial) - target), axis=1, initial=0.0)
            if not len(distances) or float(np.min(distances)) > 1e-4:
                raise SolveError(
                    f"leg {postures.leg.name!r} of the configuration is in none of its {postures.count} postures at "
                    f"{dict(self.imposed)}",
                    configuration=configuration,
                )
            labels.append(postures.labels[int(np.argmin(distances))])
        return self._join(labels)

    def _join(self, labels: Sequence[str]) -> str:
        alone = all(len(label) == 1 for leg in self.legs for label in leg.labels)
        return ("" if alone else " ").join(labels)

    def _read(self, mode: Mode) -> list[str]:
        if isinstance(mode, str):
            parts = mode.split() if " " in mode else list(mode)
            if " " not in mode and len(self.legs) == 1:
                parts = [mode]
        else:
            parts = [p if isinstance(p, str) else _sign_label(p) for p in mode]
        if len(parts) != len(self.legs):
            names = ", ".join(repr(leg.leg.name) for leg in self.legs)
            raise DefinitionError(
                f"working mode {mode!r} of {self.kinematics.mechanism.name!r} names {len(parts)} postures; it must "
                f"name {len(self.legs)}, one for each of the legs {names}"
            )
        return parts

    def _choose(self, postures: LegPostures, part: str) -> int:
        labels = postures.labels
        if part in labels:
            return labels.index(part)
        alike = [label for label in labels if label[0] == part]
        if alike:
            raise DefinitionError(
                f"leg {postures.leg.name!r} has {len(alike)} postures of sign {part!r}; name one of {', '.join(alike)}"
            )
        if part not in ("+", "-", "0") and not (part[:1] in ("+", "-", "0") and part[1:].isdigit()):
            raise DefinitionError(
                f"posture {part!r} of leg {postures.leg.name!r} is unknown; it must be a sign '+', '-' or '0', with a "
                "number where several postures share it"
            )
        raise SolveError(
            f"leg {postures.leg.name!r} of {self.kinematics.mechanism.name!r} has no posture {part!r} at "
            f"{dict(self.imposed)}; it has {', '.join(labels) or 'none: ' + self.reason}",
            modes=self,
        )

    def _build(self, choice: Sequence[int]) -> Configuration:
        X = self.X.copy()
        for postures, k in zip(self.legs, choice, strict=True):
            X[self.kinematics.mechanism.indices(postures.leg.variables)] = postures.values[k]
        # all equations, those of held coordinates included: a hold that contradicts them is seen here
        residual = float(self.kinematics.scaled_residual(X)[0])
        return Configuration(self.kinematics.mechanism, X, residual, self.tolerance)


def _sign_label(sign: int | float) -> str:
    if sign not in (-1, 0, 1):
        raise DefinitionError(f"sign of a leg is {sign!r}; it must be 1, -1 or 0")
    return "0+-"[int(sign)]


def find_working_modes(
    kinematics: Kinematics,
    x: Mapping[str, float],
    start: Start | None = None,
    options: WorkingModeOptions | None = None,
) -> WorkingModes:
    """Find all inverse solutions at a pose.

    With the pose imposed the equations fall apart into legs (`find_legs`); each leg's few postures are found by Newton
    from many starts, with the estimate of `Search` of what may be missing, and told apart by `PostureReader`. Signs are
    those of the determinants of the scaled leg blocks; where a block has more rows than columns, see `LegOrientation`.

    Args:
        kinematics: The mechanism's functions.
        x: Operational variables by name [m or rad], all of them.
        start: The branch of coordinates that are held, and the angles to which solutions should be near.
        options: Choices.

    Returns:
        The modes; without one where the pose cannot be reached, `reason` says which leg is why.

    Source: Chablat1998, 3.2; Lahouar, II.27.
    """
    options = options or WorkingModeOptions()
    mechanism = kinematics.mechanism
    X = reference_configuration(kinematics, start)
    names = find_held(kinematics, X) if options.hold is None else tuple(options.hold)
    wrong = [n for n in names if mechanism.variables[mechanism.index(n)].role != "passive"]
    if wrong:
        raise DefinitionError(f"{wrong[0]!r} of {mechanism.name!r} cannot be held; only passive variables can")
    held = {name: float(X[mechanism.index(name)]) for name in names}
    X[mechanism.indices(x)] = list(x.values())
    legs = find_legs(kinematics.graph, names)
    reader = PostureReader(kinematics)
    found = [_find_postures(kinematics, leg, names, X, reader, options) for leg in legs]
    (F,) = kinematics.functions.residual(X)
    loose = set(range(len(kinematics.graph.rows))) - {k for leg in legs for k in leg.rows}
    violated = [k for k in sorted(loose) if abs(F[k]) > options.search.tolerance * kinematics.graph.row_scale[k]]
    names_open = tuple(kinematics.graph.rows[k].name for k in violated)
    return WorkingModes(kinematics, dict(x), held, tuple(found), X, names_open)


def _find_postures(
    kinematics: Kinematics,
    leg: Leg,
    held: Sequence[str],
    X: Array,
    reader: PostureReader,
    options: WorkingModeOptions,
) -> LegPostures:
    columns = kinematics.mechanism.indices(leg.variables)
    search = search_solutions(kinematics, X, columns, leg.rows, reader, options.search)
    postures, names = search.X, set[str]()
    if options.respect_ranges:
        outside = [set(find_out_of_range(kinematics, posture)) & set(leg.variables) for posture in postures]
        names = set().union(*outside)
        postures = postures[[not o for o in outside]]
    if len(postures):
        (E,) = kinematics.functions.scaled_jacobian.batch(postures)
        margins = _margins(E[:, leg.rows][:, :, columns])
        regular = postures[int(np.argmax(margins))]  # rows and columns are best chosen far from singularities
        signs = LegOrientation.of(kinematics, leg, held, regular)(postures)
    else:
        margins = signs = np.zeros(0)
    whole = np.where(margins < options.singular, 0, signs).astype(np.intp)
    keep = _merge(reader(postures), margins, options) if len(postures) else np.arange(0)
    distance = np.linalg.norm((postures - X) / kinematics.graph.variable_scale, axis=1)
    keep = keep[np.argsort(distance[keep], kind="stable")]
    return LegPostures(leg, postures[keep][:, columns], whole[keep], margins[keep], tuple(sorted(names)), search)


def _margins(blocks: Array) -> Array:
    """Give the smallest over the largest singular value of stacks of blocks, 0 where rows are fewer than columns."""
    if blocks.shape[1] < blocks.shape[2]:
        return np.zeros(len(blocks))
    values = np.linalg.svd(blocks, compute_uv=False)
    return np.asarray(values[:, -1] / np.maximum(values[:, 0], 1e-300), dtype=float)


def _merge(marks: Array, margins: Array, options: WorkingModeOptions) -> NDArray[np.intp]:
    """Keep one of the singular postures that coalesce: a double root is uncertain by the root of the residual."""
    singular = margins < options.singular
    kept: list[int] = []
    for k in range(len(marks)):
        near = [j for j in kept if singular[j] and np.max(np.abs(marks[j] - marks[k])) < 1e2 * options.singular]
        if not (singular[k] and near):
            kept.append(k)
    return np.array(kept, dtype=int)
