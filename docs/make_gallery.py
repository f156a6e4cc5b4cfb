"""Make the gallery: docs/gallery.md with a picture, the link graph and the facts of every robot of the library.

    python docs/make_gallery.py                 # or: make gallery
    python docs/make_gallery.py delta raf       # pictures of these alone; the page names all robots
    python docs/make_gallery.py --text-only     # leaves the pictures as they are

No display is needed. Every robot is built with its default parameters; for one that has none, EXAMPLES names some.
"""

from __future__ import annotations

import argparse
import inspect
import io
import typing
from collections.abc import Callable
from pathlib import Path

import paraopt as po
from paraopt.io.files import write_atomically
from paraopt.view import draw_link_graph, draw_robot, save_figure

HERE = Path(__file__).resolve().parent
PAGE = HERE / "gallery.md"
IMAGES = HERE / "images" / "gallery"
RESOLUTION = 140.0  # pixels per inch
COLORS = {"robot": 255, "graph": 128}  # of the palettes, by kind of picture: enough to look smooth, small on disk
EXAMPLES: dict[str, tuple[object, ...]] = {"planar_platform": ("_R_RR", "RR_P_", "R_P_R")}
"""Arguments of robots that cannot be built without any, by name of the function."""

HEAD = """# Gallery

Every robot of `paraopt.robots` at home, with its link graph and its facts. Written by `make gallery`; do not edit.

In the pictures, links that an actuator moves are orange, the platform is blue, the base dark; a line is a cable, or
stands for a link without solids. In the graphs, boxes are links, lines are joints with the names of their variables,
dashed lines are closures; thick lines and ● tell what is driven, ◆ what states the task. Your machine is drawn alike:

```python
po.view.draw_robot(robot, "robot.png")
po.view.draw_link_graph(robot.mechanism, "graph.png")
```
"""


def list_robots() -> dict[str, Callable[..., po.Robot]]:
    """List the functions of `paraopt.robots` that build a robot, by name, sorted."""
    found = {name: getattr(po.robots, name) for name in sorted(po.robots.__all__)}
    return {
        name: value
        for name, value in found.items()
        if inspect.isfunction(value) and typing.get_type_hints(value).get("return") is po.Robot
    }


def build(name: str) -> po.Robot:
    """Build a robot with default parameters, or with those of EXAMPLES."""
    return list_robots()[name](*EXAMPLES.get(name, ()))


def describe_function(function: Callable[..., po.Robot]) -> str:
    """Give the first paragraph of a docstring as one line."""
    return " ".join((inspect.getdoc(function) or "").split("\n\n")[0].split())


def describe_facts(robot: po.Robot) -> list[tuple[str, str]]:
    """List the facts of a robot: computed at home, and those that its file states beyond them."""
    mechanism = robot.mechanism
    state = po.report_state(robot.kinematics, robot.home_configuration)
    ranks = ", ".join(f"{name} {rank.value}" for name, rank in state.ranks.items())
    facts = [
        ("links, closures", f"{len(mechanism.links)}, {len(mechanism.closures)}"),
        (
            "variables",
            f"{state.n_variables}: {len(mechanism.active)} active, {len(mechanism.passive)} passive, "
            f"{len(mechanism.operational)} operational ({', '.join(mechanism.operational)})",
        ),
        ("equations", f"{state.n_equations}" + (f", {state.redundant_rows} redundant" if state.redundant_rows else "")),
        ("ranks", ranks),
        ("mobility", f"{state.mobility}" + (f", of which {len(state.idle)} idle" if state.idle else "")),
    ]
    facts += [(name, str(robot.facts[name])) for name in ("working modes", "assembly modes") if name in robot.facts]
    return facts


def describe(name: str) -> str:
    """Write the section of a robot."""
    robot, function = build(name), list_robots()[name]
    call = ", ".join(repr(argument) for argument in EXAMPLES.get(name, ()))
    rows = "\n".join(f"| {key} | {value} |" for key, value in describe_facts(robot))
    return f"""## {name}

{describe_function(function)} `po.robots.{name}({call})`

![{robot.name} at home](images/gallery/{name}.png)

![Link graph of {robot.name}](images/gallery/{name}-graph.png)

| fact | at home |
|---|---|
{rows}

Source: {robot.source.rstrip(".")}.
"""


def describe_gallery() -> str:
    """Write the whole page."""
    names = list(list_robots())
    contents = ", ".join(f"[{name}](#{name})" for name in names)
    return "\n".join([HEAD, f"{contents}\n", *(describe(name) for name in names)])


def save_picture(figure: typing.Any, path: Path, colors: int) -> None:
    """Write a figure as a PNG with a palette; the colours of a drawing are few."""
    from PIL import Image  # comes with matplotlib

    whole = save_figure(figure, path, resolution=RESOLUTION)
    with Image.open(whole) as image:
        small = image.convert("RGB").quantize(colors, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    small.save(buffer, format="PNG", optimize=True)
    write_atomically(path, buffer.getvalue())


def main() -> None:
    """Draw the pictures and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", help="robots to draw; all when absent")
    parser.add_argument("--text-only", action="store_true", help="write the page alone")
    options = parser.parse_args()
    names = list(list_robots())
    unknown = sorted(set(options.robots) - set(names))
    if unknown:
        parser.error(f"unknown robots {', '.join(unknown)}; the library holds {', '.join(names)}")
    wanted = {f"{name}{suffix}.png" for name in names for suffix in ("", "-graph")}
    for name in [] if options.text_only else options.robots or names:
        robot = build(name)
        save_picture(draw_robot(robot, resolution=RESOLUTION), IMAGES / f"{name}.png", COLORS["robot"])
        save_picture(draw_link_graph(robot.mechanism), IMAGES / f"{name}-graph.png", COLORS["graph"])
    for path in IMAGES.glob("*.png"):
        if path.name not in wanted:  # of a robot that is gone
            path.unlink()
    PAGE.write_text(describe_gallery(), encoding="utf-8")


if __name__ == "__main__":
    main()
