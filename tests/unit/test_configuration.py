"""A configuration exists only with its loops closed; it is read by name and cannot be changed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import paraopt as po
from support import raf_configurations, raf_robot, two_rpr, two_rpr_values, vector


def closed() -> po.Configuration:
    mechanism = two_rpr()
    return po.Kinematics(mechanism, "virtual machine").configuration(vector(mechanism, two_rpr_values(1.3, 2.1)))


def test_values_are_read_by_name_and_by_role() -> None:
    configuration, values = closed(), two_rpr_values(1.3, 2.1)
    assert configuration.as_dict() == values
    assert list(configuration) == list(values)
    assert configuration["phi2"] == values["phi2"]
    assert_array_equal(configuration.active, [values["rho1"], values["rho2"]])
    assert_array_equal(configuration.passive, [values["phi1"], values["phi2"]])
    assert_array_equal(configuration.operational, [1.3, 2.1])
    home = raf_robot().home_configuration
    assert [len(part) for part in (home.active, home.passive, home.operational)] == [3, 26, 3]


def test_unknown_names_list_the_valid_ones() -> None:
    with pytest.raises(po.UnknownNameError, match=r"'rho3'.*did you mean 'rho[12]'.*'phi1'"):
        closed()["rho3"]


def test_nothing_can_be_changed() -> None:
    configuration = closed()
    with pytest.raises(ValueError, match="read-only"):
        configuration.X[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        configuration.active[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        configuration.X = np.zeros(6)  # type: ignore[misc]


def test_values_are_copied() -> None:
    mechanism = two_rpr()
    X = vector(mechanism, two_rpr_values(1.3, 2.1))
    configuration = po.Kinematics(mechanism, "virtual machine").configuration(X)
    X[0] = 99.0
    assert configuration["rho1"] != 99.0


@pytest.mark.parametrize("variable", ["rho1", "rho2", "phi1", "phi2", "x", "y"])
def test_open_loops_are_refused(variable: str) -> None:
    mechanism, values = two_rpr(), two_rpr_values(1.3, 2.1)
    values[variable] += 1e-8  # a hundred times what is allowed, in any variable
    X = vector(mechanism, values)
    with pytest.raises(
        po.SolveError, match=r"loops of '2-RPR' are open: .*residual is .* the bound is 1e-10"
    ) as caught:
        po.Kinematics(mechanism, "virtual machine").configuration(X)
    assert 1e-10 < caught.value.evidence["residual"] < 1e-7
    assert_array_equal(caught.value.evidence["X"], X)


@pytest.mark.parametrize("residual", [np.nan, np.inf, 1e-9])
def test_bad_residuals_are_refused(residual: float) -> None:
    with pytest.raises(po.SolveError, match="2-RPR"):
        po.Configuration(two_rpr(), vector(two_rpr(), two_rpr_values(1.3, 2.1)), residual)


@pytest.mark.parametrize("X", [np.zeros(5), np.full(6, np.nan), np.zeros((1, 6))])
def test_bad_values_are_refused(X: np.ndarray) -> None:
    with pytest.raises(po.SolveError, match="2-RPR"):
        po.Configuration(two_rpr(), X, 0.0)


def test_tolerance_is_the_caller_s() -> None:
    mechanism, X = two_rpr(), vector(two_rpr(), two_rpr_values(1.3, 2.1))
    assert po.Configuration(mechanism, X, 1e-7, tolerance=1e-6).tolerance == 1e-6


def test_random_configurations_of_the_raf_are_closed() -> None:
    kinematics = raf_robot().kinematics
    for configuration in raf_configurations():
        assert kinematics.scaled_residual(configuration.X)[0] <= 1e-12
        # its residual is the one that anybody finds
        assert configuration.residual == pytest.approx(kinematics.scaled_residual(configuration.X)[0], abs=1e-15)
