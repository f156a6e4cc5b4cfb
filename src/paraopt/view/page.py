"""Write a moving robot as one HTML file that opens without a network and plays.

The file carries everything: three.js and the modules under `assets/` as `data:` URLs of an import map, the motion as
base64 of 32-bit floats. Its content security policy forbids any request. A test drives it through `window.paraopt`,
whose members are listed at the end of `assets/page.js`.
"""

from __future__ import annotations

import base64
import html
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from paraopt.errors import DefinitionError, unknown_name
from paraopt.io.files import write_atomically
from paraopt.shapes import Box, Capsule, Cone, ConvexPolyhedron, Cylinder, HalfSpace, Mesh, Shape, Sphere, name_kinds
from paraopt.spatial import AXES
from paraopt.view import style
from paraopt.view.content import (
    Body,
    CableLine,
    Mark,
    PathLine,
    Phase,
    Readout,
    check_phases,
    finite_array,
    increasing_times,
)
from paraopt.view.space import cut_half_space

MODULES: Mapping[str, str] = {
    "three": "three/three.module.min.js",
    "three/addons/controls/OrbitControls.js": "three/OrbitControls.js",
    "paraopt/motion": "motion.js",
    "paraopt/solids": "solids.js",
    "paraopt/moving": "moving.js",
    "paraopt/stage": "stage.js",
    "paraopt/charts": "charts.js",
}
"""Modules of a page: the name by which they are imported, and the file under `assets/`."""


def write_page(
    path: str | os.PathLike[str],
    *,
    title: str,
    bodies: Sequence[Body],
    times: Any,
    poses: Any,
    paths: Sequence[PathLine] = (),
    readouts: Sequence[Readout] = (),
    cables: Sequence[CableLine] = (),
    phases: Sequence[Phase] = (),
    up: str = "z",
    caption: str = "",
    pose_tolerance: float = 1e-6,
) -> Path:
    """Write a page that shows and plays the motion of a robot.

    Between two samples the page interpolates positions linearly and orientations along the shortest arc.

    Args:
        path: File to write, usually `*.html`; missing folders are made, an old file is replaced at once or not at all.
        title: Heading of the page.
        bodies: Solids to draw.
        times: Instants of the samples [s], increasing, shape (n,) with n >= 1.
        poses: Poses `X_WF` of the frames that carry bodies, lengths in m, shape (n, n_frames, 4, 4).
        paths: Lines in space, named in the legend.
        readouts: Quantities shown under the view, each with one value per sample.
        cables: Straight lines between points of two frames; thin ones are drawn thick enough to be seen.
        phases: Named parts of the motion, one after another, with what stands out during each.
        up: World axis that points upwards on the screen: "x", "y" or "z".
        caption: A sentence under the heading.
        pose_tolerance: Largest departure of `R^T R` from the identity accepted in `poses` [1].

    Returns:
        The path of the file.

    Raises:
        DefinitionError: A size does not match, a value is not finite, a pose is not rigid, or there is nothing to draw.
        OSError: The file cannot be written.
    """
    content = build_page(
        title=title,
        bodies=bodies,
        times=times,
        poses=poses,
        paths=paths,
        readouts=readouts,
        cables=cables,
        phases=phases,
        up=up,
        caption=caption,
        pose_tolerance=pose_tolerance,
    )
    return write_atomically(path, content.encode("utf-8"))


def build_page(
    *,
    title: str,
    bodies: Sequence[Body],
    times: Any,
    poses: Any,
    paths: Sequence[PathLine] = (),
    readouts: Sequence[Readout] = (),
    cables: Sequence[CableLine] = (),
    phases: Sequence[Phase] = (),
    up: str = "z",
    caption: str = "",
    pose_tolerance: float = 1e-6,
) -> str:
    """Build the text of the page that `write_page` writes; arguments and errors are the same."""
    if not (bodies or cables):
        raise DefinitionError("bodies is empty; a page needs at least one solid or cable to draw")
    if up not in AXES:
        raise unknown_name("axis that points up:", up, AXES)
    instants = increasing_times(times)
    X_WF = _check_poses(poses, len(instants), pose_tolerance)
    phases = check_phases(phases, float(instants[0]), float(instants[-1]))
    marks = [mark for phase in phases for mark in phase.marks]
    _check_frames(bodies, cables, marks, X_WF.shape[1])
    _check_readouts(readouts, len(instants))
    bodies = _cut_half_spaces(bodies, X_WF)
    carried = [*(b.frame for b in bodies), *(f for c in cables for f in c.frames), *(m.frame for m in marks)]
    used = sorted({int(frame) for frame in carried if frame >= 0})
    place = {-1: -1, **{frame: index for index, frame in enumerate(used)}}
    data = {
        "up": up,
        "count": len(instants),
        "frames": len(used),
        "times": _encode(instants),
        "poses": _encode(_positions_and_quaternions(X_WF[:, used])),
        "bodies": [
            {
                "name": body.name,
                "kind": body.kind,
                "frame": place[int(body.frame)],
                "shape": _describe(body.shape, body.name),
                "pose": np.round(body.shape.pose, 9).ravel().tolist(),
            }
            for body in bodies
        ],
        "kinds": {kind: {"color": c, "label": style.KIND_LABELS[kind]} for kind, c in style.KIND_COLORS.items()},
        "paths": [
            {
                "name": line.name,
                "color": line.color or style.path_color(index),
                "dashed": bool(line.dashed),
                "points": _encode(line.points),
            }
            for index, line in enumerate(paths)
        ],
        "cables": [
            {
                "name": cable.name,
                "frames": [place[frame] for frame in cable.frames],
                "points": np.round(cable.points, 9).tolist(),
                "radius": cable.radius,
                "label": cable.label,
                "color": cable.color or style.CABLE,
            }
            for cable in cables
        ],
        "phases": _describe_phases(phases, place),
        "readouts": [
            {
                "name": readout.name,
                "unit": readout.unit,
                "bound": readout.bound,
                "side": readout.side,
                "values": _encode(readout.values),
            }
            for readout in readouts
        ],
        "colors": {
            "ink": style.INK,
            "muted": style.MUTED,
            "rule": style.RULE,
            "axes": _axis_colors(),
        },
    }
    imports = {name: _data_url(_asset(file)) for name, file in MODULES.items()}
    return _fill(
        _asset("page.html"),
        {
            "title": html.escape(title),
            "caption": html.escape(caption),
            "style": _style_variables() + _asset("page.css"),
            "data": _json_for_script(data),
            "imports": _json_for_script({"imports": imports}),
            "script": _asset("page.js"),
            "license": _asset("three/LICENSE").strip(),
        },
    )


def _check_poses(poses: Any, n_samples: int, tolerance: float) -> NDArray[np.float64]:
    if isinstance(poses, np.ndarray) and poses.shape == (n_samples, 0, 4, 4):  # everything is fixed in the world
        return np.zeros((n_samples, 0, 4, 4))
    X_WF = finite_array(poses, (n_samples, None, 4, 4), "poses")
    R = X_WF[..., :3, :3]
    departure = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).max(axis=(-1, -2))
    rigid = (departure <= tolerance) & (np.linalg.det(R) > 0.0) & np.all(X_WF[..., 3, :] == (0, 0, 0, 1), axis=-1)
    if not rigid.all():
        sample, frame = (int(i) for i in np.argwhere(~rigid)[0])
        raise DefinitionError(
            f"poses: frame {frame} at sample {sample} is not a rigid pose: |R^T R - 1| is "
            f"{departure[sample, frame]:.3g}, det R {np.linalg.det(R[sample, frame]):.6g}; "
            f"expected at most {tolerance:g} and 1"
        )
    return X_WF


def _check_frames(bodies: Sequence[Body], cables: Sequence[CableLine], marks: Sequence[Mark], n_frames: int) -> None:
    frames = [(f"body {body.name!r}", body.frame) for body in bodies]
    frames += [(f"cable {cable.name!r}", frame) for cable in cables for frame in cable.frames]
    frames += [(f"mark {mark.label!r}", mark.frame) for mark in marks]
    for what, frame in frames:
        if frame >= n_frames:
            raise DefinitionError(f"frame of {what} is {frame}, but poses hold {n_frames} frames (0 to {n_frames - 1})")


def _describe_phases(phases: Sequence[Phase], place: Mapping[int, int]) -> list[dict[str, Any]]:
    """Describe phases; marks of one label take its colour, which is given out in the order of the labels."""
    labels = list(dict.fromkeys(mark.label for phase in phases for mark in phase.marks))
    colors = {label: style.MARKS[index % len(style.MARKS)] for index, label in enumerate(labels)}
    colors |= {mark.label: mark.color for phase in phases for mark in phase.marks if mark.color}
    return [
        {
            "name": phase.name,
            "begin": phase.begin,
            "end": phase.end,
            "marks": [
                {
                    "label": mark.label,
                    "color": mark.color or colors[mark.label],
                    "frame": place[int(mark.frame)],
                    "point": None if mark.point is None else list(mark.point),
                }
                for mark in phase.marks
            ],
        }
        for phase in phases
    ]


def _check_readouts(readouts: Sequence[Readout], n_samples: int) -> None:
    for readout in readouts:
        if len(readout.values) != n_samples:
            raise DefinitionError(
                f"values of readout {readout.name!r}: there are {len(readout.values)} for {n_samples} times; "
                "give one per time"
            )


def _positions_and_quaternions(X_WF: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn poses (n, f, 4, 4) into (n, f, 7): x y z [m], then the unit quaternion x y z w, continuous along time."""
    n, f = X_WF.shape[:2]
    result = np.zeros((n, f, 7))
    result[..., :3] = X_WF[..., :3, 3]
    if f:
        quaternions = Rotation.from_matrix(X_WF[..., :3, :3].reshape(-1, 3, 3)).as_quat().reshape(n, f, 4)
        turns = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0.0, -1.0, 1.0)
        quaternions[1:] *= np.cumprod(turns, axis=0)[..., None]
        result[..., 3:] = quaternions
    return result


def _describe(shape: Shape, name: str) -> dict[str, Any]:
    match shape:
        case Box():
            return {"type": "box", "size": np.asarray(shape.size).tolist()}
        case Sphere():
            return {"type": "sphere", "radius": shape.radius}
        case Cylinder() | Capsule() | Cone():
            return {"type": type(shape).__name__.lower(), "radius": shape.radius, "length": shape.length}
        case ConvexPolyhedron():
            return _describe_triangles(shape.hull.vertices, shape.hull.triangles)
        case Mesh():
            return _describe_triangles(np.asarray(shape.vertices), np.asarray(shape.triangles))
    raise DefinitionError(f"shape of body {name!r} is a {type(shape).__name__}; a page draws {name_kinds()}")


def _describe_triangles(vertices: NDArray[np.float64], triangles: NDArray[np.intp]) -> dict[str, Any]:
    return {"type": "mesh", "vertices": _encode(vertices), "triangles": triangles.ravel().tolist()}


def _cut_half_spaces(bodies: Sequence[Body], X_WF: NDArray[np.float64]) -> list[Body]:
    """Draw of half-spaces a plate, some times as large as all the rest, below what moves."""
    rest = [body for body in bodies if not isinstance(body.shape, HalfSpace)]
    centres = [(X_WF[0, b.frame] if b.frame >= 0 else np.eye(4)) @ b.shape.pose[:, 3] for b in rest]
    cloud = np.array(centres).reshape(-1, 4)[:, :3] if rest else np.zeros((1, 3))
    reach = max((body.shape.bounding_radius for body in rest), default=1.0)
    extent = 4.0 * (float(np.max(np.ptp(cloud, axis=0))) + 2.0 * reach)
    about = 0.5 * (cloud.min(axis=0) + cloud.max(axis=0))

    def cut(body: Body, solid: HalfSpace) -> Body:
        X = X_WF[0, body.frame] if body.frame >= 0 else np.eye(4)
        return replace(body, shape=cut_half_space(solid, X[:3, :3].T @ (about - X[:3, 3]), extent))

    return [cut(body, body.shape) if isinstance(body.shape, HalfSpace) else body for body in bodies]


def _encode(values: NDArray[np.float64]) -> str:
    """Pack numbers as base64 of little-endian 32-bit floats."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def _axis_colors() -> dict[str, str]:
    return {"x": style.VERMILLION, "y": style.GREEN, "z": style.BLUE}


def _style_variables() -> str:
    names = {
        "ink": style.INK,
        "muted": style.MUTED,
        "rule": style.RULE,
        "paper": style.PAPER,
        "surface": style.SURFACE,
        "accent": style.BLUE,
        "alert": style.VERMILLION,
    }
    return ":root { " + " ".join(f"--{name}: {color};" for name, color in names.items()) + " }\n"


def _asset(name: str) -> str:
    return (files("paraopt.view") / "assets" / name).read_text(encoding="utf-8")


def _data_url(script: str) -> str:
    return "data:text/javascript;base64," + base64.b64encode(script.encode("utf-8")).decode("ascii")


def _json_for_script(value: Any) -> str:
    """Write JSON that cannot end the script element that holds it."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _fill(template: str, parts: Mapping[str, str]) -> str:
    """Replace every `{{name}}` in one pass, so that what is filled in is not searched again."""
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match.group(1)], template)
