"""Assembly modes: all forward solutions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.kinematics.configuration import Configuration
from paraopt.kinematics.distance_legs import place_platform, read_six_distances
from paraopt.kinematics.joints_of_pose import close_legs
from paraopt.kinematics.margins import smallest_and_volume
from paraopt.kinematics.model import Kinematics, Start
from paraopt.kinematics.multistart import Search, SearchOptions, close_rows, search_solutions
from paraopt.kinematics.orientation import ParallelOrientation
from paraopt.kinematics.planar_legs import read_planar_legs, solve_planar
from paraopt.kinematics.platform import find_held, reference_configuration
from paraopt.kinematics.postures import PostureReader, find_out_of_range
from paraopt.kinematics.ranks import null_space
from paraopt.kinematics.six_distances import solve_six_distances
from paraopt.mechanism import Mechanism

Array = NDArray[np.float64]
Method = Literal["planar sextic", "six distances", "many starts"]


@dataclass(frozen=True)
class AssemblyOptions:
    """Choose how assembly modes are found.

    Attributes:
        method: "planar sextic" and "six distances" are exact, and insist on a mechanism of their kind; "many starts"
            works for all. When None: an exact one where there is one.
        hold: Passive coordinates of free links that keep their value at the start. When None: those that no motion
            around the start changes, such as the rotations of a Delta's platform.
        search: How solutions are searched from many starts.
        respect_ranges: Whether solutions that leave the ranges of variables that are not imposed are left out.
        singular: Parallel margin below which the sign of a determinant is given as 0 [1].

    Raises:
        DefinitionError: The method is unknown.
    """

    method: Method | None = None
    hold: Sequence[str] | None = None
    search: SearchOptions = field(default_factory=SearchOptions)
    respect_ranges: bool = True
    singular: float = 1e-6

    def __post_init__(self) -> None:
        if self.method not in (None, "planar sextic", "six distances", "many starts"):
            raise DefinitionError(
                f"method of assembly modes is {self.method!r}; it must be 'planar sextic', 'six distances', "
                "'many starts' or None"
            )


@dataclass(frozen=True, eq=False)
class AssemblyMode:
    """Hold one forward solution.

    Attributes:
        configuration: The configuration.
        sign: Sign of the determinant of [N K]: 1 or -1; 0 at a singularity, and where the block is not square.
        determinant: The determinant, divided by the volume of the equations, in [-1, 1]; nan where not square.
        margin: Distance to a parallel singularity in [0, 1]; see `MotionSpace`.
        out_of_range: Names of the variables outside their ranges, imposed ones included.
    """

    configuration: Configuration
    sign: int
    determinant: float
    margin: float
    out_of_range: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class AssemblyModes:
    """Hold all forward solutions that were found, nearest to the start first, and what speaks for completeness.

    Attributes:
        mechanism: The mechanism.
        imposed: Values of the drives by name [m or rad].
        held: Passive coordinates of free links that were held, with their values.
        modes: The solutions.
        method: How they were found.
        complex_count: Number of complex solutions of the exact method, 0 for the search.
        missing_probability: Estimated probability that a solution is missing [1]; 0 for an exact method whose paths all
            arrived.
        search: The search from many starts, where there was one.
        is_continuous: Whether the platform can move with its drives held: the solutions are then examples.
        left_out: Number of solutions left out because a variable leaves its range.
        has_comparable_signs: Whether the signs of different solutions mean the same; not so where equations repeat
            others in a way that `ParallelOrientation` cannot resolve.
        reason: Why there are no solutions, or why some may be missing; empty where there is nothing to say.
    """

    mechanism: Mechanism
    imposed: Mapping[str, float]
    held: Mapping[str, float]
    modes: tuple[AssemblyMode, ...]
    method: Method
    complex_count: int
    missing_probability: float
    search: Search | None
    is_continuous: bool
    left_out: int
    has_comparable_signs: bool
    reason: str

    def __len__(self) -> int:
        return len(self.modes)

    def __iter__(self) -> Iterator[AssemblyMode]:
        return iter(self.modes)

    def __getitem__(self, index: int) -> AssemblyMode:
        return self.modes[index]

    @property
    def X(self) -> Array:
        """Give the values of all variables [m or rad], shape (n_modes, n_variables)."""
        rows = [mode.configuration.X for mode in self.modes]
        return np.array(rows).reshape(len(rows), len(self.mechanism.names))

    @property
    def poses(self) -> Array:
        """Give the operational variables [m or rad], shape (n_modes, n_operational)."""
        return self.X[:, len(self.mechanism.names) - len(self.mechanism.operational) :]

    @property
    def signs(self) -> NDArray[np.intp]:
        """Give the signs of the determinants, shape (n_modes,)."""
        return np.array([mode.sign for mode in self.modes], dtype=np.intp)

    @property
    def is_even(self) -> bool:
        """Tell whether the number of solutions is even, as it is for platforms away from singularities."""
        return len(self.modes) % 2 == 0

    @property
    def is_balanced(self) -> bool:
        """Tell whether as many determinants are positive as negative.

        The sum of the signs is the degree of the map from configurations to drives. It is the same for all values of
        the drives, and zero where some of them cannot be reached and no stroke is cut off by a range.
        """
        return int(np.sum(self.signs)) == 0


def find_assembly_modes(
    kinematics: Kinematics,
    q: Mapping[str, float],
    start: Start | None = None,
    options: AssemblyOptions | None = None,
) -> AssemblyModes:
    """Find all forward solutions for given drives.

    Planar platforms with three legs of any type, and points on two legs, are solved exactly by one polynomial
    (`solve_planar`); platforms on six distances by tracking all complex solutions (`solve_six_distances`); all others,
    and these two where paths were lost, by Newton from many starts with an estimate of what is missing (`Search`).
    Every solution closes all equations to the search's tolerance; one posture counts once, see `PostureReader`.

    Args:
        kinematics: The mechanism's functions.
        q: Active variables by name [m or rad], all of them.
        start: The branch of coordinates that are held, and the angles to which solutions should be near.
        options: Choices.

    Returns:
        The modes; empty, with a reason, where the loops cannot be closed.

    Raises:
        DefinitionError: An exact method is asked for that does not fit the mechanism.

    Source: Chablat1998, 1.5.2; Husty1996.
    """
    options = options or AssemblyOptions()
    mechanism = kinematics.mechanism
    X = reference_configuration(kinematics, start)
    names = find_held(kinematics, X) if options.hold is None else tuple(options.hold)
    wrong = [n for n in names if mechanism.variables[mechanism.index(n)].role != "passive"]
    if wrong:
        raise DefinitionError(f"{wrong[0]!r} of {mechanism.name!r} cannot be held; only passive variables can")
    X[mechanism.indices(q)] = list(q.values())
    reader = PostureReader(kinematics)
    found = _solve_exactly(kinematics, X, reader, options) if not names else None
    if found is None and options.method not in (None, "many starts"):
        raise DefinitionError(
            f"{mechanism.name!r} is not of the kind that method {options.method!r} solves"
            + (f" while {', '.join(map(repr, names))} are held" if names else "")
            + "; use method=None"
        )
    if found is None or found.lost:
        found = _search(kinematics, X, names, reader, options, found)
    held = {name: float(X[mechanism.index(name)]) for name in names}
    return _conclude(kinematics, dict(q), held, X, found, options)


@dataclass(frozen=True, eq=False)
class _Found:
    """Solutions with what is known of their completeness."""

    X: Array
    method: Method
    complex_count: int = 0
    lost: int = 0
    is_continuous: bool = False
    search: Search | None = None


def _solve_exactly(kinematics: Kinematics, X: Array, reader: PostureReader, options: AssemblyOptions) -> _Found | None:
    """Solve by a method that gives all solutions; None where there is none for this mechanism."""
    if options.method in (None, "planar sextic") and (planar := read_planar_legs(kinematics, X)) is not None:
        poses = solve_planar(planar)
        rows = np.tile(X, (len(poses.poses), 1))
        platform = {m.axis + m.kind: kinematics.mechanism.index(m.name) for m in planar.platform.motions}
        for column, key in enumerate(("xlength", "ylength", "zangle")):
            if key in platform:
                rows[:, platform[key]] = poses.poses[:, column]
        closed = _close(kinematics, rows, X, reader, options)
        return _Found(closed, "planar sextic", poses.degree, 0, poses.is_continuous)
    if options.method in (None, "six distances") and (six := read_six_distances(kinematics, X)) is not None:
        platform_link, problem = six
        answer = solve_six_distances(problem)
        placed = [place_platform(kinematics, platform_link, X, R, p) for R, p in zip(answer.R, answer.p, strict=True)]
        rows = np.array(placed).reshape(-1, len(X))
        closed = _close(kinematics, rows, X, reader, options)
        return _Found(closed, "six distances", answer.finite, answer.lost)
    return None


def _close(kinematics: Kinematics, rows: Array, X: Array, reader: PostureReader, options: AssemblyOptions) -> Array:
    """Find the joints of poses, polish on all equations, and keep different postures."""
    if not len(rows):
        return rows
    closed = close_legs(kinematics, rows, X, options.search)
    return _distinct(_polish(kinematics, closed, options.search), reader, options.search)


def _polish(kinematics: Kinematics, rows: Array, options: SearchOptions) -> Array:
    free = np.ones(rows.shape[1])
    free[: len(kinematics.mechanism.active)] = 0.0
    everything = np.arange(kinematics.graph.F.numel())
    closed, residual = close_rows(kinematics, rows, free, everything, replace(options, step_limit=0.1))
    return closed[residual <= options.tolerance]


def _distinct(rows: Array, reader: PostureReader, options: SearchOptions) -> Array:
    if not len(rows):
        return rows
    marks = reader(rows)
    kept: list[int] = []
    for k in range(len(rows)):
        if all(np.max(np.abs(marks[j] - marks[k])) > options.merge_distance for j in kept):
            kept.append(k)
    return rows[kept]


def _search(
    kinematics: Kinematics,
    X: Array,
    names: Sequence[str],
    reader: PostureReader,
    options: AssemblyOptions,
    exact: _Found | None,
) -> _Found:
    """Search from many starts; harder where the signs of the determinants do not balance."""
    mechanism = kinematics.mechanism
    fixed = {*mechanism.active, *names, *kinematics.idle}
    columns = [k for k, name in enumerate(mechanism.names) if name not in fixed]
    everything = np.arange(kinematics.graph.F.numel())
    effort = options.search
    search = search_solutions(kinematics, X, columns, everything, reader, effort)
    if len(search.X) > 1 and not search.is_continuous and not names:
        signs = _signs(kinematics, search.X, options)[0]
        certain = ParallelOrientation.at(kinematics, search.X[0]).is_certain
        if certain and np.all(signs != 0) and np.sum(signs) != 0:
            harder = replace(effort, missing_probability=0.2 * effort.missing_probability, seed=effort.seed + 1)
            search = search_solutions(kinematics, X, columns, everything, reader, harder)
    rows = search.X if exact is None else _distinct(np.vstack([exact.X, search.X]), reader, effort)
    if len(rows):
        rows = close_legs(kinematics, rows, X, effort, reader)
    method: Method = "many starts" if exact is None else exact.method
    count, lost = (0, 0) if exact is None else (exact.complex_count, exact.lost)
    return _Found(rows, method, count, lost, search.is_continuous, search)


def _signs(kinematics: Kinematics, X: Array, options: AssemblyOptions) -> tuple[NDArray[np.intp], Array, Array]:
    """Give sign, determinant and margin of every solution."""
    (E,) = kinematics.functions.scaled_jacobian.batch(X)
    used = np.array([name not in kinematics.idle for name in kinematics.mechanism.names])
    n_active = len(kinematics.mechanism.active)
    margins = np.zeros(len(X))
    for k, matrix in enumerate(E):
        basis = null_space(matrix[:, used])
        motions = np.zeros((X.shape[1], basis.shape[1]))
        motions[used] = basis
        margins[k] = smallest_and_volume(motions[None, :n_active])[0][0]
    # equations are chosen far from singularities
    determinants = ParallelOrientation.at(kinematics, X[int(np.argmax(margins))])(X)
    signs = np.where(np.isnan(determinants) | (margins < options.singular), 0.0, np.sign(determinants))
    return signs.astype(np.intp), determinants, margins


def _conclude(
    kinematics: Kinematics,
    imposed: dict[str, float],
    held: dict[str, float],
    X: Array,
    found: _Found,
    options: AssemblyOptions,
) -> AssemblyModes:
    mechanism = kinematics.mechanism
    rows = found.X
    outside = [find_out_of_range(kinematics, row) for row in rows]
    judged = [bool(set(names) - set(imposed)) for names in outside]
    keep = [k for k in range(len(rows)) if not (options.respect_ranges and judged[k])]
    keep.sort(key=lambda k: float(np.linalg.norm((rows[k] - X) / kinematics.graph.variable_scale)))
    modes: list[AssemblyMode] = []
    if keep:
        signs, determinants, margins = _signs(kinematics, rows[keep], options)
        residuals = kinematics.scaled_residual(rows[keep])
        for i, k in enumerate(keep):
            configuration = Configuration(mechanism, rows[k], float(residuals[i]))
            modes.append(
                AssemblyMode(configuration, int(signs[i]), float(determinants[i]), float(margins[i]), outside[k])
            )
    comparable = bool(keep) and ParallelOrientation.at(kinematics, rows[keep[0]]).is_certain
    left_out = len(rows) - len(keep)
    search = found.search
    missing = search.missing_probability if search is not None else 0.0
    if search is not None and not len(search.X) and found.method == "many starts":
        missing = 1.0
    return AssemblyModes(
        mechanism, imposed, held, tuple(modes), found.method, found.complex_count, missing, search,
        found.is_continuous, left_out, comparable, _say_why(found, left_out, len(modes), outside, imposed),
    )  # fmt: skip


def _say_why(
    found: _Found, left_out: int, count: int, outside: Sequence[tuple[str, ...]], imposed: Mapping[str, float]
) -> str:
    parts = []
    if not len(found.X):
        if found.search is not None:
            parts.append(
                f"no real solution: none of {found.search.starts} starts closes the loops, the least scaled residual "
                f"is {found.search.residual:.2g}"
            )
        else:
            parts.append(f"no real solution: all {found.complex_count} are complex, or the legs cannot close there")
    elif not count:
        names = sorted({n for some in outside for n in some} - set(imposed))
        parts.append(f"all {left_out} solutions leave the ranges of {', '.join(names)}")
    if found.is_continuous:
        parts.append("the platform can move with its drives held: the solutions are examples of a continuum")
    if found.lost:
        parts.append(
            f"{found.lost} of 40 complex solutions are multiple, at infinity or were not reached; the search from many "
            "starts was added"
        )
    if found.search is not None and not found.search.complete and len(found.X) and not found.is_continuous:
        parts.append(f"the search ended after {found.search.starts} starts, before its bound on what may be missing")
    return "; ".join(parts)
