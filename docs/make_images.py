"""Make the pictures of the README: pages that play motions, opened in headless Chromium, and figures.

    python docs/make_images.py                 # needs chromium on the PATH
    python docs/make_images.py --time 0.35

Everything is planned anew; the pictures in docs/images are replaced.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import paraopt as po
from paraopt.view import draw_filmstrip, draw_motion, save_figure, write_motion_page

HERE = Path(__file__).resolve().parent
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
# runs after the page's own script: show one instant from one side, with the view close to the robot
POSE = """
<script type="module">
  const page = window.paraopt;
  page.setView("{view}");
  page.seek({time});
  const canvas = document.getElementById("view");
  const box = canvas.getBoundingClientRect();
  const centre = {{ clientX: box.x + box.width / 2, clientY: box.y + box.height / 2 }};
  for (let i = 0; i < {notches}; i++) canvas.dispatchEvent(new WheelEvent("wheel", {{ deltaY: -100, ...centre }}));
</script>
"""


def plan_cylinder() -> po.Plan:
    """Plan the task of `make demo`."""
    pose = po.transform((0, 0, 0.69))
    obstacle = po.Cylinder(name="cylinder", radius=0.03, length=0.4, pose=pose)
    scene = po.Scene(po.robots.raf(), [obstacle])
    return po.plan(po.Problem(scene, {"x": -0.06, "y": 0.0, "z": 0.48}, {"x": 0.06, "y": 0.0, "z": 0.48}))


def plan_rise() -> po.Plan:
    """Plan the README's task of a platform on four cables."""
    larm = po.robots.larm_hanging(tension=(0.5, 8.0))
    cables = po.cable.read_hanging(larm, larm.mechanism.active)
    wall = po.Box(name="wall", size=(0.06, 0.6, 0.25), pose=po.transform((0.5, 0.5, -0.875)))
    pose = {"y": 0.45, "z": -0.85, "gamma": 0.0}
    margins = po.Margins(clearance=0.01, singularity=0.01)
    dynamics = [po.cable.TensionLimits(cables), po.cable.SwayLimits(cables, 0.05)]
    scene = po.Scene(larm, [wall])
    problem = po.Problem(scene, {"x": 0.25, **pose}, {"x": 0.75, **pose}, margins, dynamics=dynamics)
    return po.plan(problem, retimer=po.JerkLimited())


def plan_walk() -> po.legged.LeggedPlan:
    """Plan the README's walk."""
    dog = po.legged.GaitModel(po.robots.gipo_machine(po.robots.gipo(trunk_height=-0.02)))
    ground = po.legged.PlaneSupport(point=dog.rest_places[0])
    gait = po.legged.find_gait(po.legged.build_walk(dog, ground, step=0.06))
    margins = po.Margins(clearance=0.0, singularity=0.01)
    return po.legged.plan_legged(po.legged.build_gait_task(gait, ground, margins=margins))


def photograph(plan: po.Plan, target: Path, time: float, view: str, notches: int, size: tuple[int, int]) -> None:
    """Open the page of a plan without a screen at one instant [s], and keep what it shows."""
    browser = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if browser is None:
        sys.exit(f"none of {', '.join(BROWSERS)} is on the PATH; install one, or pass --figures-only")
    with tempfile.TemporaryDirectory() as folder:
        page = write_motion_page(
            Path(folder) / "motion.html", plan.problem, plan.seed, plan.trajectory, plan.certificate
        )
        text = page.read_text(encoding="utf-8")
        page.write_text(
            text.replace("</body>", POSE.format(view=view, time=time, notches=notches) + "</body>"), encoding="utf-8"
        )
        shot = Path(folder) / "shot.png"
        command = [
            browser, "--headless=new", "--no-sandbox", "--hide-scrollbars", "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader", "--force-device-scale-factor=1", f"--user-data-dir={folder}/profile",
            f"--window-size={size[0]},{size[1]}", "--virtual-time-budget=4000", f"--screenshot={shot}", page.as_uri(),
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
        if done.returncode != 0 or not shot.exists():
            sys.exit(f"{browser} made no picture:\n{done.stderr[-2000:]}")
        target.write_bytes(shot.read_bytes())


def main() -> None:
    """Plan, and write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--time", type=float, default=None, help="instant of the picture [s]; half-way when absent")
    parser.add_argument("--view", choices=("iso", "top", "front", "side"), default="iso")
    parser.add_argument("--zoom", type=int, default=4, help="notches of the wheel by which the view comes nearer")
    parser.add_argument("--size", type=int, nargs=2, default=(1180, 900), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--output", type=Path, default=HERE / "images")
    parser.add_argument("--figures-only", action="store_true", help="leave the browser out")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    plan = plan_cylinder()
    figures = draw_motion(plan.problem, plan.seed, plan.trajectory, plan.certificate)
    for name in ("actuators", "margins"):
        save_figure(figures[name], options.output / f"raf-{name}.png", resolution=110.0)
    walk = plan_walk()
    swings = [mark for mark in walk.trajectory.marks if mark.lifted]
    times = [0.5 * (mark.start + mark.end) for mark in swings]
    save_figure(draw_filmstrip(walk, times=times), options.output / "gipo-filmstrip.png", resolution=110.0)
    if not options.figures_only:
        rise = plan_rise()
        size = tuple(options.size)
        photograph(rise, options.output / "larm-rise.png", 0.5 * rise.trajectory.duration, "iso", 3, size)
        time = 0.5 * plan.trajectory.duration if options.time is None else options.time
        photograph(plan, options.output / "raf-cylinder.png", time, options.view, options.zoom, size)


if __name__ == "__main__":
    main()
