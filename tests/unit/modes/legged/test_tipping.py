"""Balance in motion: inertia beside weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import paraopt as po
from paraopt.modes.legged import (
    LeggedMachine,
    LeggedPlan,
    LeggedTask,
    Phase,
    SupportPolygon,
    TippingConstraint,
    build_polygon,
    measure_centre,
    measure_tipping,
    plan_legged,
    verify_legged,
)


def test_at_rest_it_is_the_support_margin(machine: LeggedMachine) -> None:
    """Also for feet at different heights and gravity that leans."""
    X = machine.robot.home_configuration.X + np.random.default_rng(1).uniform(-0.2, 0.2, size=(5, 35))
    for down in ((0, 0, -1), (0.2, -0.1, -1)):
        polygon = build_polygon(machine, X[0], machine.names[:3], down)
        still = np.zeros_like(X)
        assert_allclose(
            measure_tipping(machine, polygon, X, still, still),
            polygon.distances(measure_centre(machine, X)),
            atol=1e-14,
        )


def test_it_is_the_moment_about_the_edge(plan: LeggedPlan) -> None:
    """Moments of weight and inertia of all masses, with accelerations from differences of their places in time."""
    machine, path = plan.task.machine, plan.phases[1].refined.path
    duration, step, g = 0.3, 1e-4, 9.80665
    t = np.linspace(0.2, 0.8, 5) * duration

    def swing(times: np.ndarray | float, order: int = 0) -> np.ndarray:
        """Run the path evenly: a time law would make accelerations jump."""
        return path(np.asarray(times) / duration, order) / duration**order

    polygon = build_polygon(machine, swing(0.0), machine.names[1:])
    links = [link.name for link in machine.robot.mechanism.links]

    def places(times: np.ndarray) -> dict[str, np.ndarray]:
        poses = machine.robot.kinematics.poses(swing(times))
        centres = machine.robot.centres
        return {k: (poses[:, links.index(k)] @ [*centres.get(k, (0, 0, 0)), 1.0])[:, :3] for k in machine.robot.masses}

    before, here, after = (places(t + shift) for shift in (-step, 0.0, step))
    moments = np.zeros((len(t), len(polygon.edges)))
    for edge, (A, B) in enumerate(zip(polygon.points, np.roll(polygon.points, -1, axis=0), strict=True)):
        e = (B - A) / np.linalg.norm(B - A)
        for link, mass in machine.robot.masses.items():
            acceleration = (after[link] - 2 * here[link] + before[link]) / step**2
            force = mass * ([0.0, 0.0, -g] - acceleration)
            moments[:, edge] -= np.cross(here[link] - A, force) @ e
    found = measure_tipping(machine, polygon, swing(t), swing(t, 1), swing(t, 2), g)
    # on level ground the moment over the weight is a length; differences of noise 1e-13 m over (1e-4 s)^2
    assert_allclose(found, moments / (machine.mass * g), atol=1e-5)
    static = polygon.distances(measure_centre(machine, swing(t)))
    assert np.max(np.abs(found - static)) > 1e-3, "the swing is so slow that inertia does not count"


def test_a_retimer_keeps_it(task: LeggedTask, shift: Phase) -> None:
    """The trunk shifts more slowly where the machine would lean on three feet."""
    asked = replace(shift, stability=0.055)
    fast = plan_legged(replace(task, phases=(asked,)), retimer=po.TimeOptimal())
    assert fast.certificate.smallest_tipping < 0.045
    assert "with the inertia of what moves (not asked)" in fast.summary
    for retimer in (po.TimeOptimal(), po.JerkLimited(n_grid=100, enough=1e-2)):
        slow = plan_legged(replace(task, phases=(asked,), tipping=0.045), retimer=retimer)
        check = slow.certificate["distance from tipping"]
        assert slow.certificate.passed
        assert 0.045 - 1e-3 * 0.04 < check.value < 0.055, "the bound holds, and is used"
        assert slow.trajectory.duration > 1.05 * fast.trajectory.duration
    # the fast motion under the slow task's eyes
    problems = [phase.problem for phase in fast.phases]
    judged = verify_legged(replace(task, phases=(asked,), tipping=0.045), problems, fast.trajectory)
    assert not judged["distance from tipping"].passed
    assert judged["distance from tipping"].value == pytest.approx(fast.certificate.smallest_tipping)


def test_what_no_speed_keeps_is_refused(task: LeggedTask, machine: LeggedMachine) -> None:
    with pytest.raises(po.DefinitionError, match=r"'shift' asks for a support margin of 0 m.*no speed keeps"):
        replace(task, tipping=0.0)
    with pytest.raises(po.DefinitionError, match="finite, or None"):
        replace(task, tipping=np.nan)
    line = SupportPolygon.over(["a", "b"], [(0, 0, 0), (1, 0, 0)])
    with pytest.raises(po.DefinitionError, match="no polygon"):
        TippingConstraint(machine, line)
    polygon = build_polygon(machine, machine.robot.home_configuration.X, machine.names)
    with pytest.raises(po.DefinitionError, match="gravity"):
        TippingConstraint(machine, polygon, gravity=0.0)
