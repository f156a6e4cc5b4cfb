"""The machine and its limits: what is accepted, named and refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import paraopt as po
from paraopt.shapes import Shape
from support import five_bar_robot, raf_robot, two_rpr, two_rpr_values

BALL = po.Sphere(radius=0.1)


def build(**parts: Any) -> po.Robot:
    return po.Robot(two_rpr(), **{"home": two_rpr_values(1.0, 2.0), **parts})


# --- Limits


@pytest.mark.parametrize("quantity", ["velocity", "acceleration", "jerk"])
@pytest.mark.parametrize("value", [0, 0.0, -1.0, np.nan, np.inf, "fast", None])
def test_limits_are_finite_and_above_zero(quantity: str, value: Any) -> None:
    with pytest.raises(po.DefinitionError, match=f"{quantity} limit of 'rho1' is .*; it must be finite and above 0"):
        po.Limits(**{quantity: {"rho1": value}})


@pytest.mark.parametrize("bounds", [(1, 0), (1, 1), (np.nan, 1), (0, np.nan)])
def test_position_limits_are_ranges(bounds: tuple[float, float]) -> None:
    with pytest.raises(po.DefinitionError, match=r"position limit of 'rho1' is .*; its low end must be below"):
        po.Limits(position={"rho1": bounds})


@pytest.mark.parametrize("bounds", [(1,), (1, 2, 3), 1.0, ("low", "high"), None])
def test_position_limits_are_two_numbers(bounds: Any) -> None:
    with pytest.raises(po.DefinitionError, match="position limit of 'rho1'"):
        po.Limits(position={"rho1": bounds})


def test_limits_may_be_any_number() -> None:
    assert po.Limits(velocity={"rho1": np.int64(2)}).velocity["rho1"] == 2.0


@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration", "jerk"])
def test_limits_of_unknown_variables_are_refused(quantity: str) -> None:
    limits = po.Limits(**{quantity: {"rho3": (0, 1) if quantity == "position" else 1.0}})
    with pytest.raises(po.UnknownNameError, match=f"{quantity} limits 'rho3'.*did you mean.*'phi1'"):
        build(limits=limits)


@pytest.mark.parametrize(
    "quantity", ["linear_velocity", "angular_velocity", "linear_acceleration", "angular_acceleration"]
)
def test_limits_of_the_platform_are_one_number_each(quantity: str) -> None:
    limits = po.Limits(**{quantity: np.float32(0.5)})
    assert getattr(limits, quantity) == 0.5
    assert sorted(limits.platform()) == [0.5, np.inf, np.inf, np.inf]
    for value in (0.0, -1.0, np.inf, np.nan, "fast"):
        with pytest.raises(po.DefinitionError, match=f"{quantity} limit of the platform is {value!r}"):
            po.Limits(**{quantity: value})


def test_limits_are_read_by_name() -> None:
    limits = po.Limits(velocity={"rho1": 2}, jerk={"rho2": np.float32(3)})
    assert_array_equal(limits.of("velocity", ["rho2", "rho1"]), [np.inf, 2.0])
    assert_array_equal(limits.of("jerk", ["rho2"]), [3.0])
    assert_array_equal(limits.of("acceleration", ["rho1"]), [np.inf])


def test_limits_are_frozen_and_copied() -> None:
    velocity = {"rho1": 2.0}
    limits = po.Limits(velocity=velocity)
    velocity["rho1"] = 9.0
    assert limits.velocity["rho1"] == 2.0
    with pytest.raises(TypeError):
        limits.velocity["rho1"] = 1.0  # type: ignore[index]
    with pytest.raises(dataclasses.FrozenInstanceError):
        limits.velocity = {}  # type: ignore[misc]


def test_position_limits_narrow_the_ranges_of_the_joints() -> None:
    mechanism = po.Mechanism(
        "arm",
        [
            po.Base(),
            po.Series("a", "base", joint=po.Revolute("a", range=(-1, 1))),
            po.Series("b", "a", joint=po.Revolute("b", range=(-1, 1))),
            po.Mobile("tip", ("x",)),
        ],
        (),
        ("a", "b"),
        ("x",),
    )
    low, high = po.Limits(position={"a": (-2, 0.5), "b": (-0.5, 2)}).bounds(mechanism)
    assert_array_equal(low, [-1, -0.5, -np.inf])
    assert_array_equal(high, [0.5, 1, np.inf])


def test_limits_apart_from_the_range_of_the_joint_are_refused() -> None:
    whole = raf_robot()
    with pytest.raises(po.DefinitionError, match="'q1'"):
        dataclasses.replace(whole, limits=po.Limits(position={"q1": (0.3, 0.4)}))


# --- Robot


def rope(**changes: Any) -> po.Cable:
    given = {"link_A": "base", "point_A": (0, 0), "link_B": "tip", "point_B": (0, 0), "radius": 0.01, "name": "rope"}
    return po.Cable(**given | changes)


FAULTS: dict[str, tuple[Callable[[], Any], type[Exception], list[str]]] = {
    "shape on an unknown link": (
        lambda: build(shapes={"rod 3": [BALL]}),
        po.UnknownNameError,
        ["'rod 3'", "did you mean", "'leg 1'", "'tip'"],
    ),
    "two shapes of one name": (
        lambda: build(shapes={"tip": [dataclasses.replace(BALL, name="b")] * 2}),
        po.DefinitionError,
        ["'b'", "twice", "'2-RPR'"],
    ),
    "two shapes of one name on two links": (
        lambda: build(shapes={"tip": [dataclasses.replace(BALL, name="rod 1")], "rod 1": [BALL]}),
        po.DefinitionError,
        ["'rod 1'", "twice"],
    ),
    "cable to an unknown link": (
        lambda: build(cables=[rope(link_B="tipp")]),
        po.UnknownNameError,
        ["cable 'rope'", "'tipp'", "did you mean", "'tip'"],
    ),
    "two cables of one name": (
        lambda: build(cables=[rope(), rope(point_A=(1, 0))]),
        po.DefinitionError,
        ["'rope'", "a name of its own", "'2-RPR'"],
    ),
    "a cable with the name of a solid": (
        lambda: build(shapes={"tip": [dataclasses.replace(BALL, name="rope")]}, cables=[rope()]),
        po.DefinitionError,
        ["'rope'", "another solid or cable"],
    ),
    "cables that are none": (lambda: build(cables=["rope"]), po.DefinitionError, ["'rope'", "must be a Cable"]),
    "one cable without a list": (lambda: build(cables=rope()), po.DefinitionError, ["must be a list of Cable"]),
    "mass of an unknown link": (
        lambda: build(masses={"rod 3": 1.0}),
        po.UnknownNameError,
        ["mass", "'rod 3'", "'tip'"],
    ),
    "negative mass": (lambda: build(masses={"tip": -1.0}), po.DefinitionError, ["mass of link 'tip'", "-1.0 kg"]),
    "mass not a number": (lambda: build(masses={"tip": np.nan}), po.DefinitionError, ["mass of link 'tip'", "nan"]),
    "contact of an unknown link": (
        lambda: build(contacts={("tip", "rod 3"): "they touch"}),
        po.UnknownNameError,
        ["contacts", "'rod 3'", "'tip'"],
    ),
    "home of an unknown variable": (lambda: build(home={"x": 0, "y": 1, "z": 2}), po.UnknownNameError, ["'z'", "'x'"]),
    "home without the pose": (lambda: build(home={"x": 0}), po.DefinitionError, ["home", "'2-RPR'", "'y'"]),
    "home not a number": (lambda: build(home={"x": np.nan, "y": 1.0}), po.DefinitionError, ["home", "'x'", "nan m"]),
    "home in words": (lambda: build(home={"x": 0.0, "y": "up"}), po.DefinitionError, ["home", "'y'", "'up' m"]),
    "shape that is none": (lambda: build(shapes={"tip": ["ball"]}), po.DefinitionError, ["'tip'", "'ball'", "Sphere"]),
    "shape without a list": (lambda: build(shapes={"tip": BALL}), po.DefinitionError, ["'tip'", "a list of"]),
    "shape that cannot be measured": (
        lambda: build(shapes={"tip": [Shape(name="thing")]}),
        po.DefinitionError,
        ["'tip'", "shape 'thing'", "Sphere"],
    ),
    "mass in words": (lambda: build(masses={"tip": "heavy"}), po.DefinitionError, ["mass of link 'tip'", "'heavy' kg"]),
}


@pytest.mark.parametrize(("describe", "error", "words"), FAULTS.values(), ids=FAULTS.keys())
def test_a_faulty_robot_is_refused_by_name(
    describe: Callable[[], Any], error: type[Exception], words: list[str]
) -> None:
    with pytest.raises(po.DefinitionError) as caught:
        describe()
    assert type(caught.value) is error
    assert not [word for word in words if word not in str(caught.value)], str(caught.value)


def test_shapes_take_the_name_of_their_link() -> None:
    robot = build(shapes={"tip": [BALL], "rod 1": [BALL, BALL], "rod 2": [dataclasses.replace(BALL, name="club")]})
    assert {link: [s.name for s in shapes] for link, shapes in robot.shapes.items()} == {
        "tip": ["tip"],
        "rod 1": ["rod 1 1", "rod 1 2"],
        "rod 2": ["club"],
    }


def test_a_robot_carries_its_cables() -> None:
    given = [rope(), rope(name="other", point_B=(0.1, 0))]
    robot = build(cables=given)
    given.clear()
    assert [c.name for c in robot.cables] == ["rope", "other"]
    assert robot.cables[0].point_A == (0.0, 0.0, 0.0)
    assert build().cables == ()


def test_a_robot_is_frozen_and_copies_what_it_is_given() -> None:
    shapes, masses = {"tip": [BALL]}, {"tip": 1.0}
    robot = build(shapes=shapes, masses=masses)
    shapes.clear(), masses.clear()
    assert (len(robot.shapes["tip"]), robot.masses["tip"]) == (1, 1.0)
    with pytest.raises(TypeError):
        robot.masses["tip"] = 2.0  # type: ignore[index]
    with pytest.raises(dataclasses.FrozenInstanceError):
        robot.source = "mine"  # type: ignore[misc]


def test_home_configuration_has_the_pose_of_home_on_its_branch() -> None:
    robot = build()
    home = robot.home_configuration
    assert (home["x"], home["y"]) == (1.0, 2.0)
    assert home["phi1"] == pytest.approx(np.arctan2(2, 1), abs=1e-12)
    # the branch is that of the other values: legs that push the other way round
    values = two_rpr_values(1.0, 2.0)
    values |= {"rho1": -values["rho1"], "phi1": values["phi1"] - np.pi}
    other = build(home=values).home_configuration
    assert other["rho1"] == pytest.approx(-home["rho1"], abs=1e-12)


def test_home_that_cannot_be_reached_raises() -> None:
    robot = five_bar_robot()
    far = dataclasses.replace(robot, home={**robot.home, "x": 30.0})
    with pytest.raises(po.SolveError, match=r"'five-bar'.*'x' wanted 30 m"):
        _ = far.home_configuration


def test_kinematics_are_built_once() -> None:
    robot = build()
    assert robot.kinematics is robot.kinematics
    assert robot.name == "2-RPR"
