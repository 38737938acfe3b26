"""Poor micrographs: each is measured within its stated uncertainty, or rejected with a one-line reason."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from solen.errors import SolenError
from solen.metrology import InspectOptions
from solen.pipeline.print.inspect import inspect
from tests.command_support import refusal
from tests.metrology.damaged_support import png_claiming
from tests.metrology.inspect_support import Shot, design_file, inspected, lens
from tests.metrology.render.camera import Camera, coloured, jpeg, png
from tests.metrology.render.optics import defocus
from tests.metrology.render.scenery import dust, fibres, glare_at, gradient, scratches

SHOT = Shot(lens(), um_per_px=8.0)
LIGHT = gradient(0.3, 25.0)

SLOW = {"much noise", "out of focus", "half of the lens", "far out of focus", "saturated", "a scale 5 % too large"}


def quick_or_evidence(name: str) -> Any:
    """A case of the tables; slow ones run only in ``make evidence``."""
    return pytest.param(name, marks=pytest.mark.evidence) if name in SLOW else name


MEASURED = {
    "glare on the edge": replace(SHOT, scenery=[LIGHT, glare_at(190, 250, 16, 0.9), glare_at(380, 210, 18, 0.9)]),
    "dust, fibres, scratches": replace(
        SHOT, scenery=[LIGHT, dust(30, 6, -0.9), fibres(4, 150, 3, -0.7), scratches(8, 150, 2, 0.8)]
    ),
    "low contrast": replace(SHOT, step=0.07),
    "half of the lens": replace(SHOT, vertex_um=(300.0, 2350.0)),
    "out of focus": replace(SHOT, optics=defocus(6.0)),
    "much noise": replace(SHOT, camera=Camera(noise=0.1)),
}


@pytest.mark.parametrize("name", [*map(quick_or_evidence, MEASURED)])
def test_perfect_print_in_poor_image_has_no_deviation(name: str, tmp_path: Path) -> None:
    result = inspected(tmp_path, MEASURED[name], 3)
    deviation = result["deviation"]
    assert deviation["rms_um"] < 3.0 * deviation["u_rms_um"]
    tolerance_um = 0.5 * 8.0 if "dust" in name else 0.0  # dust that moves an edge by less than 0.5 px is not detected
    assert deviation["interval95_max_um"][0] - tolerance_um <= 0.0 <= deviation["interval95_max_um"][1] + tolerance_um
    assert result["nearest"] == "n = 1.44"
    assert (result["seen"] < 0.99) == (name == "half of the lens")
    assert any("56%" in warning for warning in result["warnings"]) or name != "half of the lens"


REJECTED: dict[str, tuple[Shot, dict[str, Any], str]] = {
    "a tenth of the lens": (replace(SHOT, vertex_um=(-1500.0, 2350.0)), {}, "shows .* of the front; at least"),
    "no lens": (replace(SHOT, step=0.0, scenery=[LIGHT, dust(30, 8, -0.8)]), {}, "shows no lens"),
    "blank": (replace(SHOT, step=0.0, scenery=[], camera=Camera(noise=0.0)), {}, "shows no lens"),
    "far out of focus": (replace(SHOT, optics=defocus(25.0)), {}, "shows no lens"),
    "a scale ten times too large": (SHOT, {"um_per_px": 80.0}, "pixels wide; at least"),
    "a scale ten times too small": (SHOT, {"um_per_px": 0.8}, "lower magnification"),
    "a scale twice too large": (SHOT, {"um_per_px": 16.0}, "check --um-per-px"),
    "no scale": (SHOT, {"um_per_px": None}, "pixel size.*--um-per-px"),
}


@pytest.mark.parametrize("name", [*map(quick_or_evidence, REJECTED)])
def test_rejects_image_with_reason(name: str, tmp_path: Path) -> None:
    shot, options, why = REJECTED[name]
    with pytest.raises(SolenError, match=why) as error:
        inspected(tmp_path, shot, 3, **options)
    assert "image.png" in str(error.value)


WARNED: dict[str, tuple[Shot, dict[str, Any], str]] = {
    "tilted by 10°": (replace(SHOT, tilt_deg=10.0), {}, "it was tilted"),
    "a scale 5 % too large": (SHOT, {"um_per_px": 8.4}, "the scale is wrong"),
    "saturated": (replace(SHOT, scenery=[gradient(0.9, 90.0)]), {}, "is saturated"),
}


@pytest.mark.parametrize("name", [*map(quick_or_evidence, WARNED)])
def test_warns_of_what_image_cannot_show(name: str, tmp_path: Path) -> None:
    shot, options, part = WARNED[name]
    result = inspected(tmp_path, shot, 3, **options)
    assert any(part in warning for warning in result["warnings"])


def test_recognises_another_design(tmp_path: Path) -> None:
    result = inspected(tmp_path, replace(SHOT, outline=lens("solen-450")), 3, design="solen-860")
    assert result["nearest"] == "n = 1.54"
    assert result["deviation"]["rms_um"] > 40.0  # µm; the two curves are 53 µm apart after the best registration


FORMS: dict[str, tuple[str, Callable[[Any], bytes]]] = {
    "compressed": ("image.jpg", lambda levels: jpeg(levels, 70)),
    "coloured": ("coloured.png", lambda levels: png(coloured(levels))),
}


@pytest.mark.parametrize("form", FORMS)
def test_photograph_needs_scale_and_is_measured_with_warning(form: str, tmp_path: Path) -> None:
    name, written = FORMS[form]
    image = tmp_path / name
    image.write_bytes(written(SHOT.taken(4)))
    design = design_file(tmp_path)
    with pytest.raises(SolenError, match="does not specify the pixel size"):
        inspect(image, design=design)
    result = inspect(image, design=design, options=InspectOptions(um_per_px=8.0)).to_dict()
    deviation = result["deviation"]
    assert deviation["rms_um"] < 3.0 * deviation["u_rms_um"]
    part = "lossy" if form == "compressed" else "coloured"
    assert any(part in warning for warning in result["warnings"])


def test_command_rejects_large_image_and_writes_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    design = str(design_file(tmp_path))
    image, out = tmp_path / "large.png", tmp_path / "lens.json"
    image.write_bytes(png_claiming(30_000, 30_000))
    arguments = (str(image), "--design", design, "--um-per-px", "2", "--out", str(out), "--json")
    assert "megapixels" in refusal(capfd, tmp_path, "print", "inspect", *arguments)
