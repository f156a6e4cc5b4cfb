"""Draw the graph of a mechanism: links as boxes, joints as lines, closures as dashed lines, the base at the bottom."""

from __future__ import annotations

import functools
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from paraopt.mechanism import Mechanism
from paraopt.view import style
from paraopt.view.canvas import in_house_style, new_figure, save_figure
from paraopt.view.graph_content import ACTIVE, OPERATIONAL, GraphLink, GraphTie, LinkGraph, build_link_graph, count
from paraopt.view.graph_layout import GraphEdge, GraphNode, Layout, LayoutOptions, Rectangle, lay_out

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NODE_SIZE, LABEL_SIZE, TITLE_SIZE = 9.0, 7.5, 11.0
"""Sizes of letters [pt]."""

LINE_HEIGHT = 1.3
"""Distance between lines of text, in sizes of its letters [1]."""

PADDING = 0.08
"""Room between text and the border of its box [in]."""

DASHES = (0.0, (2.4, 1.4))
DRIVEN_FILL = "#FBE9C6"


@in_house_style
def lay_out_link_graph(mechanism: Mechanism, options: LayoutOptions | None = None) -> Layout:
    """Place the boxes and lines of the graph of a mechanism, the boxes as wide as their texts [in].

    Args:
        mechanism: The mechanism.
        options: Distances and effort of the layout.

    Returns:
        Boxes by name of link; labels and lines by name of tie, see `build_link_graph`.
    """
    return _lay_out(build_link_graph(mechanism), options)


@in_house_style
def draw_link_graph(
    mechanism: Mechanism, path: str | os.PathLike[str] | None = None, *, resolution: float = 160.0
) -> Figure:
    """Draw the graph of a mechanism: links as boxes, joints as lines with their variables, closures dashed.

    The base is the bar at the bottom, mobile links have a double border; joints that an actuator drives are thick,
    their label is boxed and the variable marked. The size of the figure grows with the graph.

    Args:
        mechanism: The mechanism, such as `robot.mechanism`.
        path: File to write, "*.png" or "*.svg"; none when None.
        resolution: Pixels per inch of a PNG.

    Returns:
        The figure.

    Raises:
        DefinitionError: The suffix of the file is neither ".png" nor ".svg".
        OSError: The file cannot be written.
    """
    graph = build_link_graph(mechanism)
    layout = _lay_out(graph, None)
    entries = _list_entries(graph)
    margin, hatch, heading = 0.18, 0.16, 0.62
    width = max(layout.width, 4.6)
    columns = max(1, min(len(entries), int(width / 1.75)))
    legend = 0.24 * -(-len(entries) // columns)
    total_width, total_height = width + 2 * margin, layout.height + hatch + heading + legend + 2 * margin
    figure = new_figure(total_width, total_height)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    x, y = -0.5 * (total_width - layout.width), -(margin + legend + hatch)
    axes.set(xlim=(x, x + total_width), ylim=(y, y + total_height))
    axes.set_axis_off()
    for tie in graph.ties:
        _draw_tie(axes, tie, layout)
    for link in graph.links:
        _draw_node(axes, link, layout.nodes[link.name], hatch)
    top = y + total_height - margin
    axes.text(x + margin, top, f"{mechanism.name}: link graph", fontsize=TITLE_SIZE, fontweight="bold", va="top")
    joints = sum(tie.kind == "joint" for tie in graph.ties)
    facts = (
        f"{count(len(graph.links), 'link')}, {count(joints, 'joint')}, {count(len(mechanism.closures), 'closure')}; "
        f"{len(mechanism.active)} of {count(len(mechanism.variables), 'variable')} driven"
    )
    axes.text(x + margin, top - 0.22, facts, fontsize=LABEL_SIZE + 0.5, color=style.MUTED, va="top")
    _draw_legend(axes, entries, columns, x + margin, y + margin, width)
    if path is not None:
        save_figure(figure, path, resolution=resolution)
    return figure


# --- Layout


def _lay_out(graph: LinkGraph, options: LayoutOptions | None) -> Layout:
    sizes = {link.name: _box_of(link) for link in graph.links}
    # boxes of one width make columns that are easy to follow; one long name does not widen them all
    common = min(max(_box_of(replace(link, notes=()))[0] for link in graph.links), 1.7)
    nodes = [
        GraphNode(link.name, link.layer, max(sizes[link.name][0], common), sizes[link.name][1]) for link in graph.links
    ]
    edges = []
    for tie in graph.ties:
        width = max(_measure(line.text, LABEL_SIZE, line.bold) for line in tie.lines)
        height = len(tie.lines) * LABEL_SIZE * LINE_HEIGHT / 72.0
        edges.append(
            GraphEdge(tie.name, tie.ends, width + (2.0 if tie.active else 1.0) * PADDING, height + 0.5 * PADDING)
        )
    return lay_out(nodes, edges, options)


def _box_of(link: GraphLink) -> tuple[float, float]:
    width = max(
        [_measure(link.name, NODE_SIZE, bold=True), *(_measure(n.text, LABEL_SIZE, n.bold) for n in link.notes)]
    )
    height = LINE_HEIGHT * (NODE_SIZE + len(link.notes) * LABEL_SIZE) / 72.0
    return width + 2.4 * PADDING, height + PADDING


@functools.cache
def _measure(text: str, size: float, bold: bool = False) -> float:
    """Measure the width of a line of text [in]."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    font = FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal")
    return float(TextPath((0.0, 0.0), text or " ", size=size, prop=font).get_extents().x1) / 72.0


# --- Drawing


def _draw_node(axes: Axes, link: GraphLink, box: Rectangle, hatch: float) -> None:
    """Draw a link: dark with a hatched ground below for the base, a double border for a mobile link."""
    from matplotlib.patches import FancyBboxPatch
    from matplotlib.patches import Rectangle as Patch

    left, bottom = box.x - 0.5 * box.width, box.y - 0.5 * box.height
    colors = {"base": (style.KIND_COLORS["base"], style.INK, "white"), "mobile": ("#DCEBF5", style.BLUE, style.INK)}
    face, edge, ink = colors.get(link.kind, (style.SURFACE, "#7B8794", style.INK))
    if link.kind == "base":
        ground = Patch(
            (left, bottom - hatch), box.width, hatch, facecolor="none", edgecolor="#7B8794", hatch="////", linewidth=0
        )
        axes.add_patch(ground)
        axes.add_patch(Patch((left, bottom), box.width, box.height, facecolor=face, edgecolor=edge, linewidth=1.0))
    else:
        round_box = f"round,pad=0,rounding_size={min(0.07, 0.3 * box.height)}"
        corner, width, height = (left, bottom), box.width, box.height
        axes.add_patch(
            FancyBboxPatch(
                corner, width, height, boxstyle=round_box, mutation_aspect=1.0, facecolor=face, edgecolor=edge,
                linewidth=1.3 if link.kind == "mobile" else 1.0, zorder=3,
            )
        )  # fmt: skip
        if link.kind == "mobile":
            inset = 0.03
            axes.add_patch(
                FancyBboxPatch(
                    (left + inset, bottom + inset), width - 2 * inset, height - 2 * inset, boxstyle=round_box,
                    facecolor="none", edgecolor=edge, linewidth=0.7, zorder=3,
                )
            )  # fmt: skip
    lines: list[tuple[str, dict[str, Any]]] = [
        (link.name, {"fontsize": NODE_SIZE, "fontweight": "normal" if link.kind == "link" else "bold"})
    ]
    for note in link.notes:
        lines.append((note.text, {"fontsize": LABEL_SIZE, "fontweight": "bold" if note.bold else "normal"}))
    _write(axes, lines, box, ink)


def _write(axes: Axes, lines: Sequence[tuple[str, dict[str, Any]]], box: Rectangle, ink: str) -> None:
    """Write lines of text one below the other, centred in a box."""
    heights = [LINE_HEIGHT * look["fontsize"] / 72.0 for _, look in lines]
    y = box.y + 0.5 * sum(heights)
    for (text, look), height in zip(lines, heights, strict=True):
        axes.text(
            box.x, y - 0.5 * height, text, color=ink, ha="center", va="center_baseline", zorder=5, **look
        )  # fmt: skip
        y -= height


def _draw_tie(axes: Axes, tie: GraphTie, layout: Layout) -> None:
    """Draw a joint or a closure as a line, interrupted by its text."""
    from matplotlib.patches import Rectangle as Patch

    look: dict[str, Any] = _look_of(tie.kind, tie.active)
    axes.plot(*layout.lines[tie.name].T, zorder=1 + tie.active, solid_joinstyle="round", **look)
    box = layout.labels[tie.name]
    axes.add_patch(
        Patch(
            (box.x - 0.5 * box.width, box.y - 0.5 * box.height), box.width, box.height,
            facecolor=DRIVEN_FILL if tie.active else style.PAPER, edgecolor=style.INK if tie.active else "none",
            linewidth=0.9, zorder=2.5,
        )
    )  # fmt: skip
    lines: list[tuple[str, dict[str, Any]]] = []
    for line in tie.lines:
        slant = "italic" if tie.kind == "closure" and line.role == "type" else "normal"
        weight = "bold" if line.bold else "normal"
        lines.append((line.text, {"fontsize": LABEL_SIZE, "fontstyle": slant, "fontweight": weight}))
    _write(axes, lines, box, style.MUTED if tie.kind == "closure" else style.INK)


def _look_of(kind: str, active: bool) -> dict[str, Any]:
    if kind == "closure":
        return {"color": "#8A3F73", "linewidth": 1.5, "linestyle": DASHES, "dash_capstyle": "butt"}
    if active:
        return {"color": style.VERMILLION, "linewidth": 4.0, "solid_capstyle": "butt"}
    return {"color": style.INK, "linewidth": 1.3, "solid_capstyle": "butt"}


def _list_entries(graph: LinkGraph) -> list[tuple[str, str]]:
    """List what the legend explains: only what the graph holds."""
    kinds = {link.kind for link in graph.links}
    roles = {n.role for link in graph.links for n in link.notes} | {t.role for tie in graph.ties for t in tie.lines}
    entries = [("base", "base, on the ground"), ("link", "link"), ("mobile", "mobile (free) link")]
    found: list[tuple[str, str]] = [(key, text) for key, text in entries if key in kinds]
    if any(tie.kind == "joint" and not tie.active for tie in graph.ties):
        found.append(("joint", "joint"))
    if any(tie.active for tie in graph.ties):
        found.append(("active", "active (driven) joint"))
    if any(tie.kind == "closure" for tie in graph.ties):
        found.append(("closure", "closure"))
    if "active" in roles:
        found.append(("sign", f"{ACTIVE}  active variable"))
    if "operational" in roles:
        found.append(("sign", f"{OPERATIONAL}  operational variable"))
    return found


def _draw_legend(
    axes: Axes, entries: Sequence[tuple[str, str]], columns: int, left: float, bottom: float, width: float
) -> None:
    """Write what boxes, lines and signs mean below the graph, in columns."""
    rows = -(-len(entries) // columns)
    for index, (kind, text) in enumerate(entries):
        x = left + (index % columns) * width / columns
        y = bottom + (rows - 1 - index // columns) * 0.24 + 0.06
        if kind in ("base", "link", "mobile"):
            symbol = GraphLink("", kind, 0)  # type: ignore[arg-type]
            _draw_node(axes, symbol, Rectangle(x + 0.16, y, 0.32, 0.14), 0.05)
        elif kind != "sign":
            axes.plot([x, x + 0.32], [y, y], **_look_of("closure" if kind == "closure" else "joint", kind == "active"))
        offset = 0.0 if kind == "sign" else 0.4
        axes.text(x + offset, y, text, fontsize=LABEL_SIZE + 0.5, color=style.MUTED, va="center_baseline")
