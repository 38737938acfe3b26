"""The printed solid is closed, and its walls agree with the closed form of straight walls."""

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.optimize import brentq
from scipy.special import ndtr

from solen.errors import DataError
from solen.fabricate.process import PrintedDesign, PrintOptions, Settings, default_process, printed_solid
from solen.fabricate.process.solid import slabs
from solen.fabricate.process.terms import terms_at
from solen.pipeline.print.predict import predict
from solen.spec import template
from tests.fabricate.print_support import process_file

SIDE_MM, THICKNESS_MM = 3.0, 0.5
SQUARE = np.array([[0.0, 0.0], [SIDE_MM, 0.0], [SIDE_MM, SIDE_MM], [0.0, SIDE_MM]]) + 0.25


def settings(**values: float) -> Settings:
    defaults = {"shrinkage_percent": 0.0, "shrinkage_z_percent": 0.0, "pixel_um": 50.0, "sigma_um": 25.0}
    return default_process().with_settings(**defaults | values).process


def printed_square(**values: float) -> trimesh.Trimesh:
    mesh, _ = printed_solid([SQUARE], settings(**values), THICKNESS_MM, (1.75, 1.75), "square")
    return trimesh.Trimesh(mesh.vertices, mesh.triangles, process=True)


def edge_um(settings: Settings, height_um: float) -> float:
    """Return the position of a straight wall whose image ends between two pixels, where the dose is critical."""
    terms = terms_at(settings, 20, height_um)

    def excess(x: float) -> float:
        return float(terms.dose @ ndtr(-x / terms.sigma_um)) - settings.Ec_mJ_per_cm2

    return float(brentq(excess, -500.0, 500.0))


@pytest.fixture(scope="module")
def square() -> trimesh.Trimesh:
    return printed_square()


def test_a_printed_square_is_closed_and_has_the_expected_walls(square: trimesh.Trimesh) -> None:
    assert square.is_watertight
    assert square.body_count == 1
    assert square.extents[2] == pytest.approx(THICKNESS_MM)
    for slab in slabs(settings(), 20):
        height = (slab.middle + 0.5) * 0.025
        vertices = square.section(plane_origin=[0, 0, height], plane_normal=[0, 0, 1]).vertices
        sides = vertices[np.abs(vertices[:, 1] - 1.75) < 0.8]
        growth_um = 1e3 * 0.5 * (np.ptp(sides[:, 0]) - SIDE_MM)
        assert growth_um == pytest.approx(edge_um(settings(), 1e3 * height), abs=1.0)


def test_slabs_contain_each_layer_once() -> None:
    parts = slabs(settings(), 160)
    assert [slab.first for slab in parts[1:]] == [slab.last + 1 for slab in parts[:-1]]
    assert (parts[0].first, parts[-1].last) == (0, 159)
    assert max(slab.last - slab.first for slab in parts) > 60, "the inside is a single slab"
    assert 2 < len(parts) < 60


def test_shrinkage_washing_and_a_hole(square: trimesh.Trimesh) -> None:
    shrunk = printed_square(shrinkage_percent=2.0, shrinkage_z_percent=4.0)
    assert shrunk.extents / square.extents == pytest.approx([0.98, 0.98, 0.96], abs=1e-4)
    washed = printed_square(wash_um=-20.0)
    assert 1e3 * (square.extents - washed.extents)[:2] == pytest.approx([40.0, 40.0], abs=0.5)
    hole = (0.4 * (SQUARE - 1.75) + 1.75)[::-1]
    mesh, _ = printed_solid([SQUARE, hole], settings(), THICKNESS_MM, (1.75, 1.75), "frame")
    assert mesh.volume_mm3 < square.volume - 0.8 * (0.4 * SIDE_MM) ** 2 * THICKNESS_MM * 0.9


def test_refuses_a_part_that_does_not_cure() -> None:
    with pytest.raises(DataError):
        printed_square(exposure_s=1e-3)


def test_the_command_writes_the_printed_solid(tmp_path: Path) -> None:
    design, target = tmp_path / "sensor.toml", tmp_path / "printed.stl"
    design.write_text(template("paper-860"), encoding="utf-8")
    options = PrintOptions(process=process_file(tmp_path))
    result = predict(design, options=options, set_=["body.thickness_mm=0.1"], solid=target, response=False).result
    mesh = trimesh.load(io.BytesIO(target.read_bytes()), file_type="stl")
    assert mesh.is_watertight
    assert isinstance(result, PrintedDesign)
    assert result.part is not None
    assert mesh.volume == pytest.approx(result.part.printed_mm3, rel=1e-5)
    assert result.part.printed_mm3 == pytest.approx(result.part.designed_mm3, rel=0.05)
    assert b"simulated" in target.read_bytes()[:80]
