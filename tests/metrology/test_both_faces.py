"""Both faces of a lens that differs by height: rendered images of its first and its last layer."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.geometry import section
from solen.metrology import InspectOptions
from solen.metrology.inspection import FacesInspection
from solen.metrology.nominal import nominal_front
from solen.pipeline.print.inspect import inspect
from solen.sensor import Sensor
from solen.spec import dumps, loads, template, with_values
from tests.metrology.inspect_support import Shot
from tests.metrology.render.camera import png
from tests.metrology.render.shape import grown

SPACE = {
    "emitter.pattern": "lambertian",
    "trace.dimension": "extruded",
    "lens.shape": "layered",
    "lens.layer_mm": 0.5,
}
DESIGN = with_values(loads(template("solen-860")), SPACE)
SCALE = InspectOptions(um_per_px=5.0)


def outline(height_mm: float) -> FloatArray:
    """Outline of the designed layer at a height above the plate."""
    return section(Sensor.of(DESIGN).body(), 0.5 * DESIGN.body.thickness_mm - height_mm).outline(1e-4)[:-1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first layer, seen mirrored, 8 µm larger; the last layer 5 µm smaller; and the design."""
    made = tmp_path_factory.mktemp("faces")
    first, last = grown(outline(0.1), 8.0), grown(outline(3.9), -5.0)
    for name, shape in (("bottom", first * [-1.0, 1.0]), ("top", last)):
        (made / f"{name}.png").write_bytes(png(Shot(shape[:: (-1 if name == "bottom" else 1)]).taken(3)))
    (made / "design.toml").write_text(dumps(DESIGN), encoding="utf-8")
    return made


def inspected(folder: Path, **more: Any) -> Any:
    return inspect(folder / "top.png", design=folder / "design.toml", options=SCALE, **more).result


def test_the_deviation_of_the_first_and_of_the_last_layer(folder: Path) -> None:
    found = inspected(folder, bottom=folder / "bottom.png")
    assert isinstance(found, FacesInspection)
    for one, grew in ((found.first_layer, 8.0), (found.last_layer, -5.0)):
        assert one.size.overgrowth_um == pytest.approx(grew, abs=3.0 * one.size.u_overgrowth_um)
        assert one.size.form_um < 2.0
    u = found.u_overgrowth_difference_um
    assert found.overgrowth_difference_um == pytest.approx(-13.0, abs=3.0 * u)
    assert u < 3.0
    apart = replace(found.last_layer, scale=replace(found.last_layer.scale, origin="another"))
    first, last = (one.size.u_overgrowth_um for one in (found.first_layer, found.last_layer))
    assert u < replace(found, last_layer=apart).u_overgrowth_difference_um == pytest.approx(math.hypot(first, last))


def test_the_face_must_be_named_and_is_not_that_of_the_middle(folder: Path) -> None:
    with pytest.raises(SpecError, match="--seen-from"):
        inspected(folder)
    depth = float(np.ptp(nominal_front(DESIGN, seen_from="top").front_mm[:, 1]))
    corners = outline(3.9)[np.abs(np.abs(outline(3.9)[:, 0]) - 2.0) < 1e-9]
    assert depth == pytest.approx(float(corners[:, 1].min()), abs=1e-3)
    assert depth < 1.4  # the middle layer is 1.8 mm deep


def test_what_is_of_one_face_is_refused_for_two(folder: Path) -> None:
    bottom = folder / "bottom.png"
    (folder / "again.png").write_bytes((folder / "top.png").read_bytes())
    with pytest.raises(DataError, match=r"again\.png.*top\.png"):
        inspected(folder, bottom=folder / "again.png")
    with pytest.raises(SpecError, match="--out"):
        inspected(folder, bottom=bottom, out=folder / "a.json")
    with pytest.raises(SpecError, match="--seen-from"):
        inspect(
            folder / "top.png",
            design=folder / "design.toml",
            bottom=bottom,
            options=SCALE.model_copy(update={"seen_from": "top"}),
        )
    with pytest.raises(SpecError, match="--out"):
        inspect(
            folder / "top.png",
            design=folder / "design.toml",
            options=SCALE.model_copy(update={"seen_from": "top"}),
            out=folder / "a.json",
        )
