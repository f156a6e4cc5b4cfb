"""What the tests of figures share: reading back what was drawn."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest


def read_png(path: Path) -> np.ndarray:
    """Read the pixels of a PNG, red, green and blue in [0, 1]; shape (height, width, 3)."""
    import matplotlib.image

    return np.asarray(matplotlib.image.imread(io.BytesIO(path.read_bytes()), format="png"))[..., :3]


def lines_at(axes: Any, value: float, tolerance: float = 1e-9) -> list[Any]:
    """Find the dashed lines that run across axes at a value."""
    found = []
    for line in axes.get_lines():
        y = np.asarray(line.get_ydata(), dtype=float)
        if len(y) == 2 and np.allclose(y, value, rtol=0, atol=tolerance) and line.get_linestyle() == "--":
            found.append(line)
    return found


@pytest.fixture
def looked_at() -> Any:
    """Give the functions that read back what was drawn."""

    class Looked:
        read_png = staticmethod(read_png)
        lines_at = staticmethod(lines_at)

        @staticmethod
        def texts(figure: Any) -> str:
            from matplotlib.text import Text

            return "\n".join(t.get_text() for t in figure.findobj(Text))

    return Looked
