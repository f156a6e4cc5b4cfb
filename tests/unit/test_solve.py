"""Impose some variables, solve for the rest: status, residual and rank are told, and nothing open comes out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import paraopt as po
from support import five_bar_robot, raf_configurations, raf_robot, two_rpr, two_rpr_values, vector

Status = po.Status
HOME = {"x": 0.0, "y": 0.0, "z": 0.48}
# scaled closure residual of a converged solve, the default of `SolveOptions` [1]
CLOSED = 1e-12


@pytest.fixture(scope="module")
def raf() -> po.Kinematics:
    return raf_robot().kinematics


@pytest.fixture(scope="module")
def home() -> po.Configuration:
    return raf_robot().home_configuration


@pytest.fixture(scope="module")
def five_bar() -> po.Kinematics:
    return five_bar_robot().kinematics


@pytest.fixture(scope="module")
def legs() -> po.Kinematics:
    return po.Kinematics(two_rpr(), "virtual machine")


def check_honest(kinematics: po.Kinematics, solution: po.Solution, impose: Mapping[str, float]) -> None:
    """Recompute everything that a solution says about itself."""
    assert solution.residual == pytest.approx(kinematics.scaled_residual(solution.X)[0], abs=1e-14)
    assert dict(solution.imposed) == dict(impose)
    for name, value in impose.items():
        got = solution.X[kinematics.mechanism.index(name)]
        assert solution.deviation[name] == pytest.approx(got - value, abs=1e-15)
    if solution.status in (Status.CONVERGED, Status.SINGULAR):
        assert solution.residual <= CLOSED
        assert not any(solution.deviation.values())
    outside = [
        v.name
        for v, value in zip(kinematics.mechanism.variables, solution.X, strict=True)
        if not v.range[0] - 1e-9 <= value <= v.range[1] + 1e-9
    ]
    assert list(solution.out_of_range) == outside
    assert solution.iterations >= 1
    assert solution.status.value in solution.summary
    assert f"rank {solution.rank.value}" in solution.summary


# --- Exact solutions


def test_inverse_model_of_the_raf_by_the_length_of_its_legs(raf: po.Kinematics, home: po.Configuration) -> None:
    """The strokes follow from the distance of the legs' ends alone: leg length = 390 mm + q."""
    base = np.array([(185, -106, 20), (-185, -106, 20), (0, 214, 20)]) * 1e-3
    ends = np.array([(85, -49, -20), (-85, -49, -20), (0, 98, -20)]) * 1e-3
    for configuration in raf_configurations():
        x = dict(zip("xyz", configuration.operational.tolist(), strict=True))
        solution = raf.inverse(x, start=home)
        check_honest(raf, solution, x)
        assert solution.status is Status.CONVERGED
        q = np.linalg.norm(np.array([*x.values()]) + ends - base, axis=1) - 0.39
        # residual of 1e-12 of the characteristic length of 0.2 m, and the platform's angles
        assert_allclose(solution.configuration.active, q, atol=1e-11)


def test_redundant_rows_and_idle_freedoms_are_handled_by_rank(raf: po.Kinematics, home: po.Configuration) -> None:
    solution = raf.inverse(HOME, start=home)
    assert (solution.status, solution.rank.value, solution.undetermined) == (Status.CONVERGED, 26, 0)
    # the cut between what counts and what does not is not a matter of taste
    assert solution.rank.gap > 1e6


def test_idle_variables_stay_where_they_start(raf: po.Kinematics, home: po.Configuration) -> None:
    start = home.X.copy()
    spins = raf.mechanism.indices(["jack 1.z", "jack 2.z", "jack 3.z"])
    start[spins] = (0.3, -1.2, 2.5)
    solution = raf.inverse({"x": 0.02, "y": 0.01, "z": 0.5}, start)
    assert solution.status is Status.CONVERGED
    assert_array_equal(solution.X[spins], (0.3, -1.2, 2.5))
    # and go where they are imposed
    assert raf.solve({**HOME, "jack 2.z": 0.7}, home).configuration["jack 2.z"] == 0.7


@pytest.mark.parametrize(
    "names",
    [
        ("x", "y", "z"),
        ("q1", "q2", "q3"),
        ("arm A", "arm B", "x"),
        ("q1", "y", "arm B"),
        ("jack 1.x", "jack 1.y", "z"),
        ("x", "y"),
        ("z",),
        (),
        ("x", "y", "z", "q1"),  # one too many, but consistent
        ("x", "y", "z", "alpha", "beta", "gamma"),
    ],
    ids=" ".join,
)
def test_any_set_of_variables_can_be_imposed(
    raf: po.Kinematics, home: po.Configuration, names: tuple[str, ...]
) -> None:
    wanted = raf_configurations()[1]
    impose = {n: wanted[n] for n in names}
    solution = raf.solve(impose, start=home)
    check_honest(raf, solution, impose)
    assert solution.status is Status.CONVERGED
    assert solution.undetermined == max(3 - len(names), 0)
    assert all(solution.configuration[n] == value for n, value in impose.items())
    if len(names) == 3:
        # on the same branch, three independent values say everything; they carry a residual of 1e-12 of 0.2 m, which
        # the choices above amplify less than a hundred times
        assert_allclose(solution.configuration.operational, wanted.operational, atol=1e-10)


def test_forward_is_the_inverse_of_inverse(raf: po.Kinematics, home: po.Configuration) -> None:
    for wanted in raf_configurations():
        q = dict(zip(raf.mechanism.active, wanted.active.tolist(), strict=True))
        solution = raf.forward(q, start=home)
        check_honest(raf, solution, q)
        assert_allclose(solution.configuration.operational, wanted.operational, atol=1e-10)  # 1e-12 over the margin


def test_five_bar_by_the_law_of_cosines(five_bar: po.Kinematics) -> None:
    start = five_bar_robot().home_configuration
    for x, y in ((6.0, 7.0), (5.0, 8.0), (3.0, 7.5), (7.0, 6.0)):
        configuration = five_bar.inverse({"x": x, "y": y}, start).configuration
        # angle at the elbow of a triangle with two bars and the distance from the driven axis
        for elbow, origin, bars in (("theta3", 0.0, (8.0, 5.0)), ("theta4", 9.0, (5.0, 8.0))):
            reach2 = (x - origin) ** 2 + y**2
            cosine = (reach2 - bars[0] ** 2 - bars[1] ** 2) / (2 * bars[0] * bars[1])
            assert abs(configuration[elbow]) == pytest.approx(np.arccos(cosine), abs=1e-11)
            assert np.sign(configuration[elbow]) == np.sign(start[elbow])


STARTS: dict[str, Any] = {
    "configuration": lambda home: home,
    "values by name": lambda home: {"arm A": 1.0, "arm B": 1.0, "q1": 0.06, "q2": 0.06, "q3": 0.06},
    "all values": lambda home: home.X,
    "list": lambda home: home.X.tolist(),
    "none": lambda home: None,
}


@pytest.mark.parametrize("choose", STARTS.values(), ids=STARTS.keys())
def test_every_kind_of_start(raf: po.Kinematics, home: po.Configuration, choose: Any) -> None:
    x = {"x": 0.01, "y": -0.02, "z": 0.5}
    solution = raf.inverse(x, choose(home))
    check_honest(raf, solution, x)
    assert solution.status is Status.CONVERGED


def test_without_a_start_the_answer_repeats(raf: po.Kinematics) -> None:
    first, second = raf.inverse(HOME), raf.inverse(HOME)
    assert_array_equal(first.X, second.X)


def test_starts_are_not_changed(raf: po.Kinematics, home: po.Configuration) -> None:
    start = home.X.copy()
    raf.inverse({"x": 0.03, "y": 0.0, "z": 0.5}, start)
    assert_array_equal(start, home.X)


def test_virtual_machine_finds_the_same(raf: po.Kinematics, home: po.Configuration) -> None:
    slow = po.Kinematics(raf.mechanism, "virtual machine")
    for impose in (
        {"x": 0.03, "y": -0.02, "z": 0.5},
        {"q1": 0.09, "q2": 0.08, "q3": 0.1},
        {"z": 0.9, "x": 0.0, "y": 0.0},
    ):
        one, other = raf.solve(impose, home), slow.solve(impose, home)
        assert one.status is other.status
        # both close to 1e-12; the nearest values are found to 1e-8 of the characteristic length
        assert_allclose(one.X, other.X, atol=1e-11 if one.status is Status.CONVERGED else 1e-7)


# --- Batches


def test_batch_equals_single_solves(raf: po.Kinematics, home: po.Configuration) -> None:
    values = np.array([c.operational for c in raf_configurations()])
    # two points out of reach among good ones, one start that is no number
    values = np.vstack([values, [(0, 0, 0.9), (2, 2, 2), (0, 0, 0.5)]])
    starts = np.tile(home.X, (len(values), 1))
    starts[-1, 3] = np.nan
    batch = raf.solve_batch(("x", "y", "z"), values, starts)
    assert batch.converged.tolist() == [True] * len(raf_configurations()) + [False] * 3
    assert np.all(batch.residual[batch.converged] <= CLOSED)
    assert np.all(batch.residual[~batch.converged] > CLOSED)
    for i, x in enumerate(values[batch.converged].tolist()):
        single = raf.inverse(dict(zip("xyz", x, strict=True)), home)
        assert_array_equal(batch.X[i], single.X)
    assert_allclose(batch.residual[:-1], raf.scaled_residual(batch.X[:-1]), atol=1e-14)
    assert_array_equal(batch.X[:, -3:], values)


def test_batch_takes_names_in_any_order(raf: po.Kinematics, home: po.Configuration) -> None:
    batch = raf.solve_batch(("z", "x", "y"), [(0.5, 0.01, 0.02)], home.X)
    assert_array_equal(batch.X[0, -3:], (0.01, 0.02, 0.5))
    assert batch.converged.all()


def test_empty_batch(raf: po.Kinematics) -> None:
    batch = raf.solve_batch(("x", "y", "z"), np.empty((0, 3)), np.empty((0, 32)))
    assert (batch.X.shape, batch.residual.shape, batch.converged.shape) == ((0, 32), (0,), (0,))


# --- Nearest solutions (XFKM)


def test_raf_too_high_stops_at_its_strokes(raf: po.Kinematics, home: po.Configuration) -> None:
    impose = {"x": 0.0, "y": 0.0, "z": 0.9}
    solution = raf.inverse(impose, start=home)
    check_honest(raf, solution, impose)
    assert solution.status is Status.NEAREST
    nearest = solution.nearest
    assert raf.scaled_residual(nearest.X)[0] <= CLOSED
    # all three jacks out, to the accuracy of the quadratic programs
    assert_allclose(nearest.active, 0.2, atol=1e-7)
    assert solution.out_of_range == ()
    assert "'z' wanted 0.9 m, nearest 0.6186" in solution.summary
    with pytest.raises(po.SolveError, match="nearest: no exact solution") as caught:
        _ = solution.configuration
    assert caught.value.evidence["solution"] is solution


def test_nothing_within_the_strokes_is_nearer(raf: po.Kinematics, home: po.Configuration) -> None:
    """A search by brute force: closed configurations within the strokes all over the workspace."""
    target = np.array([0.1, 0.1, 0.65])
    solution = raf.inverse(dict(zip("xyz", target.tolist(), strict=True)), start=home)
    assert solution.status is Status.NEAREST
    found = float(np.linalg.norm(solution.nearest.operational - target))
    poses = np.random.default_rng(5).uniform((-0.1, -0.1, 0.4), (0.2, 0.2, 0.66), size=(4000, 3))
    batch = raf.solve_batch(("x", "y", "z"), poses, np.tile(home.X, (len(poses), 1)))
    q = batch.X[:, :3]
    valid = batch.converged & np.all((q >= 0.0) & (q <= 0.2), axis=1)
    distances = np.linalg.norm(poses[valid] - target, axis=1)
    assert valid.sum() > 500
    assert found < distances.min() + 1e-7
    assert distances.min() < found + 0.02  # the search came near enough to have found something better


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        # out of the reach of 13 about the first axis, along the ray
        ((20.0, 0.0), (13.0, 0.0)),
        ((30.0, 30.0), (13.0 / np.sqrt(2), 13.0 / np.sqrt(2))),
        # out of the reach of 13 about the second axis at (9, 0)
        ((-14.0, 0.0), (-4.0, 0.0)),
        ((0.0, 13.0), (9 - 9 * 13 / np.hypot(9, 13), 13 * 13 / np.hypot(9, 13))),
        # in the hole of radius 8 - 5 about the first axis
        ((1.0, 1.0), (3.0 / np.sqrt(2), 3.0 / np.sqrt(2))),
    ],
)
def test_five_bar_out_of_reach_comes_as_near_as_it_can(
    five_bar: po.Kinematics, target: tuple[float, float], expected: tuple[float, float]
) -> None:
    impose = dict(zip("xy", target, strict=True))
    solution = five_bar.inverse(impose, five_bar_robot().home_configuration)
    check_honest(five_bar, solution, impose)
    assert solution.status is Status.NEAREST
    # where the leg is stretched the distance is flat in the angles: the square root of the accuracy of the programs
    assert_allclose(solution.nearest.operational, expected, atol=1e-5)


@pytest.mark.parametrize("q", [(0.25, 0.07, 0.05), (0.3, 0.07, 0.05), (0.3, 0.3, 0.3)])
def test_strokes_beyond_their_range_come_back_into_it(
    raf: po.Kinematics, home: po.Configuration, q: tuple[float, float, float]
) -> None:
    impose = dict(zip(("q1", "q2", "q3"), q, strict=True))
    solution = raf.forward(impose, start=home)
    check_honest(raf, solution, impose)
    assert solution.status is Status.NEAREST
    assert_allclose(solution.nearest.active, np.minimum(q, 0.2), atol=1e-7)
    assert solution.out_of_range == ()


def test_exact_solutions_out_of_range_are_told(raf: po.Kinematics, home: po.Configuration) -> None:
    solution = raf.inverse({"x": 0.0, "y": 0.0, "z": 0.405}, start=home)
    assert solution.status is Status.CONVERGED
    assert solution.out_of_range == ("q1", "q2", "q3")


def test_contradictory_values_are_not_met(raf: po.Kinematics, home: po.Configuration) -> None:
    """The platform cannot be tilted: its chains lock the rotations."""
    impose = {**HOME, "alpha": 0.1}
    solution = raf.solve(impose, start=home)
    check_honest(raf, solution, impose)
    assert solution.status is Status.NEAREST
    assert solution.deviation["alpha"] == pytest.approx(-0.1, abs=1e-7)
    assert "'alpha' wanted 0.1 rad" in solution.summary


@pytest.mark.parametrize("x", [(0, 0, 0.9), (1, 1, 1), (0.3, 0, 0.5), (0, 0, 5.0), (0, 0, 0.3), (0, 0, -1)])
@pytest.mark.parametrize("start", [True, False], ids=["from home", "without start"])
def test_a_solution_is_closed_or_it_raises(
    raf: po.Kinematics, home: po.Configuration, x: tuple[float, float, float], start: bool
) -> None:
    impose = dict(zip("xyz", x, strict=True))
    solution = raf.inverse(impose, home if start else None)
    check_honest(raf, solution, impose)
    if solution.status in (Status.NEAREST, Status.FAILED):
        with pytest.raises(po.SolveError, match="'RAF'"):
            _ = solution.configuration
    if solution.status is Status.NEAREST:
        assert solution.out_of_range == ()
    if solution.status is not Status.FAILED:
        assert raf.scaled_residual(solution.nearest.X)[0] <= CLOSED


# --- Failure


def test_loops_that_cannot_close_fail() -> None:
    """A rod of 1 m between points that are 3 m apart."""
    impossible = po.Mechanism(
        "gap",
        [
            po.Base(),
            po.Series("crank", "base", joint=po.Revolute("a")),
            po.Series("rod", "base", (3, 0), po.Revolute("b")),
        ],
        [po.Coincidence("crank", (1, 0), "rod", (1, 0), "pin")],
        active=("a",),
        operational=("b",),
        planar=True,
    )
    kinematics = po.Kinematics(impossible, "virtual machine")
    for start in ({"a": 0.3}, None):
        solution = kinematics.solve({"a": 0.3}, start)
        check_honest(kinematics, solution, {"a": 0.3})
        assert solution.status is Status.FAILED
        # the pin stays open by at least 1 m, of a characteristic length of (3 + 1 + 1)/3 m; the larger component holds
        # at least 1/sqrt(2) of it
        assert solution.residual > 1 / np.sqrt(2) / (5 / 3) - 1e-9
        for read in ("configuration", "nearest"):
            with pytest.raises(po.SolveError, match="'gap': failed") as caught:
                getattr(solution, read)
            assert caught.value.evidence["solution"] is solution


def test_too_few_iterations_are_not_a_solution(raf: po.Kinematics, home: po.Configuration) -> None:
    hurried = po.SolveOptions(iterations=1, nearest_iterations=1, interior_iterations=1)
    solution = raf.solve({"x": 0.05, "y": 0.05, "z": 0.55}, home, hurried)
    assert solution.status is Status.FAILED
    with pytest.raises(po.SolveError):
        _ = solution.configuration


def test_options_of_the_object_are_used(raf: po.Kinematics, home: po.Configuration) -> None:
    options = po.SolveOptions(iterations=1, nearest_iterations=1, interior_iterations=1)
    hurried = po.Kinematics(raf.mechanism, options=options)
    assert hurried.solve({"x": 0.05, "y": 0.05, "z": 0.55}, home).status is Status.FAILED


# --- Singular


def test_aligned_legs_are_singular(legs: po.Kinematics) -> None:
    """Both legs of the 2-RPR along the base: the tip may leave at a right angle, lengths as they are."""
    values = two_rpr_values(1.0, 0.0)
    impose = {"rho1": values["rho1"], "rho2": values["rho2"]}
    solution = legs.forward(impose, values)
    check_honest(legs, solution, impose)
    assert (solution.status, solution.rank.value, solution.undetermined) == (Status.SINGULAR, 3, 1)
    assert solution.configuration["y"] == 0.0
    # the inverse model does not mind
    assert legs.inverse({"x": 1.0, "y": 0.0}, values).status is Status.CONVERGED


def five_bar_with_aligned_distal_bars() -> dict[str, float]:
    """Choose theta1 and the direction of the distal bars (5 + 8 in one line) so that the second proximal bar fits."""
    B1 = 8 * np.array([np.cos(2.4), np.sin(2.4)])
    # B2 is 13 from B1 and 5 from (9, 0): intersection of two circles
    d = np.array([9.0, 0.0]) - B1
    D = np.linalg.norm(d)
    along = (13**2 - 5**2 + D**2) / (2 * D)
    across = np.sqrt(13**2 - along**2)
    B2 = B1 + (along * d + across * np.array([-d[1], d[0]])) / D
    P = B1 + (B2 - B1) * 5 / 13

    def angle(v: np.ndarray) -> float:
        return float(np.arctan2(v[1], v[0]))

    theta2 = angle(B2 - (9, 0))
    return {
        "theta1": 2.4,
        "theta2": theta2,
        "theta3": angle(P - B1) - 2.4,
        "theta4": angle(P - B2) - theta2,
        "x": float(P[0]),
        "y": float(P[1]),
    }


def test_aligned_distal_bars_of_the_five_bar_are_singular(five_bar: po.Kinematics) -> None:
    values = five_bar_with_aligned_distal_bars()
    impose = {"theta1": values["theta1"], "theta2": values["theta2"]}
    solution = five_bar.forward(impose, values)
    check_honest(five_bar, solution, impose)
    assert (solution.status, solution.rank.value, solution.undetermined) == (Status.SINGULAR, 3, 1)
    assert five_bar.inverse({"x": values["x"], "y": values["y"]}, values).status is Status.CONVERGED


def test_stretched_leg_of_the_five_bar_is_singular(five_bar: po.Kinematics) -> None:
    """With the tip imposed at full reach, the elbow may move to first order."""
    tip = 13.0 * np.array([np.cos(1.0), np.sin(1.0)])
    w = tip - (9.0, 0.0)
    theta4 = np.arccos((w @ w - 25 - 64) / 80)
    theta2 = np.arctan2(w[1], w[0]) - np.arctan2(8 * np.sin(theta4), 5 + 8 * np.cos(theta4))
    start = {"theta1": 1.0, "theta3": 0.0, "theta2": theta2, "theta4": theta4, "x": tip[0], "y": tip[1]}
    solution = five_bar.inverse({"x": tip[0], "y": tip[1]}, start)
    assert (solution.status, solution.rank.value, solution.undetermined) == (Status.SINGULAR, 3, 1)


def test_leg_of_no_length_is_singular(legs: po.Kinematics) -> None:
    """The tip on the first hinge: the leg has no length and may point anywhere."""
    solution = legs.inverse({"x": 0.0, "y": 0.0}, two_rpr_values(0.0, 0.0))
    assert (solution.status, solution.undetermined) == (Status.SINGULAR, 1)


# --- Refused


def test_unknown_names_list_the_valid_ones(raf: po.Kinematics, home: po.Configuration) -> None:
    with pytest.raises(po.UnknownNameError, match=r"'platform z'.*valid names: 'q1', .*'arm A'"):
        raf.solve({"platform z": 0.1}, home)
    with pytest.raises(po.UnknownNameError, match=r"'arm C'.*did you mean 'arm [AB]'"):
        raf.solve({"z": 0.5}, {"arm C": 0.1})
    with pytest.raises(po.UnknownNameError, match="'w'"):
        raf.solve_batch(("w",), [[0.1]], home.X)
    with pytest.raises(po.UnknownNameError, match="'w'"):
        raf.tangent(home.X, ("w",))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_no_numbers_are_refused(raf: po.Kinematics, home: po.Configuration, value: float) -> None:
    with pytest.raises(po.DefinitionError, match=f"imposed value of 'y' is {value}; it must be finite"):
        raf.inverse({**HOME, "y": value}, home)
    start = home.X.copy()
    start[4] = value
    with pytest.raises(po.DefinitionError, match="start of 'RAF' must be 32 finite numbers"):
        raf.inverse(HOME, start)


@pytest.mark.parametrize("start", [[0.0, 1.0], np.zeros((2, 32)), 0.0])
def test_starts_of_a_wrong_shape_are_refused(raf: po.Kinematics, start: Any) -> None:
    with pytest.raises(po.DefinitionError, match="start of 'RAF' must be 32 finite numbers"):
        raf.inverse(HOME, start)


def test_inverse_and_forward_want_all_of_their_variables(raf: po.Kinematics) -> None:
    with pytest.raises(po.DefinitionError, match=r"missing \['z'\], not operational \['q1'\]"):
        raf.inverse({"x": 0.0, "y": 0.0, "q1": 0.1})
    with pytest.raises(po.DefinitionError, match=r"active variables of 'RAF' .* missing \['q2', 'q3'\]"):
        raf.forward({"q1": 0.1})


def test_a_word_for_a_value_is_refused(raf: po.Kinematics, home: po.Configuration) -> None:
    with pytest.raises(po.DefinitionError, match="'y'"):
        raf.inverse({**HOME, "y": "here"}, home)  # type: ignore[dict-item]


def test_vector_of_known_values_is_closed(legs: po.Kinematics) -> None:
    """The helper of these tests is itself right."""
    assert legs.scaled_residual(vector(legs.mechanism, two_rpr_values(1.0, 2.0)))[0] < 1e-15
