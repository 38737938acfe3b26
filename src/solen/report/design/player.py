"""A page with sliders that needs no server: responses and rays that were computed in advance, in one HTML file.

The page is built from ``web/`` in advance; this module inserts the values. Positions are integer multiples of a step
that spans the whole drawing.
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
"""Largest signed 16-bit number."""


def html(found: Sliders) -> str:
    """Return the page for a grid of slider positions."""
    pictures = [picture for point in found.points if point is not None for picture in point.pictures]
    reach = max(
        float(np.abs(part).max())
        for picture in pictures
        for part in (picture.outline, picture.rays[:, :4])
        if part.size
    )
    whole: list[np.ndarray[Any, Any]] = []
    points = [None if point is None else _point(point, reach / MAX_INT16, whole) for point in found.points]
    head = {
        "solen": __version__,
        "name": found.name,
        "keys": found.keys,
        "values": found.values,
        "in_space": found.in_space,
        "step_mm": reach / MAX_INT16,
        "points": points,
    }
    text = json.dumps(plain(head), allow_nan=False).replace("<", "\\u003c")
    numbers = base64.b64encode(np.concatenate(whole).astype("<i2").tobytes()).decode("ascii")
    data = f'<script type="application/json" id="head">{text}</script><script type="text/plain" id="numbers">{numbers}'
    return PAGE.read_text(encoding="utf-8").replace(DATA, f"{data}</script>", 1)


def _point(point: SlidersPoint, step_mm: float, whole: list[np.ndarray[Any, Any]]) -> dict[str, Any]:
    response = point.curve.response
    return {
        "angle": response.angle_deg,
        "contrast": np.round(response.contrast, 5),
        "u": np.round(response.u_contrast, 6),
        "merits": point.curve.merits,
        "misleading": point.planar_model_error,
        "pictures": [_picture(picture, step_mm, whole) for picture in point.pictures],
    }


def _picture(one: Picture, step_mm: float, whole: list[np.ndarray[Any, Any]]) -> dict[str, Any]:
    """Return the header of a drawing (outline, emitter, rays with their ends) and add its values to the others."""
    rays = np.column_stack([np.round(one.rays[:, :4] / step_mm), one.rays[:, 5]])
    whole += [np.round(one.outline / step_mm).ravel(), np.round(one.emitter / step_mm).ravel(), rays.ravel()]
    return {"faces": one.faces, "ends": one.ends, "rays": len(rays)}
