"""Draw what happens along time: strokes, speeds, accelerations and margins, with their limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError
from paraopt.view import style
from paraopt.view.canvas import axis_label, display_scale, fit_range, in_house_style, new_figure, save_figure
from paraopt.view.content import finite_array, increasing_times

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_actuators", "draw_margins", "draw_series", "save_figure"]

LOG_RANGE = 300.0
"""Ratio of the largest to the least margin above which margins are drawn on a logarithmic axis [1]."""

LIMIT_DASHES = (0.0, (5.0, 3.0))
"""Line style of limits and bounds."""


@in_house_style
def draw_series(
    times: Any,
    series: Mapping[str, Any],
    *,
    title: str,
    ylabel: str,
    limits: Mapping[str, tuple[float, float]] | tuple[float, float] | None = None,
    bound: float | None = None,
) -> Figure:
    """Draw named quantities along time with the limits they must respect.

    Limits given by name put every series on a panel of its own; otherwise all share one. A bound is what values must
    stay above, and the least value is marked with its instant.

    Args:
        times: Instants [s], increasing, shape (n,).
        series: Values by name, each of shape (n,), in the unit that `ylabel` tells.
        title: Heading of the figure.
        ylabel: Label of the vertical axes, with the unit.
        limits: Lower and upper limit, of all series or by name; an infinite one is not drawn.
        bound: Lower bound drawn across, such as an asked margin.

    Returns:
        The figure.

    Raises:
        DefinitionError: A size does not match, a value is not finite, or a limit names no series.
    """
    t = increasing_times(times)
    curves = _check_series(t, series, "series")
    by_name = _limits_by_name(limits, curves)
    lower_bound = None if bound is None else float(finite_array([bound], (1,), "bound")[0])
    apart = isinstance(limits, Mapping) and len(curves) > 1
    groups = [[name] for name in curves] if apart else [list(curves)]
    figure = new_figure(7.2, 0.9 + 1.25 * len(groups) if apart else 3.4)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    panels = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
    for axes, names in zip(panels, groups, strict=True):
        for index, name in enumerate(names):
            color = style.series_color(0 if apart else index)
            axes.plot(t, curves[name], color=color, linestyle=style.series_dash(index), label=name)
        if apart:
            axes.set_title(names[0], fontsize=8.5)
        for low, high in dict.fromkeys(by_name[name] for name in names if name in by_name):
            _draw_limit(axes, low, "lower limit")
            _draw_limit(axes, high, "upper limit")
        if lower_bound is not None:
            _draw_limit(axes, lower_bound, "asked")
            _mark_least(axes, t, {name: curves[name] for name in names})
        if len(names) > 1:
            _place_legend(axes, len(names))
        axes.margins(y=0.22 if apart else 0.18)
        fit_range(axes, t)
    if len(groups) > 1:
        figure.supylabel(ylabel, fontsize=9)
    else:
        panels[0].set_ylabel(ylabel)
    panels[-1].set_xlabel("time [s]")
    return figure


@in_house_style
def draw_actuators(
    times: Any,
    names: Sequence[str],
    positions: Any,
    velocities: Any,
    accelerations: Any,
    *,
    units: str | Sequence[str],
    position_limits: Any = None,
    velocity_limits: Any = None,
    acceleration_limits: Any = None,
    title: str = "Actuators",
) -> Figure:
    """Draw position, velocity and acceleration of every actuator above one another, with their limits.

    Actuators of different units stand in different columns. Limits that all actuators of a column share are drawn once,
    in grey; others take the colour of their actuator.

    Args:
        times: Instants [s], increasing, shape (n,).
        names: Names of the actuators.
        positions: Shape (n, n_active), in `units`.
        velocities: Shape (n, n_active), in `units` per second.
        accelerations: Shape (n, n_active), in `units` per second squared.
        units: "m" or "rad", one for all or one per actuator; lengths below 2 m are printed in millimetres.
        position_limits: Lower and upper limit of each actuator, shape (n_active, 2); infinite ones are not drawn.
        velocity_limits: The same for velocities.
        acceleration_limits: The same for accelerations.
        title: Heading of the figure.

    Returns:
        The figure.

    Raises:
        DefinitionError: A size does not match or a value is not finite.
    """
    t = increasing_times(times)
    n_active = len(names)
    unit_of = [units] * n_active if isinstance(units, str) else list(units)
    if n_active == 0 or len(unit_of) != n_active:
        raise DefinitionError(f"units: there are {len(unit_of)} for {n_active} actuators; give one each, at least one")
    rows: list[tuple[str, str, NDArray[np.float64], NDArray[np.float64]]] = []
    for what, per, values, limits in (
        ("position", "", positions, position_limits),
        ("velocity", "/s", velocities, velocity_limits),
        ("acceleration", "/s²", accelerations, acceleration_limits),
    ):
        array = finite_array(values, (len(t), n_active), f"{what} of the actuators")
        rows.append((what, per, array, _check_limits(limits, n_active, f"{what} limits")))

    columns = list(dict.fromkeys(unit_of))
    figure = new_figure(7.4 if len(columns) == 1 else 5.2 * len(columns), 7.0)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    panels = figure.subplots(3, len(columns), sharex=True, squeeze=False)
    for column, unit in enumerate(columns):
        members = [index for index in range(n_active) if unit_of[index] == unit]
        factor, shown = display_scale(unit, rows[0][2][:, members], rows[0][3][members])
        for axes, (what, per, array, limits) in zip(panels[:, column], rows, strict=True):
            for index in members:
                color, dash = style.series_color(index), style.series_dash(index)
                axes.plot(t, factor * array[:, index], color=color, linestyle=dash, label=names[index])
            shared = bool(np.all(limits[members] == limits[members[0]]))
            for index in members[:1] if shared else members:
                for value, side in zip(factor * limits[index], ("lower limit", "upper limit"), strict=True):
                    _draw_limit(axes, value, side, None if shared else style.series_color(index), labelled=shared)
            axes.set_ylabel(axis_label(what, shown + per))
            axes.margins(y=0.12)
            fit_range(axes, t)
        apart = any(np.ptp(np.nan_to_num(limits[members]), axis=0).any() for _, _, _, limits in rows)
        if apart:  # its entry says what the dashes in the colours of the actuators are
            panels[0, column].plot([], [], color=style.MUTED, linewidth=1.1, linestyle=LIMIT_DASHES, label="limits")
        _place_legend(panels[0, column], len(members) + apart)
        panels[-1, column].set_xlabel("time [s]")
    figure.align_ylabels(panels)
    return figure


@in_house_style
def draw_margins(
    times: Any,
    clearance: Any,
    clearance_bound: float | None,
    margins: Mapping[str, Any],
    margin_bound: float | None,
    *,
    title: str = "Margins along the motion",
) -> Figure:
    """Draw the clearance and the singularity margins along time with what was asked; least values are marked.

    Args:
        times: Instants [s], increasing, shape (n,).
        clearance: Least distance between solids [m], shape (n,); None where nothing can collide.
        clearance_bound: Clearance asked for [m]; None for none.
        margins: Singularity margins by name [1], each of shape (n,).
        margin_bound: Margin asked for [1]; None for none.
        title: Heading of the figure.

    Returns:
        The figure.

    Raises:
        DefinitionError: A size does not match or a value is not finite.
    """
    t = increasing_times(times)
    distances = None if clearance is None else finite_array(clearance, (len(t),), "clearance")
    curves = _check_series(t, margins, "margins")
    bounds = [
        None if value is None else float(finite_array([value], (1,), what)[0])
        for value, what in ((clearance_bound, "clearance bound"), (margin_bound, "margin bound"))
    ]
    figure = new_figure(7.4, 5.2 if distances is not None else 3.0)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    panels = figure.subplots(1 if distances is None else 2, 1, sharex=True, squeeze=False)[:, 0]
    below = panels[-1]
    if distances is not None:
        above = panels[0]
        factor, unit = display_scale("m", distances, [bounds[0] or 0.0])
        above.plot(t, factor * distances, color=style.series_color(0))
        if bounds[0] is not None:
            _draw_limit(above, factor * bounds[0], "asked", label_unit=unit)
        _mark_least(above, t, {"": factor * distances}, unit)
        above.set_ylabel(axis_label("clearance", unit))
        above.margins(y=0.18)

    for index, (name, values) in enumerate(curves.items()):
        below.plot(t, values, color=style.series_color(index), linestyle=style.series_dash(index), label=name)
    drawn = [*curves.values(), *([np.array([bounds[1]])] if bounds[1] is not None else [])]
    least, greatest = min(float(v.min()) for v in drawn), max(float(v.max()) for v in drawn)
    if least > 0.0 and greatest > LOG_RANGE * least:
        below.set_yscale("log")
    if bounds[1] is not None:
        _draw_limit(below, bounds[1], "asked")
    _mark_least(below, t, curves)
    below.set_ylabel("singularity margin")
    below.set_xlabel("time [s]")
    below.margins(y=0.18)
    fit_range(below, t)
    _place_legend(below, len(curves))
    figure.align_ylabels(list(panels))
    return figure


def _check_series(t: NDArray[np.float64], series: Mapping[str, Any], what: str) -> dict[str, NDArray[np.float64]]:
    if not series:
        raise DefinitionError(f"{what} is empty; give at least one named array of {len(t)} values")
    return {name: finite_array(values, (len(t),), f"{what} {name!r}") for name, values in series.items()}


def _check_limits(limits: Any, n_active: int, what: str) -> NDArray[np.float64]:
    """Copy limits into shape (n_active, 2); infinities stand for none."""
    if limits is None:
        return np.tile([-np.inf, np.inf], (n_active, 1))
    try:
        array = np.array(limits, dtype=float)
    except (TypeError, ValueError) as error:
        raise DefinitionError(f"{what}: entries must be numbers ({error})") from error
    if array.shape != (n_active, 2) or np.isnan(array).any() or np.any(array[:, 0] > array[:, 1]):
        raise DefinitionError(
            f"{what} are {array.tolist()}; they must be (lower, upper) of each of the {n_active} actuators"
        )
    return array


def _limits_by_name(
    limits: Mapping[str, tuple[float, float]] | tuple[float, float] | None, curves: Mapping[str, Any]
) -> dict[str, tuple[float, float]]:
    if limits is None:
        return {}
    named = limits if isinstance(limits, Mapping) else dict.fromkeys(curves, limits)
    unknown = [name for name in named if name not in curves]
    if unknown:
        raise DefinitionError(f"limits name {unknown[0]!r}, which is no series; series: {', '.join(map(repr, curves))}")
    arrays = {name: _check_limits([pair], 1, f"limits of {name!r}")[0] for name, pair in named.items()}
    return {name: (float(low), float(high)) for name, (low, high) in arrays.items()}


def _draw_limit(
    axes: Axes, value: float, word: str, color: str | None = None, *, labelled: bool = True, label_unit: str = ""
) -> None:
    """Draw a dashed line across at a limit, with its word and value above it at the right end."""
    if not np.isfinite(value):
        return
    paint = color or ("#A84600" if word == "asked" else style.MUTED)
    axes.axhline(value, color=paint, linewidth=1.1, linestyle=LIMIT_DASHES, zorder=1.5)
    if labelled:
        under = word == "lower limit"
        text = f"{word} {_print(value)} {label_unit}".rstrip()
        axes.annotate(
            text,
            (1.0, value),
            xycoords=axes.get_yaxis_transform(),
            xytext=(-3, -2.5 if under else 2.5),
            textcoords="offset points",
            ha="right",
            va="top" if under else "bottom",
            fontsize=7.5,
            color=paint,
            bbox={"facecolor": style.PAPER, "alpha": 0.75, "edgecolor": "none", "pad": 0.6},
        )


def _mark_least(axes: Axes, t: NDArray[np.float64], curves: Mapping[str, NDArray[np.float64]], unit: str = "") -> None:
    """Mark the least value among the curves with a ring, its value and its instant."""
    name = min(curves, key=lambda candidate: float(curves[candidate].min()))
    index = int(np.argmin(curves[name]))
    when, value = float(t[index]), float(curves[name][index])
    color = style.series_color(list(curves).index(name))
    axes.plot(
        [when], [value], "o", markersize=6, markerfacecolor=style.PAPER, markeredgecolor=color, zorder=4, clip_on=False
    )
    share = (when - t[0]) / (t[-1] - t[0]) if len(t) > 1 else 0.0
    side = "left" if share < 0.25 else "right" if share > 0.75 else "center"
    axes.annotate(
        f"least {_print(value)}{' ' + unit if unit else ''} at {when:.3g} s",
        (when, value),
        xytext=({"left": 6, "right": -6, "center": 0}[side], -7),
        textcoords="offset points",
        ha=side,
        va="top",
        fontsize=8,
        zorder=5,
        bbox={"facecolor": style.PAPER, "alpha": 0.8, "edgecolor": "none", "pad": 1.0},
    )


def _place_legend(axes: Axes, count: int) -> None:
    """Put the legend above the axes, in a row where it fits; a wider one would push the axes aside."""
    panels, letters = 1, max((len(label) for label in axes.get_legend_handles_labels()[1]), default=0)
    if (place := axes.get_subplotspec()) is not None:
        panels = place.get_gridspec().ncols
    # inches: room beside the ticks, and an entry of handle and letters of 8.5 points
    figure = axes.get_figure(root=True)
    width = 7.4 if figure is None else float(figure.get_size_inches()[0])
    room, entry = width / panels - 0.4, 0.45 + 0.075 * letters
    columns = max(1, min(count, 6, int(room / entry)))
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.2, columnspacing=1.2)


def _print(value: float) -> str:
    return f"{value:.4g}".replace("-", "−")
