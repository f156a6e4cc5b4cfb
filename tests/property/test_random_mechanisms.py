"""What holds for any machine: random trees in space and in the plane, with loops that close by construction."""

from __future__ import annotations

import dataclasses
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
from paraopt.mechanism import Joint, Link
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
                po.Spherical(name),
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
        links.append(po.Mobile("plate"))
    return links


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
        p_A = np.array([*random.uniform(-1, 1, 2 if planar else 3), *([0.0] if planar else [])])
        # the point of the first link, seen from the second: the loop closes here
        p_B = np.linalg.solve(poses[second], poses[first] @ [*p_A, 1.0])[:3]
        if planar:
            p_B[2] = 0.0
        closures.append(po.Coincidence(first, p_A, second, p_B, f"tie {k}"))
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


# --- The graph


@given(closed=closed_mechanisms())
def test_jacobian_is_the_derivative_of_the_residual(closed: Closed) -> None:
    graph = build_closure(closed.mechanism)
    residual, E = ca.Function("F", [graph.X], [graph.F]), ca.Function("E", [graph.X], [graph.E])
    assert graph.F.shape == ((2 if closed.mechanism.planar else 3) * len(closed.mechanism.closures), 1)
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
            po.Coincidence(links[c.link_A], c.point_A, links[c.link_B], c.point_B, f"closure {i}")
            for i, c in enumerate(m.closures)
            if isinstance(c, po.Coincidence)
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
