"""A page with sliders that needs no server: responses and rays computed in advance, in one HTML file.

The page is built from ``web/`` in advance; this module inserts the values. Positions are 16-bit multiples of a step
that is chosen for the extent of the drawings.
"""

import base64
import json
from importlib.resources import files
from typing import Any

import numpy as np

from solen import __version__
from solen.explore.sliders import Sliders, SlidersPoint
from solen.results import plain
from solen.sensor import Picture

PAGE = files("solen.report.design") / "player.html"
DATA = "<!--data-->"
MAX_INT16 = 32_000
"""Largest multiple of the step, within the range of 16-bit integers."""


def html(sliders: Sliders) -> str:
    """Return the page for a grid of slider positions."""
    pictures = [picture for point in sliders.points if point is not None for picture in point.pictures]
    extent_mm = max(
        float(np.abs(part).max())
        for picture in pictures
        for part in (picture.outline, picture.rays[:, :4])
        if part.size
    )
    step_mm = extent_mm / MAX_INT16
    arrays: list[np.ndarray[Any, Any]] = []
    points = [None if point is None else _point(point, step_mm, arrays) for point in sliders.points]
    head = {
        "solen": __version__,
        "name": sliders.name,
        "keys": sliders.keys,
        "values": sliders.values,
        "in_space": sliders.in_space,
        "step_mm": step_mm,
        "points": points,
    }
    text = json.dumps(plain(head), allow_nan=False).replace("<", "\\u003c")
    numbers = base64.b64encode(np.concatenate(arrays).astype("<i2").tobytes()).decode("ascii")
    data = f'<script type="application/json" id="head">{text}</script><script type="text/plain" id="numbers">{numbers}'
    return PAGE.read_text(encoding="utf-8").replace(DATA, f"{data}</script>", 1)


def _point(point: SlidersPoint, step_mm: float, arrays: list[np.ndarray[Any, Any]]) -> dict[str, Any]:
    response = point.curve.response
    return {
        "angle": response.angle_deg,
        "contrast": np.round(response.contrast, 5),
        "u": np.round(response.u_contrast, 6),
        "merits": point.curve.merits,
        "misleading": point.planar_model_error,
        "pictures": [_picture(picture, step_mm, arrays) for picture in point.pictures],
    }


def _picture(picture: Picture, step_mm: float, arrays: list[np.ndarray[Any, Any]]) -> dict[str, Any]:
    """Return the header of a drawing, and append its outline, its emitter and its rays to ``arrays``."""
    rays = np.column_stack([np.round(picture.rays[:, :4] / step_mm), picture.rays[:, 5]])
    arrays += [np.round(picture.outline / step_mm).ravel(), np.round(picture.emitter / step_mm).ravel(), rays.ravel()]
    return {"faces": picture.faces, "ends": picture.ends, "rays": len(rays)}
