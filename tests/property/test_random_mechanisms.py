"""What holds for any machine: random trees in space and in the plane, with loops that close by construction."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.closure import build_closure
from paraopt.mechanism import Closure, Coupling, Equilibrium, Joint, Link, Tension
from support import assert_derivative

Array = np.ndarray


@dataclasses.dataclass(frozen=True, eq=False)
class Closed:
    """A machine with values of its variables that close its loops."""

    mechanism: po.Mechanism
    values: Mapping[str, float]

    @property
    def X(self) -> Array:
        return np.array([self.values[n] for n in self.mechanism.names])


lengths = st.floats(-1.0, 1.0).map(lambda v: round(v, 3))
angles = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi, 0.3, -0.7, 1.1])


@st.composite
def joints(draw: st.DrawFn, name: str, planar: bool) -> Joint:
    """Draw a joint of any kind; in the plane one that stays in it."""
    if planar:
        return draw(st.sampled_from([po.Revolute(name), po.Prismatic(name, "x"), po.Prismatic(name, "y"), po.Fixed()]))
    axis = draw(st.sampled_from("xyz"))
    return draw(
        st.sampled_from(
            [
                po.Revolute(name, axis),
                po.Prismatic(name, axis),
                po.Spherical(name, order=draw(st.sampled_from(["xyz", "zyx", "yxz"]))),
                po.Universal(name, axes=(axis, "xyz"[("xyz".index(axis) + 1) % 3])),
                po.Cylindrical(name, axis),
                po.Fixed(),
            ]
        )
    )


@st.composite
def trees(draw: st.DrawFn, planar: bool) -> list[Link]:
    """Draw a base, two to six links that hang from any earlier one, and sometimes a free link."""

    def points() -> tuple[float, ...]:
        return tuple(draw(st.tuples(*[lengths] * (2 if planar else 3))))

    def rotations() -> tuple[float, float, float]:
        return (0.0, 0.0, draw(angles)) if planar else draw(st.tuples(angles, angles, angles))

    links: list[Link] = [po.Base(at=points(), rotation=rotations())]
    for i in range(draw(st.integers(2, 6))):
        father = draw(st.sampled_from([link.name for link in links]))
        links.append(po.Series(f"link {i}", father, points(), draw(joints(f"j{i}", planar)), rotations()))
    if draw(st.booleans()):
        links.append(po.Mobile("plate", order=draw(st.sampled_from(["xyz", "zyx"]))))
    return links


# What a closure may be: its type, and how many equations it has in space and in the plane (None: not in the plane).
CLOSURES: dict[type[Closure], tuple[int, int | None]] = {
    po.Coincidence: (3, 2),
    po.ParallelAxes: (3, 1),
    po.ParallelPlanes: (3, 1),
    po.PerpendicularAxes: (1, 1),
    po.PointOnLine: (3, 1),
    po.PointOnPlane: (1, 1),
    po.Weld: (12, 4),
    po.ClosingSpherical: (3, None),
    po.ClosingUniversal: (4, None),
    po.ClosingCylindrical: (6, None),
    po.ClosingRevolute: (6, 2),
    po.ClosingPrismatic: (9, 2),
    po.PlanarContact: (4, None),
    po.LineContact: (2, None),
}


def tie(kind: type[Closure], names: tuple[str, str], X_AB: Array, planar: bool, random: np.random.Generator,
        name: str) -> Closure:  # fmt: skip
    """Build a closure of some kind between two links that holds at their relative pose."""
    size = 2 if planar else 3
    fields = {f.name for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    if kind is po.Weld:
        alpha, beta, gamma = euler_xyz(X_AB[:3, :3])
        rotation = (0.0, 0.0, gamma) if planar else (alpha, beta, gamma)
        at = [*X_AB[:size, 3], *[0.0] * (3 - size)]
        return po.Weld(*names, at, rotation, name)
    R = X_AB[:3, :3]

    def directions(count: int) -> list[Array]:
        """Draw directions of the second link, each perpendicular to the one before, in the plane too."""
        drawn = np.zeros((count, 3))
        drawn[:, :size] = random.uniform(-1, 1, (count, size))
        if count == 2:
            drawn[1] = (-drawn[0, 1], drawn[0, 0], 0.0) if planar else np.cross(drawn[0], drawn[1])
        return list(drawn)

    p_B = np.zeros(3)
    p_B[:size] = random.uniform(-1, 1, size)
    u, v = directions(2)
    flat = planar and kind is po.ClosingRevolute
    given: dict[str, Any] = {"point_A": X_AB[:3, :3] @ p_B + X_AB[:3, 3], "point_B": p_B}
    # a line lies in a plane, and the axes of a cross are perpendicular: those two take one direction each
    across = kind in (po.PerpendicularAxes, po.ClosingUniversal, po.LineContact)
    given["axis_A"] = "z" if flat else R @ (v if across else u)
    given["axis_B"], given["normal_B"], given["normal_A"] = "z" if flat else u, u, R @ u
    given["direction_A"], given["direction_B"] = (None, None) if planar else (R @ v, v)
    if planar:
        given = {k: [*x[:2], 0.0] if isinstance(x, np.ndarray) else x for k, x in given.items()}
    given |= {"spread": 0.5, "name": name}
    if getattr(kind, "constructions", ()):
        given["construction"] = kind.constructions[int(random.integers(2))]  # type: ignore[attr-defined]
    return kind(link_A=names[0], link_B=names[1], **{k: x for k, x in given.items() if k in fields})  # type: ignore[call-arg]


def euler_xyz(R: Array) -> tuple[float, float, float]:
    """Give angles of `Rx Ry Rz`, also where the middle one is a right angle."""
    beta = float(np.arcsin(np.clip(R[0, 2], -1, 1)))
    if abs(R[0, 2]) > 1 - 1e-12:
        return float(np.arctan2(R[2, 1], R[1, 1])), beta, 0.0
    return float(np.arctan2(-R[1, 2], R[2, 2])), beta, float(np.arctan2(-R[0, 1], R[0, 0]))


@st.composite
def closed_mechanisms(draw: st.DrawFn, planar: bool | None = None) -> Closed:
    """Draw a machine, values of its variables, and coincidences that hold at these values."""
    planar = draw(st.booleans()) if planar is None else planar
    links = draw(trees(planar))
    if planar:
        links = [
            dataclasses.replace(k, coordinates=("x", "y", "theta")) if isinstance(k, po.Mobile) else k for k in links
        ]
    names = [m.name for link in links for m in link.motions]
    assume(len(names) >= 2)
    shuffled = draw(st.permutations(names))
    n_active = draw(st.integers(1, len(names) - 1))
    n_operational = draw(st.integers(1, len(names) - n_active))
    tree = po.Mechanism(
        "random",
        links,
        (),
        active=shuffled[:n_active],
        operational=shuffled[n_active : n_active + n_operational],
        planar=planar,
        characteristic_length=draw(st.sampled_from([None, 0.7])),
    )
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    values = dict(zip(names, random.uniform(-1.0, 1.0, len(names)).tolist(), strict=True))
    poses = link_poses(tree, values)
    closures = []
    for k in range(draw(st.integers(0, 3))):
        first, second = draw(
            st.lists(st.sampled_from([link.name for link in links]), min_size=2, max_size=2, unique=True)
        )
        kinds = [k for k, (_, flat) in CLOSURES.items() if not planar or flat is not None]
        X_AB = np.linalg.solve(poses[first], poses[second])
        closures.append(tie(draw(st.sampled_from(kinds)), (first, second), X_AB, planar, random, f"tie {k}"))
    return Closed(dataclasses.replace(tree, closures=closures), values)


def link_poses(mechanism: po.Mechanism, values: Mapping[str, float]) -> dict[str, Array]:
    graph = build_closure(mechanism)
    X = [values[n] for n in mechanism.names]
    return {name: np.asarray(ca.Function("X", [graph.X], [X_W])(X)) for name, X_W in graph.X_W.items()}


def report_of(closed: Closed) -> po.StateReport:
    kinematics = po.Kinematics(closed.mechanism, "virtual machine")
    return po.report_state(kinematics, kinematics.configuration(closed.X))


def is_clear_cut(report: po.StateReport) -> bool:
    """Tell whether no rank hangs on the tolerance: kept values above 1e-5 of the rest."""
    return all(r.gap > 1e6 and (r.value == 0 or r.smallest_kept > 1e-4) for r in report.ranks.values())


def equations(closure: Closure, planar: bool) -> int:
    """Count the equations of a closure, those of its second construction too."""
    count = CLOSURES[type(closure)][planar]
    second = closure.construction != closure.constructions[0] if hasattr(closure, "construction") else False
    if second and not planar:
        count = {
            po.ClosingCylindrical: 6, po.ClosingRevolute: 7, po.ClosingPrismatic: 7, po.PlanarContact: 3,
            po.LineContact: 2,
        }[type(closure)]  # fmt: skip
    assert count is not None
    return count


# --- The graph


@given(closed=closed_mechanisms())
def test_jacobian_is_the_derivative_of_the_residual(closed: Closed) -> None:
    graph = build_closure(closed.mechanism)
    residual, E = ca.Function("F", [graph.X], [graph.F]), ca.Function("E", [graph.X], [graph.E])
    assert graph.F.shape == (sum(equations(c, closed.mechanism.planar) for c in closed.mechanism.closures), 1)
    # chains of up to seven links of lengths of order one: fifth derivatives of some 1e2, at steps of 1e-3
    assert_derivative(
        np.asarray(E(closed.X)).reshape(graph.E.shape),
        lambda X: np.asarray(residual(X))[:, 0],
        closed.X,
        tolerance=1e-9,
    )


@given(closed=closed_mechanisms())
def test_loops_close_where_they_were_closed(closed: Closed) -> None:
    kinematics = po.Kinematics(closed.mechanism, "virtual machine")
    assert kinematics.scaled_residual(closed.X)[0] < 1e-13
    assert kinematics.configuration(closed.X).as_dict() == dict(closed.values)
    # the base moves the robot, and free links do not follow: rigid motions of everything leave the loops closed
    poses = kinematics.poses(closed.X)[0]
    assert_allclose(poses[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1), np.tile(np.eye(3), (len(poses), 1, 1)),
                    atol=1e-13)  # fmt: skip


# --- Names and orders mean nothing


def renamed(closed: Closed, links: Mapping[str, str], variables: Mapping[str, str]) -> Closed:
    """Rename every link and every variable."""

    def joint(old: Any) -> Joint:
        if isinstance(old, po.Fixed):
            return old
        names = [variables[m.name] for m in old.motions]
        return (
            dataclasses.replace(old, names=names) if hasattr(old, "names") else dataclasses.replace(old, name=names[0])
        )

    def link(old: Link) -> Link:
        if isinstance(old, po.Series):
            return dataclasses.replace(old, name=links[old.name], father=links[old.father], joint=joint(old.joint))
        if isinstance(old, po.Mobile):
            return dataclasses.replace(old, name=links[old.name], prefix="free ")
        return dataclasses.replace(old, name=links[old.name])

    m = closed.mechanism
    mechanism = po.Mechanism(
        "other",
        [link(k) for k in m.links],
        [
            dataclasses.replace(c, link_A=links[c.link_A], link_B=links[c.link_B], name=f"closure {i}")  # type: ignore[type-var]
            for i, c in enumerate(m.closures)
        ],
        [variables[n] for n in m.active],
        [variables[n] for n in m.operational],
        m.planar,
        m.characteristic_length,
    )
    return Closed(mechanism, {variables[n]: v for n, v in closed.values.items()})


def assert_same_state(one: po.StateReport, other: po.StateReport) -> None:
    assert {n: r.value for n, r in one.ranks.items()} == {n: r.value for n, r in other.ranks.items()}
    assert (one.mobility, one.useful_mobility) == (other.mobility, other.useful_mobility)
    assert one.redundant_rows == other.redundant_rows
    # the motions are found with a regularisation of 1e-12, which a smallest singular value of 1e-4 turns into 1e-8 of
    # them; the margins are singular values of an orthonormal basis
    assert other.parallel_margin == pytest.approx(one.parallel_margin, abs=1e-6)
    assert other.serial_margin == pytest.approx(one.serial_margin, abs=1e-6)


@given(closed=closed_mechanisms(), data=st.data())
def test_names_and_order_of_links_and_closures_mean_nothing(closed: Closed, data: st.DataObject) -> None:
    report = report_of(closed)
    assume(is_clear_cut(report))
    m = closed.mechanism
    permuted = dataclasses.replace(
        m, links=data.draw(st.permutations(m.links)), closures=data.draw(st.permutations(m.closures))
    )
    assert_same_state(report, report_of(Closed(permuted, closed.values)))
    links = {link.name: f"part {i}" for i, link in enumerate(data.draw(st.permutations(m.links)))}
    variables = {
        n: "free " + n if m.link(v.link).motions and isinstance(m.link(v.link), po.Mobile) else f"v{i}"
        for i, (n, v) in enumerate(zip(m.names, m.variables, strict=True))
    }
    again = report_of(renamed(closed, links, variables))
    assert_same_state(report, again)
    assert sorted(again.idle) == sorted(variables[n] for n in report.idle)


@given(closed=closed_mechanisms(), data=st.data())
def test_order_of_roles_means_nothing(closed: Closed, data: st.DataObject) -> None:
    report = report_of(closed)
    assume(is_clear_cut(report))
    m = closed.mechanism
    other = dataclasses.replace(
        m, active=data.draw(st.permutations(m.active)), operational=data.draw(st.permutations(m.operational))
    )
    assert_same_state(report, report_of(Closed(other, closed.values)))


def rescaled(closed: Closed, factor: float) -> Closed:
    """State all lengths in another unit."""

    def scaled(item: Any) -> Any:
        lengths = {
            f.name: [factor * c for c in getattr(item, f.name)]
            for f in dataclasses.fields(item)
            if f.name == "at" or f.name.startswith("point_")
        }
        if getattr(item, "spread", None) is not None:
            lengths["spread"] = factor * item.spread
        return dataclasses.replace(item, **lengths)

    m = closed.mechanism
    stated = m.characteristic_length
    mechanism = dataclasses.replace(
        m,
        links=[scaled(link) for link in m.links],
        closures=[scaled(c) for c in m.closures],
        characteristic_length=None if stated is None else factor * stated,
    )
    kinds = {v.name: v.kind for v in m.variables}
    return Closed(mechanism, {n: v * (factor if kinds[n] == "length" else 1.0) for n, v in closed.values.items()})


@given(closed=closed_mechanisms(), factor=st.sampled_from([1e3, 1e-3, 39.37]))
def test_the_unit_of_length_means_nothing(closed: Closed, factor: float) -> None:
    report = report_of(closed)
    assume(is_clear_cut(report))
    other = rescaled(closed, factor)
    # where no point is away from its origin the characteristic length is 1 of whatever unit
    assume(other.mechanism.length == pytest.approx(factor * closed.mechanism.length))
    again = report_of(other)
    assert_same_state(report, again)
    assert again.idle == report.idle


def rerooted(closed: Closed, root: str) -> Closed:
    """Describe the same machine from another of its links: the joints on the way are read backwards."""
    m = closed.mechanism
    way = [m.link(root)]
    while isinstance(way[-1], po.Series):
        way.append(m.link(way[-1].father))
    links: list[Link] = [po.Base(root)]
    values = dict(closed.values)
    here = root
    for link, father in itertools.pairwise(way):
        assert isinstance(link, po.Series)
        # X_link = X_father C J, so X_father = X_link J^-1 C^-1 with C^-1 = Rz^-1 Ry^-1 Rx^-1 T^-1
        steps: list[dict[str, Any]] = []
        for motion in reversed(link.motions):
            kind = po.Revolute if motion.kind == "angle" else po.Prismatic
            steps.append({"joint": kind(motion.name, motion.axis)})
            values[motion.name] = -values[motion.name]
        a, b, c = (-float(v) for v in link.rotation)
        steps += [{"rotation": (0, 0, c)}, {"rotation": (0, b, 0)}, {"rotation": (a, 0, 0)}]
        steps.append({"at": [-v for v in link.at]})
        for k, step in enumerate(steps):
            name = father.name if k == len(steps) - 1 else f"{link.name} to {father.name} {k}"
            links.append(po.Series(name, here, **step))
            here = name
    gone = {link.name for link in way}
    links += [link for link in m.links if link.name not in gone]
    return Closed(dataclasses.replace(m, links=links, characteristic_length=m.length), values)


@given(closed=closed_mechanisms(), data=st.data())
def test_the_link_taken_for_the_base_means_nothing(closed: Closed, data: st.DataObject) -> None:
    m = closed.mechanism
    assume(not any(isinstance(link, po.Mobile) for link in m.links))  # its coordinates are those seen from the base
    report = report_of(closed)
    assume(is_clear_cut(report))
    root = data.draw(st.sampled_from([link.name for link in m.links if isinstance(link, po.Series)]))
    other = rerooted(closed, root)
    assert other.mechanism.base.name == root
    again = report_of(other)
    assert_same_state(report, again)
    assert sorted(again.idle) == sorted(report.idle)


@given(closed=closed_mechanisms(), data=st.data())
def test_ranks_obey_their_laws(closed: Closed, data: st.DataObject) -> None:
    report = report_of(closed)
    r = {n: rank.value for n, rank in report.ranks.items()}
    assert report.mobility == len(closed.mechanism.names) - r["E"]
    assert report.redundant_rows == report.n_equations - r["E"] == report.n_equations - len(report.independent_rows)
    assert max(r["[N K]"], r["[M N]"]) <= r["E"] <= min(r["M"] + r["N"] + r["K"], report.n_equations)
    assert r["[N K]"] <= r["N"] + r["K"]
    assert r["[M N]"] <= r["M"] + r["N"]
    assert 0.0 <= report.parallel_margin <= 1.0 + 1e-9
    assert 0.0 <= report.serial_margin <= 1.0 + 1e-9
    assert set(report.idle) <= set(closed.mechanism.names)


# --- Solving


@given(closed=closed_mechanisms(), seed=st.integers(0, 2**32 - 1))
def test_a_perturbed_configuration_returns_to_closure(closed: Closed, seed: int) -> None:
    kinematics = po.Kinematics(closed.mechanism, "virtual machine")
    assume(is_clear_cut(po.report_state(kinematics, kinematics.configuration(closed.X))))
    start = closed.X + np.random.default_rng(seed).uniform(-0.01, 0.01, len(closed.X))
    solution = kinematics.solve({}, start)
    assert solution.status is po.Status.CONVERGED
    assert kinematics.scaled_residual(solution.configuration.X)[0] <= 1e-12
    # idle variables stay where they are
    idle = closed.mechanism.indices(kinematics.idle)
    assert np.array_equal(solution.X[idle], start[idle])


@given(closed=closed_mechanisms(), seed=st.integers(0, 2**32 - 1), count=st.integers(0, 4))
def test_imposed_values_are_met_exactly_or_not_claimed(closed: Closed, seed: int, count: int) -> None:
    """Impose some of the values that close the loops, and start a little beside them."""
    kinematics = po.Kinematics(closed.mechanism, "virtual machine")
    random = np.random.default_rng(seed)
    names: Sequence[str] = closed.mechanism.names
    chosen = [names[i] for i in random.permutation(len(names))[:count]]
    impose = {n: closed.values[n] for n in chosen}
    solution = kinematics.solve(impose, closed.X + random.uniform(-1e-3, 1e-3, len(names)))
    assert solution.residual == pytest.approx(kinematics.scaled_residual(solution.X)[0], abs=1e-14)
    if solution.status in (po.Status.CONVERGED, po.Status.SINGULAR):
        assert all(solution.configuration[n] == v for n, v in impose.items())
        assert solution.residual <= 1e-12
    else:
        with pytest.raises(po.SolveError):
            _ = solution.configuration


@given(closed=closed_mechanisms())
def test_motions_keep_the_loops_closed(closed: Closed) -> None:
    """The tangent annihilates E where the chosen coordinates parametrise the motions."""
    kinematics = po.Kinematics(closed.mechanism, "virtual machine")
    report = po.report_state(kinematics, kinematics.configuration(closed.X))
    assume(is_clear_cut(report))
    operational = closed.mechanism.operational
    # the others follow from them: no more of them than motions, all independent
    assume(report.ranks["[M N]"].value == report.ranks["E"].value)
    assume(not set(operational) & set(report.idle))
    T = kinematics.tangent(closed.X, operational)[0]
    E = np.column_stack(kinematics.jacobians(closed.X))  # a block of one column comes as a vector
    # regularised by 1e-12, over squared singular values of 1e-8 at least, with two refinements
    assert_allclose(E @ T, 0, atol=1e-6 * max(1.0, np.abs(T).max()))
    assert_allclose(T[closed.mechanism.indices(operational)], np.eye(len(operational)), atol=1e-9)


# --- Forces and relations


@st.composite
def balanced_mechanisms(draw: st.DrawFn) -> Closed:
    """Draw a machine with a link in balance under cables, by the wrench that it takes, and a relation of joints."""
    closed = draw(closed_mechanisms())
    m = closed.mechanism
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    size = 2 if m.planar else 3
    poses = link_poses(m, closed.values)
    link = draw(st.sampled_from([k.name for k in m.links if k.name != m.base.name]))
    mass, gravity, centre = 3.0, np.zeros(3), np.zeros(3)
    gravity[size - 1], centre[:size] = -9.81, random.uniform(-1, 1, size)
    c = poses[link][:3, :3] @ centre + poses[link][:3, 3]
    tensions, pulls, left, moment = [], {}, mass * gravity, np.zeros(3)
    for i in range(draw(st.integers(1, 4))):
        ends = np.zeros((2, 3))
        ends[:, :size] = random.uniform(-1, 1, (2, size))
        exit_, held = (poses[k][:3, :3] @ p + poses[k][:3, 3] for k, p in zip((m.base.name, link), ends, strict=True))
        assume(np.linalg.norm(exit_ - held) > 0.3)  # a cable without length has no direction
        pulls[f"pull {i}"] = random.uniform(1.0, 30.0)
        pull = pulls[f"pull {i}"] * (exit_ - held) / np.linalg.norm(exit_ - held)
        left, moment = left + pull, moment + np.cross(held - c, pull)
        sides = [(m.base.name, ends[0].tolist()), (link, ends[1].tolist())]
        a, b = draw(st.permutations(sides))
        tensions.append(Tension(f"pull {i}", *a, *b))
    force = -left
    balance = Equilibrium(
        link, tensions, mass, centre.tolist(), force.tolist(), centre.tolist(), (-moment).tolist(), gravity.tolist()
    )
    angles = [v.name for v in m.variables if v.kind == "angle"]
    lengths = [v.name for v in m.variables if v.kind == "length"]
    factors = {n: float(random.uniform(0.5, 2.0)) for n in (angles if len(angles) > 1 and not lengths else lengths)[:2]}
    radii = {n: float(random.uniform(0.1, 0.5)) for n in angles[:1] if n not in factors}
    closures: list[Closure] = [*m.closures, balance]
    if len(factors) + len(radii) > 1:
        total = sum(f * closed.values[n] for n, f in {**factors, **radii}.items())
        closures.append(Coupling(factors, radii, **{"length" if lengths or radii else "angle": total}))
    return Closed(dataclasses.replace(m, closures=closures), {**closed.values, **pulls})


@given(closed=balanced_mechanisms())
def test_forces_and_relations_hold_where_they_were_made_to(closed: Closed) -> None:
    kinematics = po.Kinematics(closed.mechanism, "virtual machine")
    assert kinematics.scaled_residual(closed.X)[0] < 1e-12
    graph = kinematics.graph
    residual, E = ca.Function("F", [graph.X], [graph.F]), ca.Function("E", [graph.X], [graph.E])
    # cables of 0.3 m and forces of 1e2 N: fifth derivatives of some 1e5, at steps of 1e-4
    assert_derivative(
        np.asarray(E(closed.X)).reshape(graph.E.shape), lambda X: np.asarray(residual(X))[:, 0], closed.X,
        step=1e-4, tolerance=1e-8,
    )  # fmt: skip


@given(closed=balanced_mechanisms(), factor=st.sampled_from([1e3, 1e-3]), mass=st.sampled_from([1.0, 1e-3, 250.0]))
def test_units_of_length_and_force_mean_nothing(closed: Closed, factor: float, mass: float) -> None:
    """Scaled matrices are the same to the last digits, with forces in any unit too."""
    m = rescaled(closed, factor).mechanism
    closures: list[Closure] = []
    for c in m.closures:
        if isinstance(c, Equilibrium):
            pulls = [
                dataclasses.replace(t, **{p: [factor * x for x in getattr(t, p)] for p in ("point_A", "point_B")})
                for t in c.tensions
            ]
            vectors = {
                "force": mass * factor,
                "moment": mass * factor**2,
                "gravity": factor,
                "centre": factor,
            }  # "at" is scaled already
            scaled = {k: [f * x for x in getattr(c, k)] for k, f in vectors.items()}
            closures.append(dataclasses.replace(c, tensions=pulls, mass=mass * c.mass, **scaled))
        elif isinstance(c, Coupling):
            radii = {n: factor * r for n, r in c.radii.items()}
            closures.append(dataclasses.replace(c, radii=radii, length=factor * c.length))
        else:
            closures.append(c)
    other = dataclasses.replace(m, closures=closures)
    unit = {"length": factor, "angle": 1.0, "force": mass * factor}
    X = closed.X * [unit[v.kind] for v in other.variables]
    E, E_other = (
        po.Kinematics(k, "virtual machine").functions.scaled_jacobian(x)[0]
        for k, x in ((closed.mechanism, closed.X), (other, X))
    )
    assert_allclose(E_other, E, atol=1e-9 * max(1.0, float(np.max(np.abs(E)))))
