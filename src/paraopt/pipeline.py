"""The whole job: seed, refine, retime, verify, and keep the result with all that led to it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any, TypeVar

from paraopt.io import build_report, write_report, write_trajectory
from paraopt.planning import (
    Certificate,
    FirstSuccess,
    MixedSearch,
    Path,
    Problem,
    Refined,
    Retimer,
    RRTConnect,
    Seed,
    Seeder,
    SplineRefiner,
    TimeOptimal,
    Trajectory,
    check_ends,
    verify,
)
from paraopt.planning.validity import Validity
from paraopt.view import draw_motion, save_figure, write_motion_page

Progress = Callable[[str, float], None]
_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class Plan:
    """Hold a planned motion and everything that led to it.

    Attributes:
        problem: What was asked.
        seed: The first way.
        refined: The refined path, with how it was reached.
        trajectory: The timed motion.
        certificate: The independent verdict.
        timings: Seconds spent in each stage.
        options: Options of each stage.
    """

    problem: Problem
    seed: Seed
    refined: Refined
    trajectory: Trajectory
    certificate: Certificate
    timings: Mapping[str, float]
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def path(self) -> Path:
        """Give the refined path."""
        return self.refined.path

    @property
    def summary(self) -> str:
        """Say in a few lines what came out."""
        c, stages = self.certificate, ("seed", "refine", "retime", "verify")
        straight = self.seed.straight_reason
        lines = [
            f"{self.problem.robot.name}: {'certified' if c.passed else 'NOT certified'} motion of "
            f"{self.trajectory.duration:.3f} s, {self.trajectory.method}",
            f"straight motion: {'free' if straight == 'valid' else f'blocked by {straight}'}",
            f"path {1e3 * self.refined.length:.2f} mm, seed {1e3 * self.seed.length:.2f} mm "
            f"({self.seed.checks} poses judged)",
            f"closure {c['closure residual'].value:.1e} m, velocity {100 * c['velocity / limit'].value:.1f} % and "
            f"acceleration {100 * c['acceleration / limit'].value:.1f} % of the limits",
            f"parallel margin {c['parallel margin'].value:.4f} at {c['parallel margin'].time:.3f} s, serial margin "
            f"{c['serial margin'].value:.4f} at {c['serial margin'].time:.3f} s "
            f"(asked {c['parallel margin'].bound:g}"
            f"{', serial ones may be crossed' if self.problem.allow_mode_change else ''})",
        ]
        if self.problem.scene.pairs:
            check = c["clearance"]
            lines.append(
                f"clearance {1e3 * check.value:.3f} mm at {check.time:.3f} s, {check.where} "
                f"(asked {1e3 * check.bound:g} mm)"
            )
        lines.append("seconds: " + ", ".join(f"{s} {self.timings[s]:.2f}" for s in stages if s in self.timings))
        return "\n".join(lines)

    def report(self) -> dict[str, Any]:
        """Collect the report that `save` writes as JSON."""
        return build_report(
            self.problem,
            self.seed,
            self.refined,
            self.trajectory,
            self.certificate,
            options=self.options,
            timings=self.timings,
        )

    def save(self, folder: str | os.PathLike[str], *, period: float = 1e-3, view: bool = True) -> dict[str, FilePath]:
        """Write the trajectory (CSV), the report (JSON), the figures (PNG) and the page (HTML).

        Args:
            folder: Where to; made when missing. Each file appears whole or not at all.
            period: Time between the rows of the CSV [s].
            view: Whether to draw figures and page; a robot without solids has no page.

        Returns:
            The files by name.

        Raises:
            MissingBackendError: `view` is asked for and matplotlib is not installed.
        """
        target = FilePath(folder)
        # everything is made before anything is written
        report = self.report()
        figures = draw_motion(self.problem, self.seed, self.trajectory, self.certificate) if view else {}
        files = {
            "trajectory": write_trajectory(self.trajectory, target / "trajectory.csv", period),
            "report": write_report(report, target / "report.json"),
        }
        for name, figure in figures.items():
            files[name] = save_figure(figure, target / f"{name}.png")
        if view and self.problem.scene.bodies:
            files["page"] = write_motion_page(
                target / "motion.html", self.problem, self.seed, self.trajectory, self.certificate
            )
        return files


def choose_seeder(problem: Problem) -> Seeder:
    """Choose a seeder: a grid for a few coordinates, random trees behind it for more, and where it is not enough.

    Args:
        problem: The problem.

    Returns:
        The mixed search; for more than three coordinates a short one, followed by RRT-Connect; followed by RRT-Connect,
        too, where the working mode may change: a position may then have several solutions, of which the grid knows one.
    """
    if problem.allow_mode_change:
        return FirstSuccess((MixedSearch(), RRTConnect()))
    if len(problem.independent) <= 3:
        return MixedSearch()
    return FirstSuccess((MixedSearch(refinements=0, max_checks=5000), RRTConnect()))


def plan(
    problem: Problem,
    *,
    seeder: Seeder | None = None,
    refiner: SplineRefiner | None = None,
    retimer: Retimer | None = None,
    progress: Progress | None = None,
    allow_failed: bool = False,
) -> Plan:
    """Plan a motion: seed, refine, retime, verify.

    Args:
        problem: What is asked.
        seeder: Finds a first way; `choose_seeder(problem)` when None.
        refiner: Makes it short and smooth; `SplineRefiner()` when None.
        retimer: Times it; `TimeOptimal()` when None.
        progress: Called with the name of each finished stage and its seconds.
        allow_failed: Return a plan that its certificate contradicts, instead of raising.

    Returns:
        The plan, with its certificate.

    Raises:
        InfeasibleError: The problem cannot have a solution; no path exists.
        SolveError: A stage failed; the evidence is attached.
        CertificateError: The certificate contradicts the plan, and `allow_failed` is not set.
    """
    seeder, refiner, retimer = seeder or choose_seeder(problem), refiner or SplineRefiner(), retimer or TimeOptimal()
    timings: dict[str, float] = {}

    def run(stage: str, act: Callable[[], _T]) -> _T:
        begin = time.perf_counter()
        result = act()
        timings[stage] = time.perf_counter() - begin
        if progress is not None:
            progress(stage, timings[stage])
        return result

    run("compile", lambda: problem.robot.kinematics.prepare(problem.independent))
    run("check", lambda: check_ends(problem, Validity(problem)))
    seed = run("seed", lambda: seeder.seed(problem))
    refined = run("refine", lambda: refiner.refine(problem, seed))
    trajectory = run("retime", lambda: retimer.retime(problem, refined.path))
    # ten times denser than whatever the refiner and the retimer looked at
    dense = 10 * max(refined.n_samples, trajectory.n_grid)
    certificate = run("verify", lambda: verify(problem, trajectory, at_least=dense, check_jerk=retimer.bounds_jerk))
    options = {"seeder": seeder, "refiner": refiner, "retimer": retimer}
    result = Plan(problem, seed, refined, trajectory, certificate, timings, options)
    if not allow_failed:
        certificate.check_passed()
    return result
