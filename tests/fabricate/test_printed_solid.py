"""The solid that the model prints: one closed body, as wide at every height as straight walls are said to be."""

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.optimize import brentq
from scipy.special import ndtr

from solen.errors import DataError
from solen.fabricate.process import PrintedDesign, PrintOptions, Settings, default_process, printed_solid
from solen.fabricate.process.solid import SLAB_UM, slabs
from solen.fabricate.process.terms import terms_at
from solen.pipeline.print.predict import predict
from solen.spec import template
from tests.fabricate.test_printed_command import sure

SIDE_MM, THICK_MM = 3.0, 0.5
SQUARE = np.array([[0.0, 0.0], [SIDE_MM, 0.0], [SIDE_MM, SIDE_MM], [0.0, SIDE_MM]]) + 0.25


def settings(**more: float) -> Settings:
    plain = {"shrinkage_percent": 0.0, "shrinkage_z_percent": 0.0, "pixel_um": 50.0, "sigma_um": 25.0}
    return default_process().with_settings(**plain | more).process


def opened(**more: float) -> trimesh.Trimesh:
    mesh, _ = printed_solid([SQUARE], settings(**more), THICK_MM, (1.75, 1.75), "square")
    return trimesh.Trimesh(mesh.vertices, mesh.triangles, process=True)


def edge_um(settings: Settings, height_um: float) -> float:
    """Where a long wall stands whose image ends between two pixels: the root of the doses over the error function."""
    terms = terms_at(settings, 20, height_um)
    blurred = lambda x: float(terms.dose @ ndtr(-x / terms.sigma_um)) - settings.Ec_mJ_per_cm2  # noqa: E731
    return float(brentq(blurred, -500.0, 500.0))


def test_it_is_one_closed_body_as_wide_as_its_walls_are_said_to_be() -> None:
    found = opened()
    assert found.is_watertight
    assert found.body_count == 1
    assert found.extents[2] == pytest.approx(THICK_MM)
    for slab in slabs(settings(), 20):
        height = (slab.middle + 0.5) * 0.025
        cut = found.section(plane_origin=[0, 0, height], plane_normal=[0, 0, 1])
        across = cut.vertices[np.abs(cut.vertices[:, 1] - 1.75) < 0.8]
        grown_um = 1e3 * 0.5 * (np.ptp(across[:, 0]) - SIDE_MM)
        assert grown_um == pytest.approx(edge_um(settings(), 1e3 * height), abs=1.0)


def test_slabs_hold_all_layers_once_and_walls_alike() -> None:
    cut = slabs(settings(), 160)
    assert [slab.first for slab in cut[1:]] == [slab.last + 1 for slab in cut[:-1]]
    assert (cut[0].first, cut[-1].last) == (0, 159)
    assert max(slab.last - slab.first for slab in cut) > 60  # the inside is one
    assert 2 < len(cut) < 60
    assert SLAB_UM == 1.0


def test_shrinkage_washing_and_a_hole() -> None:
    wide, whole = opened(), opened(shrinkage_percent=2.0, shrinkage_z_percent=4.0)
    assert whole.extents / wide.extents == pytest.approx([0.98, 0.98, 0.96], abs=1e-4)
    washed = opened(wash_um=-20.0)
    assert 1e3 * (wide.extents - washed.extents)[:2] == pytest.approx([40.0, 40.0], abs=0.5)
    hole = (0.4 * (SQUARE - 1.75) + 1.75)[::-1]
    mesh, _ = printed_solid([SQUARE, hole], settings(), THICK_MM, (1.75, 1.75), "frame")
    assert mesh.volume_mm3 < wide.volume - 0.8 * (0.4 * SIDE_MM) ** 2 * THICK_MM * 0.9


def test_what_does_not_set_is_reported() -> None:
    with pytest.raises(DataError):
        opened(exposure_s=1e-3)


def test_the_command_s_solid_is_the_sensor(tmp_path: Path) -> None:
    design, target = tmp_path / "sensor.toml", tmp_path / "printed.stl"
    design.write_text(template("paper-860"), encoding="utf-8")
    thin = ["body.thickness_mm=0.1"]
    found = predict(
        design, options=PrintOptions(process=sure(tmp_path)), set_=thin, solid=target, response=False
    ).result
    mesh = trimesh.load(io.BytesIO(target.read_bytes()), file_type="stl")
    assert mesh.is_watertight
    assert isinstance(found, PrintedDesign)
    assert found.part is not None
    assert mesh.volume == pytest.approx(found.part.printed_mm3, rel=1e-5)
    assert found.part.printed_mm3 == pytest.approx(found.part.designed_mm3, rel=0.05)
    assert b"simulated" in target.read_bytes()[:80]
