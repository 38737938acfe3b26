"""Micrographs as they come: each is measured within what is stated, or refused in one line that says why."""

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

LONG = {"much noise", "out of focus", "half of the lens", "far out of focus", "saturated", "a scale 5 % too large"}


def quick_or_evidence(name: str) -> Any:
    """A case of the tables; some are left to ``make evidence``."""
    return pytest.param(name, marks=pytest.mark.evidence) if name in LONG else name


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
def test_a_perfect_print_in_a_poor_image_is_no_deviation(name: str, tmp_path: Path) -> None:
    found = inspected(tmp_path, MEASURED[name], 3)
    off = found["deviation"]
    assert off["rms_um"] < 3.0 * off["u_rms_um"]
    slack_um = 0.5 * 8.0 if "dust" in name else 0.0  # what lies on an edge and moves it by less than 0.5 px is not seen
    assert off["interval95_max_um"][0] - slack_um <= 0.0 <= off["interval95_max_um"][1] + slack_um
    assert found["nearest"] == "n = 1.44"
    assert (found["seen"] < 0.99) == (name == "half of the lens")
    assert any("56%" in warning for warning in found["warnings"]) or name != "half of the lens"


REFUSED: dict[str, tuple[Shot, dict[str, Any], str]] = {
    "a tenth of the lens": (replace(SHOT, vertex_um=(-1500.0, 2350.0)), {}, "shows .* of the front; at least"),
    "no lens": (replace(SHOT, step=0.0, scenery=[LIGHT, dust(30, 8, -0.8)]), {}, "shows no lens"),
    "blank": (replace(SHOT, step=0.0, scenery=[], camera=Camera(noise=0.0)), {}, "shows no lens"),
    "far out of focus": (replace(SHOT, optics=defocus(25.0)), {}, "shows no lens"),
    "a scale ten times too large": (SHOT, {"um_per_px": 80.0}, "pixels wide; at least"),
    "a scale ten times too small": (SHOT, {"um_per_px": 0.8}, "magnify less"),
    "a scale twice too large": (SHOT, {"um_per_px": 16.0}, "check --um-per-px"),
    "no scale": (SHOT, {"um_per_px": None}, "pixel size.*--um-per-px"),
}


@pytest.mark.parametrize("name", [*map(quick_or_evidence, REFUSED)])
def test_an_image_that_shows_too_little_is_refused_with_the_reason(name: str, tmp_path: Path) -> None:
    shot, options, why = REFUSED[name]
    with pytest.raises(SolenError, match=why) as refused:
        inspected(tmp_path, shot, 3, **options)
    assert "image.png" in str(refused.value)


DOUBTED: dict[str, tuple[Shot, dict[str, Any], str]] = {
    "tilted by 10°": (replace(SHOT, tilt_deg=10.0), {}, "it was tilted"),
    "a scale 5 % too large": (SHOT, {"um_per_px": 8.4}, "the scale is wrong"),
    "saturated": (replace(SHOT, scenery=[gradient(0.9, 90.0)]), {}, "is saturated"),
}


@pytest.mark.parametrize("name", [*map(quick_or_evidence, DOUBTED)])
def test_what_cannot_be_concluded_is_said(name: str, tmp_path: Path) -> None:
    shot, options, words = DOUBTED[name]
    found = inspected(tmp_path, shot, 3, **options)
    assert any(words in warning for warning in found["warnings"])


def test_another_design_is_recognised_by_its_name_and_its_distance(tmp_path: Path) -> None:
    found = inspected(tmp_path, replace(SHOT, outline=lens("solen-450")), 3, design="solen-860")
    assert found["nearest"] == "n = 1.54"
    assert found["deviation"]["rms_um"] > 40.0  # µm; the two curves, each laid best on the other, are 53 µm apart


FORMS: dict[str, tuple[str, Callable[[Any], bytes]]] = {
    "compressed": ("image.jpg", lambda levels: jpeg(levels, 70)),
    "coloured": ("coloured.png", lambda levels: png(coloured(levels))),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_photograph_needs_its_scale_and_is_measured_with_a_caution(form: str, tmp_path: Path) -> None:
    name, written = FORMS[form]
    image = tmp_path / name
    image.write_bytes(written(SHOT.taken(4)))
    design = design_file(tmp_path)
    with pytest.raises(SolenError, match="does not specify the pixel size"):
        inspect(image, design=design)
    found = inspect(image, design=design, options=InspectOptions(um_per_px=8.0)).to_dict()
    off = found["deviation"]
    assert off["rms_um"] < 3.0 * off["u_rms_um"]
    words = "lossy" if form == "compressed" else "coloured"
    assert any(words in warning for warning in found["warnings"])


def test_the_command_refuses_in_one_line_with_exit_code_2_and_writes_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    design = str(design_file(tmp_path))
    image, out = tmp_path / "large.png", tmp_path / "lens.json"
    image.write_bytes(png_claiming(30_000, 30_000))
    arguments = (str(image), "--design", design, "--um-per-px", "2", "--out", str(out), "--json")
    assert "megapixels" in refusal(capfd, tmp_path, "print", "inspect", *arguments)
