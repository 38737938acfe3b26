"""Both faces of a lens that varies with height: rendered images of its first and its last layer."""

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
    """Images of the first layer, mirrored and 8 µm larger, and of the last layer, 5 µm smaller; and the design."""
    folder = tmp_path_factory.mktemp("faces")
    first, last = grown(outline(0.1), 8.0), grown(outline(3.9), -5.0)
    for name, shape in (("bottom", first * [-1.0, 1.0]), ("top", last)):
        (folder / f"{name}.png").write_bytes(png(Shot(shape[:: (-1 if name == "bottom" else 1)]).taken(3)))
    (folder / "design.toml").write_text(dumps(DESIGN), encoding="utf-8")
    return folder


def inspected(folder: Path, **options: Any) -> Any:
    return inspect(folder / "top.png", design=folder / "design.toml", options=SCALE, **options).result


def test_measures_overgrowth_of_first_and_last_layer(folder: Path) -> None:
    inspection = inspected(folder, bottom=folder / "bottom.png")
    assert isinstance(inspection, FacesInspection)
    for face, overgrowth_um in ((inspection.first_layer, 8.0), (inspection.last_layer, -5.0)):
        assert face.size.overgrowth_um == pytest.approx(overgrowth_um, abs=3.0 * face.size.u_overgrowth_um)
        assert face.size.form_um < 2.0
    u = inspection.u_overgrowth_difference_um
    assert inspection.overgrowth_difference_um == pytest.approx(-13.0, abs=3.0 * u)
    assert u < 3.0
    independent = replace(inspection.last_layer, scale=replace(inspection.last_layer.scale, origin="another"))
    first, last = (face.size.u_overgrowth_um for face in (inspection.first_layer, inspection.last_layer))
    assert (
        u
        < replace(inspection, last_layer=independent).u_overgrowth_difference_um
        == pytest.approx(math.hypot(first, last))
    )


def test_face_must_be_specified_and_is_not_middle_layer(folder: Path) -> None:
    with pytest.raises(SpecError, match="--seen-from"):
        inspected(folder)
    depth = float(np.ptp(nominal_front(DESIGN, seen_from="top").front_mm[:, 1]))
    corners = outline(3.9)[np.abs(np.abs(outline(3.9)[:, 0]) - 2.0) < 1e-9]
    assert depth == pytest.approx(float(corners[:, 1].min()), abs=1e-3)
    assert depth < 1.4  # the middle layer is 1.8 mm deep


def test_rejects_options_of_one_face_with_two_images(folder: Path) -> None:
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
