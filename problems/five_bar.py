"""Which working modes of the five-bar can a motion reach that crosses serial singularities but no parallel one?

The machine of Chablat (Chablat1998: lengths 9, 8, 5, 5, 8, no limits) has four working modes at a pose, the signs of
both legs. While the working mode stays, a motion is described by the end point. A motion that changes it is described
by the drives: where a leg is stretched out or folded, the end point stops but the drives do not.

Expected: at (6, 7) det [N K] is negative in the modes "++", "-+" and "--", which are all joined by certified motions,
and positive in "+-", which is refused for its sign. Without leave to change the mode all of them would be refused. Exit
code 0 only if all pairs are answered so.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from itertools import permutations

import numpy as np
import tyro

import paraopt as po


@dataclass(frozen=True)
class Parameters:
    """Join the working modes of the five-bar at one pose."""

    pose: tuple[float, float] = (6.0, 7.0)
    """The end point at start and goal [m]."""
    margins: po.Margins = field(default_factory=lambda: po.Margins(clearance=0.0, singularity=0.05))
    """Clearance [m] and distance to parallel singularities."""
    only: str = ""
    """One pair of modes, such as "++,-+"; all pairs when not given."""


def main(p: Parameters) -> int:
    """Try all pairs of modes, and say what came out."""
    scene = po.Scene(po.robots.five_bar())
    modes = scene.robot.kinematics.working_modes(dict(zip("xy", p.pose, strict=True)))
    pairs = [tuple(p.only.split(","))] if p.only else list(permutations(modes.labels, 2))
    right = 0
    try:
        for a, b in pairs:
            problem = po.Problem(scene, modes[a], modes[b], margins=p.margins, allow_mode_change=True)
            first, last = (float(problem.determinants(modes[m].X)[0][0]) for m in (a, b))
            try:
                plan = po.plan(problem)  # raises if the certificate fails
            except po.InfeasibleError as error:
                right += first * last < 0.0 and error.evidence.get("reason") == "branch"
                print(f"{a} -> {b}: refused, det [N K] is {first:+.3f} and {last:+.3f}")
                continue
            right += first * last > 0.0
            X = plan.trajectory(np.linspace(0.0, plan.trajectory.duration, 2001))
            crossings = int(np.count_nonzero(np.diff(np.sign(problem.determinants(X)[1]))))
            least = plan.certificate["parallel margin"].value
            print(
                f"{a} -> {b}: certified, {plan.trajectory.duration:.2f} s, changes of the sign of det [M N]: "
                f"{crossings}, parallel margin {least:.3f}"
            )
    except po.ParaoptError as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 1
    print(f"{right} of {len(pairs)} pairs answered by the sign of det [N K]")
    return 0 if right == len(pairs) else 1


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Parameters, description=__doc__)))
