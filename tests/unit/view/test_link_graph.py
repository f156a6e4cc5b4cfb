"""The link graph: what it tells, and that a person can read it: nothing overlaps, next to nothing crosses."""

from __future__ import annotations

import functools
import itertools
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import paraopt as po
from paraopt.view import draw_link_graph
from paraopt.view.graph_content import ACTIVE, OPERATIONAL, LinkGraph, build_link_graph
from paraopt.view.graph_layout import GraphEdge, GraphNode, Layout, Rectangle, lay_out
from paraopt.view.link_graph import lay_out_link_graph

GALLERY: dict[str, Any] = runpy.run_path(str(Path(__file__).resolve().parents[3] / "docs" / "make_gallery.py"))
ROBOTS = list(GALLERY["list_robots"]())


# --- Machines that the library does not hold


def stacked(stages: int = 4) -> po.Mechanism:
    """Platforms on six legs each, one above the other."""
    links: list[Any] = [po.Base()]
    closures = []
    below = "base"
    for stage in range(1, stages + 1):
        platform = f"platform {stage}"
        links.append(po.Mobile(platform, prefix=f"p{stage}."))
        for i in range(6):
            key = f"{stage}.{i}"
            links.append(po.Series(f"leg {key}", below, (i, 0, 0), po.Universal(f"leg {key}")))
            links.append(po.Series(f"rod {key}", f"leg {key}", (0, 0, 1), po.Prismatic(f"q{key}")))
            closures.append(po.Coincidence(f"rod {key}", (0, 0, 0), platform, (i, 1, 0)))
        below = platform
    active = [f"q{s}.{i}" for s in range(1, stages + 1) for i in range(6)]
    return po.Mechanism("stacked", links, closures, active, [f"p{stages}.x"])


def cut_platform() -> po.Mechanism:
    """A platform cut into one piece per leg, the pieces welded; all links but the last are of one tree."""
    links: list[Any] = [po.Base()]
    closures: list[Any] = []
    for i in (1, 2, 3):
        links.append(po.Series(f"proximal {i}", "base", (i, 0), po.Revolute(f"a{i}")))
        links.append(po.Series(f"distal {i}", f"proximal {i}", (1, 0), po.Revolute(f"b{i}")))
        links.append(po.Series(f"piece {i}", f"distal {i}", (1, 0), po.Revolute(f"c{i}")))
        if i > 1:
            closures.append(po.Weld("piece 1", f"piece {i}", (i, 0)))
    links.append(po.Mobile("platform"))
    closures.append(po.Weld("piece 1", "platform", name="platform is piece 1"))
    return po.Mechanism("cut", links, closures, ["a1", "a2", "a3"], ["x", "y", "theta"], planar=True)


def walker() -> po.Mechanism:
    """A trunk whose legs close at carriers on the ground, with a head that closes nowhere."""
    links: list[Any] = [po.Base("ground"), po.Mobile("trunk")]
    closures = []
    for leg in "abcd":
        links.append(po.Series(f"carrier {leg}", "ground", joint=po.Prismatic(f"z {leg}")))
        links.append(po.Series(f"thigh {leg}", "trunk", (1, 0, 0), po.Revolute(f"hip {leg}", "y")))
        links.append(po.Series(f"shank {leg}", f"thigh {leg}", (1, 0, 0), po.Revolute(f"knee {leg}", "y")))
        closures.append(po.Coincidence(f"shank {leg}", (0, 0, 1), f"carrier {leg}", (0, 0, 0)))
    links.append(po.Series("head", "trunk", (1, 0, 0), po.Revolute("head", "z")))
    return po.Mechanism("walker", links, closures, ["hip a"], ["x", "y", "z"])


def three_by_four() -> po.Mechanism:
    """Every one of three arms and the base is tied to every one of three free links: K(4, 3), which is not planar."""
    links: list[Any] = [po.Base(), *(po.Series(n, "base", joint=po.Revolute(n)) for n in "abc")]
    links += [po.Mobile(n, prefix=n) for n in "PQR"]
    closures = [po.Coincidence(a, (1, 0, 0), b, (1, 0, 0)) for a in ("base", *"abc") for b in "PQR"]
    return po.Mechanism("K(4, 3)", links, closures, ["a"], ["Px"])


OTHERS: dict[str, Callable[[], po.Mechanism]] = {"stacked": stacked, "cut_platform": cut_platform, "walker": walker}


@functools.cache
def mechanism_of(name: str) -> po.Mechanism:
    if name in OTHERS:
        return OTHERS[name]()
    mechanism: po.Mechanism = GALLERY["build"](name).mechanism
    return mechanism


@functools.cache
def layout_of(name: str) -> Layout:
    return lay_out_link_graph(mechanism_of(name))


# --- Measures, on the placed boxes and lines alone


def overlaps(layout: Layout) -> list[tuple[str, str]]:
    """Pairs of boxes, of nodes and of labels, that overlap."""
    boxes = [*layout.nodes.items(), *layout.labels.items()]
    return [(m, n) for (m, a), (n, b) in itertools.combinations(boxes, 2) if a.gap_to(b) < 1e-9]


def pieces(layout: Layout) -> list[tuple[str, Any, Any]]:
    return [(name, a, b) for name, line in layout.lines.items() for a, b in itertools.pairwise(line)]


def crossings(layout: Layout) -> list[tuple[str, str]]:
    """Pairs of lines that meet in a point inside both of them."""

    def turn(p: Any, q: Any, r: Any) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    def cross(a: Any, b: Any, c: Any, d: Any) -> bool:
        return turn(a, b, c) * turn(a, b, d) < -1e-9 and turn(c, d, a) * turn(c, d, b) < -1e-9

    return [
        (m, n) for (m, a, b), (n, c, d) in itertools.combinations(pieces(layout), 2) if m != n and cross(a, b, c, d)
    ]


def passes(layout: Layout, graph: LinkGraph) -> list[tuple[str, str]]:
    """Lines that pass through a box which is not theirs."""
    ends = {tie.name: tie.ends for tie in graph.ties}
    found = []
    for name, a, b in pieces(layout):
        own = {*ends[name], name}
        points = a + np.linspace(0.0, 1.0, 101)[:, None] * (b - a)
        for other, box in [*layout.nodes.items(), *layout.labels.items()]:
            inside = np.abs(points - (box.x, box.y)) < 0.5 * np.array([box.width, box.height]) - 1e-9
            if other not in own and inside.all(axis=1).any():
                found.append((name, other))
    return found


# --- A person can read it


@pytest.mark.parametrize("name", [*ROBOTS, *OTHERS])
def test_boxes_do_not_overlap_and_lines_do_not_cross(name: str) -> None:
    """All robots of the library are planar as graphs: base and platforms joined by legs side by side."""
    mechanism = mechanism_of(name)
    layout, graph = layout_of(name), build_link_graph(mechanism)
    assert set(layout.nodes) == {link.name for link in mechanism.links}
    assert set(layout.lines) == set(layout.labels) == {tie.name for tie in graph.ties}
    assert overlaps(layout) == []
    assert crossings(layout) == []
    assert passes(layout, graph) == []
    for box in [*layout.nodes.values(), *layout.labels.values()]:
        assert -1e-9 <= box.x - 0.5 * box.width <= box.x + 0.5 * box.width <= layout.width + 1e-9
        assert -1e-9 <= box.y - 0.5 * box.height <= box.y + 0.5 * box.height <= layout.height + 1e-9
    assert layout.width < 13.0  # inches: what fits on a screen
    assert layout.height < 13.0


@pytest.mark.parametrize("name", [*ROBOTS, *OTHERS])
def test_lines_join_their_two_boxes(name: str) -> None:
    layout = layout_of(name)
    for tie in build_link_graph(mechanism_of(name)).ties:
        line = layout.lines[tie.name]
        ends = [layout.nodes[end] for end in tie.ends]
        for point, box in zip((line[0], line[-1]), ends if ends[0].y <= ends[1].y else reversed(ends), strict=True):
            assert abs(point[0] - box.x) <= 0.5 * box.width
            assert abs(abs(point[1] - box.y) - 0.5 * box.height) < 1e-9
        label = layout.labels[tie.name]
        assert np.min(np.abs(line[:, 0] - label.x)) < 1e-9  # the line leads through its label


def test_a_graph_that_is_not_planar_has_few_crossings() -> None:
    """K(4, 3) needs 2 crossings at least; the links of a layer may not be passed round, which costs some more."""
    mechanism = three_by_four()
    layout = lay_out_link_graph(mechanism)
    assert overlaps(layout) == []
    assert passes(layout, build_link_graph(mechanism)) == []
    assert 2 <= len(crossings(layout)) <= 14


def test_the_measures_see_faults() -> None:
    layout = Layout(
        {"a": Rectangle(0, 0, 1, 1), "b": Rectangle(0.9, 0, 1, 1), "c": Rectangle(5, 0, 1, 1)},
        {},
        {"one": np.array([[0.0, 2.0], [5.0, 4.0]]), "two": np.array([[0.0, 4.0], [5.0, 2.0]])},
        6.0,
        5.0,
    )
    assert overlaps(layout) == [("a", "b")]
    assert crossings(layout) == [("one", "two")]


@given(data=st.data())
def test_any_graph_is_placed_without_overlaps(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 9))
    layers = data.draw(st.lists(st.integers(0, 4), min_size=count, max_size=count))
    widths = data.draw(st.lists(st.floats(0.2, 2.0), min_size=count, max_size=count))
    nodes = [GraphNode(str(i), k, w, 0.3) for i, (k, w) in enumerate(zip(layers, widths, strict=True))]
    pairs = st.tuples(st.integers(0, count - 1), st.integers(0, count - 1)).filter(lambda pair: pair[0] != pair[1])
    ends = data.draw(st.lists(pairs, max_size=12)) if count > 1 else []
    edges = [GraphEdge(f"edge {k}", (str(a), str(b)), 0.5, 0.2) for k, (a, b) in enumerate(ends)]
    layout = lay_out(nodes, edges)
    assert overlaps(layout) == []
    for node in nodes:
        assert layout.nodes[node.name].width >= node.width - 1e-9
    for edge in edges:
        low, high = sorted(edge.ends, key=lambda end: layout.nodes[end].y)
        assert layout.nodes[low].y < layout.labels[edge.name].y
        if layers[int(low)] != layers[int(high)]:
            assert layout.labels[edge.name].y < layout.nodes[high].y


@given(data=st.data())
def test_any_mechanism_has_layers_and_a_layout(data: st.DataObject) -> None:
    links: list[Any] = [po.Base(), po.Series("link 0", "base", joint=po.Revolute("q0"))]
    for i in range(1, data.draw(st.integers(2, 8))):
        father = data.draw(st.sampled_from([None, *(link.name for link in links)]))
        free = po.Mobile(f"link {i}", prefix=f"{i}.")
        links.append(free if father is None else po.Series(f"link {i}", father, joint=po.Revolute(f"q{i}")))
    names = st.sampled_from([link.name for link in links])
    pairs = data.draw(st.lists(st.tuples(names, names).filter(lambda pair: pair[0] != pair[1]), max_size=7))
    closures = [po.Coincidence(a, (0, 0, 0), b, (0, 0, 0), name=str(k)) for k, (a, b) in enumerate(pairs)]
    active, operational = [m.name for link in links for m in link.motions][:2]
    mechanism = po.Mechanism("any", data.draw(st.permutations(links)), closures, [active], [operational])
    graph = build_link_graph(mechanism)
    layers = {link.name: link.layer for link in graph.links}
    assert layers["base"] == 0
    assert min(layers.values()) == 0
    for tie in graph.ties:
        assert tie.kind == "closure" or layers[tie.ends[0]] != layers[tie.ends[1]]
    layout = lay_out_link_graph(mechanism)
    assert overlaps(layout) == []
    assert passes(layout, graph) == []


@pytest.mark.parametrize(
    ("nodes", "edges", "message"),
    [
        ([], [], "nodes of the graph is empty"),
        ([GraphNode("a", 0, 1, 1)], [GraphEdge("e", ("a", "b"), 1, 1)], "ends at 'b', which is no node"),
        ([GraphNode("a", 0, 1, 1)], [GraphEdge("e", ("a", "a"), 1, 1)], "ties 'a' to itself"),
    ],
)
def test_faulty_graphs_are_refused(nodes: Any, edges: Any, message: str) -> None:
    with pytest.raises(po.DefinitionError, match=message):
        lay_out(nodes, edges)


@pytest.mark.parametrize("name", ["raf", "logabex", "two_rpr"])
def test_texts_fit_into_their_boxes_and_into_the_figure(name: str) -> None:
    mechanism = mechanism_of(name)
    figure = draw_link_graph(mechanism)
    (axes,) = figure.axes
    renderer = figure.canvas.get_renderer()
    layout, graph = lay_out_link_graph(mechanism), build_link_graph(mechanism)
    boxes = {link.name: layout.nodes[link.name] for link in graph.links}
    boxes |= {f"{tie.name} {k}": layout.labels[tie.name] for tie in graph.ties for k in range(len(tie.lines))}
    fitting = 0
    for text in axes.texts:
        extent = text.get_window_extent(renderer)
        assert figure.bbox.x0 <= extent.x0 <= extent.x1 <= figure.bbox.x1, text.get_text()
        assert figure.bbox.y0 <= extent.y0 <= extent.y1 <= figure.bbox.y1, text.get_text()
        corners = axes.transData.inverted().transform(extent.get_points())
        fitting += any(
            np.all(np.abs(corners - (box.x, box.y)) <= 0.5 * np.array([box.width, box.height]) + 0.01)
            for box in boxes.values()
        )
    texts = len(graph.links) + sum(len(k.notes) for k in graph.links) + sum(len(t.lines) for t in graph.ties)
    assert fitting >= texts


# --- It tells what the mechanism is


def test_the_graph_of_the_five_bar() -> None:
    graph = build_link_graph(po.robots.five_bar().mechanism)
    assert {k.name: (k.kind, k.layer) for k in graph.links} == {
        "base": ("base", 0),
        "proximal 1": ("link", 1),
        "proximal 2": ("link", 1),
        "distal 1": ("link", 2),
        "distal 2": ("link", 2),
        "tip": ("mobile", 3),
    }
    ties = {(*tie.ends, tie.kind): (tie.active, [line.text for line in tie.lines]) for tie in graph.ties}
    assert ties == {
        ("base", "proximal 1", "joint"): (True, ["revolute z", f"{ACTIVE} theta1"]),
        ("base", "proximal 2", "joint"): (True, ["revolute z", f"{ACTIVE} theta2"]),
        ("proximal 1", "distal 1", "joint"): (False, ["revolute z", "theta3"]),
        ("proximal 2", "distal 2", "joint"): (False, ["revolute z", "theta4"]),
        ("distal 1", "tip", "closure"): (False, ["coincidence"]),
        ("distal 2", "tip", "closure"): (False, ["coincidence"]),
    }
    (tip,) = [k for k in graph.links if k.kind == "mobile"]
    assert [note.text for note in tip.notes] == [f"{OPERATIONAL} x, y"]


def test_closures_between_the_same_links_make_one_line() -> None:
    graph = build_link_graph(po.robots.raf().mechanism)
    closures = [tie for tie in graph.ties if tie.kind == "closure"]
    assert len(closures) == 7
    assert sum(tie.lines[0].text == "2 × coincidence" for tie in closures) == 4
    joint = next(tie for tie in graph.ties if tie.ends == ("base", "jack 1"))
    assert [line.text for line in joint.lines] == ["spherical", "jack 1.x, .y, .z"]


def test_closures_named_in_both_directions_and_of_two_types_make_one_line() -> None:
    links = [po.Base(), po.Series("a", "base", joint=po.Revolute("q")), po.Mobile("m")]
    closures = [
        po.Coincidence("a", (0, 0, 0), "m", (0, 0, 0), name="pin"),
        po.ParallelAxes("m", "z", "a", "z", name="upright"),
    ]
    graph = build_link_graph(po.Mechanism("pair", links, closures, ["q"], ["x"]))
    (tie,) = [t for t in graph.ties if t.kind == "closure"]
    assert [line.text for line in tie.lines] == ["coincidence", "parallel axes"]


@pytest.mark.parametrize(
    ("build", "above", "below"),
    [
        (walker, "trunk", ("thigh a", "shank a", "carrier d", "ground")),
        (walker, "head", ("trunk",)),
        (walker, "shank b", ("carrier b",)),
        (cut_platform, "platform", ("piece 1", "piece 2", "distal 3")),
        (cut_platform, "piece 1", ("piece 2", "piece 3")),
        (stacked, "platform 4", ("rod 4.0", "platform 3")),
        (stacked, "leg 2.0", ("platform 1",)),
    ],
)
def test_platforms_stand_above_their_legs(build: Callable[[], po.Mechanism], above: str, below: tuple[str]) -> None:
    layout = lay_out_link_graph(build())
    for name in below:
        assert layout.nodes[name].y < layout.nodes[above].y


def test_the_base_is_at_the_bottom_wherever_it_is_declared() -> None:
    mechanism = po.robots.five_bar().mechanism
    turned = po.Mechanism(
        "turned", mechanism.links[::-1], mechanism.closures, mechanism.active, mechanism.operational, planar=True
    )
    layout = lay_out_link_graph(turned)
    assert min(layout.nodes, key=lambda name: layout.nodes[name].y) == "base"
    assert crossings(layout) == []


def test_a_link_that_nothing_ties_to_the_base_is_drawn_too() -> None:
    links = [po.Base(), po.Series("arm", "base", joint=po.Revolute("q")), po.Mobile("loose")]
    layout = lay_out_link_graph(po.Mechanism("loose", links, [], ["q"], ["x"]))
    assert overlaps(layout) == []
    assert "loose" in layout.nodes


# --- The picture


def test_active_joints_differ_in_weight_and_sign_from_the_others(looked_at: Any) -> None:
    """In greyscale too: thicker lines, a sign before the variable, bold letters."""
    figure = draw_link_graph(po.robots.raf().mechanism)
    (axes,) = figure.axes
    texts = {text.get_text(): text for text in axes.texts}
    assert texts[f"{ACTIVE} q1"].get_fontweight() == "bold"
    assert texts["arm A"].get_fontweight() == "normal"
    lines = axes.get_lines()
    solid = sorted({line.get_linewidth() for line in lines if line.get_linestyle() == "-"})
    assert len(solid) == 2
    assert solid[1] >= 2.5 * solid[0]
    assert sum(line.get_linewidth() == solid[1] for line in lines) == 3 + 1  # and one in the legend
    assert sum(line.get_linestyle() == "--" for line in lines) == 7 + 1
    for word in ("RAF: link graph", "22 links, 20 joints, 11 closures; 3 of 32 variables driven", "closure", "joint"):
        assert word in looked_at.texts(figure)


def test_the_legend_explains_only_what_is_drawn(looked_at: Any) -> None:
    links = [
        po.Base(),
        po.Series("arm", "base", joint=po.Revolute("q")),
        po.Series("hand", "arm", joint=po.Revolute("p")),
    ]
    texts = looked_at.texts(draw_link_graph(po.Mechanism("arm", links, [], ["q"], ["p"])))
    assert "mobile" not in texts
    assert "closure\n" not in texts
    assert f"{OPERATIONAL}  operational variable" in texts


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_the_picture_is_saved_and_the_same_every_time(suffix: str, tmp_path: Path) -> None:
    mechanism = po.robots.five_bar().mechanism
    draw_link_graph(mechanism, tmp_path / f"one.{suffix}", resolution=60.0)
    draw_link_graph(mechanism, tmp_path / f"two.{suffix}", resolution=60.0)
    assert (tmp_path / f"one.{suffix}").read_bytes() == (tmp_path / f"two.{suffix}").read_bytes()
    assert len((tmp_path / f"one.{suffix}").read_bytes()) > 1000


def test_other_suffixes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(po.DefinitionError, match=r"must end in \.png or \.svg"):
        draw_link_graph(po.robots.five_bar().mechanism, tmp_path / "graph.pdf")
