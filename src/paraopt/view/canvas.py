"""The one door to matplotlib: figures without a display, in the house style, that are saved the same way every time.

Figures are made with the object interface; pyplot and its global state are not touched. The style is applied around
each drawing function, so a person's own matplotlib settings do not change what paraopt draws, nor are they changed.
"""

from __future__ import annotations

import functools
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from paraopt.errors import DefinitionError, MissingBackendError
from paraopt.io.files import write_atomically
from paraopt.view import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Drawing = TypeVar("Drawing", bound=Callable[..., Any])

SETTINGS: dict[str, Any] = {
    "font.family": ["sans-serif"],
    "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib: the same letters on every machine
    "font.size": 9.0,
    "text.color": style.INK,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlecolor": style.INK,
    "axes.labelcolor": style.INK,
    "axes.labelsize": 9.0,
    "axes.edgecolor": "#9AA5B1",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": True,
    "grid.color": "#E6EAEE",
    "grid.linewidth": 0.7,
    "xtick.color": style.MUTED,
    "ytick.color": style.MUTED,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "lines.linewidth": 1.6,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 1.8,
    "figure.facecolor": style.PAPER,
    "figure.dpi": 100.0,
    "figure.constrained_layout.w_pad": 0.08,  # inches
    "figure.constrained_layout.h_pad": 0.06,
    "savefig.facecolor": style.PAPER,
    "svg.fonttype": "path",
    "svg.hashsalt": "paraopt",
}
"""Settings laid over matplotlib's defaults while a figure is drawn or saved."""


def in_house_style(function: Drawing) -> Drawing:
    """Run a function under matplotlib's defaults and `SETTINGS`, then restore what was set before."""

    @functools.wraps(function)
    def styled(*arguments: Any, **options: Any) -> Any:
        matplotlib = _import_matplotlib()
        with matplotlib.rc_context():
            matplotlib.rcParams.update({k: v for k, v in matplotlib.rcParamsDefault.items() if k != "backend"})
            matplotlib.rcParams.update(SETTINGS)
            return function(*arguments, **options)

    return styled  # type: ignore[return-value]


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure with a raster canvas; width and height are in inches."""
    _import_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


@in_house_style
def save_figure(figure: Figure, path: str | os.PathLike[str], *, resolution: float = 160.0) -> Path:
    """Write a figure as PNG or SVG; the same figure gives the same bytes.

    Args:
        figure: A figure of this room, or any other matplotlib figure.
        path: File to write, "*.png" or "*.svg"; missing folders are made, an old file is replaced at once or not at
            all.
        resolution: Pixels per inch of a PNG.

    Returns:
        The path of the file.

    Raises:
        DefinitionError: The suffix is neither ".png" nor ".svg".
        OSError: The file cannot be written.
    """
    kind = Path(path).suffix.lower().removeprefix(".")
    # Dates and versions would make two runs differ.
    metadata: dict[str, dict[str, str | None]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": "paraopt"},
    }
    if kind not in metadata:
        raise DefinitionError(f"path of the figure is {os.fspath(path)!r}; it must end in .png or .svg")
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, dpi=resolution, metadata=metadata[kind])
    return write_atomically(path, buffer.getvalue())


def display_scale(unit: str, *values: Any) -> tuple[float, str]:
    """Choose the unit in which quantities are printed: millimetres for lengths that stay below two metres.

    Args:
        unit: Unit of the values: what starts with "m" alone or before "/" is a length or its rate.
        values: Arrays in that unit; infinite entries do not count.

    Returns:
        The factor by which values are multiplied, and the unit that results.
    """
    if unit != "m" and not unit.startswith("m/"):
        return 1.0, unit
    largest = max((largest_finite(array) for array in values), default=0.0)
    return (1e3, f"m{unit}") if largest < 2.0 else (1.0, unit)


def largest_finite(values: Any) -> float:
    """Give the largest magnitude among the finite entries, 0 if there is none."""
    array: NDArray[np.float64] = np.abs(np.asarray(values, dtype=float))
    return float(np.max(array, where=np.isfinite(array), initial=0.0))


def axis_label(name: str, unit: str) -> str:
    """Write a quantity with its unit in brackets, or alone if it is a pure number."""
    return f"{name} [{unit}]" if unit else name


def fit_range(axes: Axes, times: NDArray[np.float64]) -> None:
    """Let the time axis span the motion, with a little room for an instant alone."""
    start, end = float(times[0]), float(times[-1])
    axes.set_xlim(start, end if end > start else start + 1.0)


def _import_matplotlib() -> Any:
    try:
        import matplotlib
    except ImportError as error:
        raise MissingBackendError(
            "figures need matplotlib, which is not installed; try: pip install 'paraopt[view]'"
        ) from error
    return matplotlib
