"""Responses and pictures computed in advance for a page with sliders."""

import base64
import json
import re

import numpy as np
import pytest

from solen.errors import DesignError, SpecError
from solen.explore.sliders import Sliders, SlidersOptions, sliders
from solen.report.design.player import html
from solen.sensor import Sensor, picture
from solen.spec import Design, loads, template


@pytest.fixture(scope="module")
def design() -> Design:
    return loads(template("solen-860")).set({"trace.dimension": "2d", "motion.step_deg": 1.5})


@pytest.fixture(scope="module")
def result(design: Design) -> Sliders:
    over = ("emitter.offset_mm=0,0.05", "body.arm_width_mm=3,50")
    return sliders(design, SlidersOptions(over=over, drawn_rays=10))


def test_points_agree_with_integration(design: Design, result: Sliders) -> None:
    assert result.keys == ("emitter.offset_mm", "body.arm_width_mm")
    initial, wide_arms, shifted, both = result.points
    assert wide_arms is None, "arms of 50 mm do not separate"
    assert both is None
    assert initial is not None
    assert shifted is not None
    exact = Sensor.of(design.set({"emitter.offset_mm": 0.05})).power(shifted.curve.response.angle_deg.tolist())
    difference = np.abs(shifted.curve.response.contrast - exact.contrast)
    assert (difference <= 4 * shifted.curve.response.u_contrast + 1e-4).all()
    assert np.nanmax(result.u_contrast) <= 2e-3
    assert result.contrast[2] == pytest.approx(shifted.curve.response.contrast)
    assert np.isnan(result.contrast[1]).all()
    assert len(shifted.pictures) == len(exact.angle_deg)


def test_page_contains_pictures_and_loads_nothing(design: Design, result: Sliders) -> None:
    page = html(result)
    head = json.loads(re.findall(r'id="head">(.*?)</script>', page, re.DOTALL)[0])
    numbers = np.frombuffer(base64.b64decode(re.findall(r'id="numbers">(.*?)</script>', page)[0]), "<i2")
    first = picture(Sensor.of(design.set({"emitter.offset_mm": 0.0, "body.arm_width_mm": 3.0})), -3.0, 10)
    outline = numbers[: first.outline.size].reshape(-1, 2) * head["step_mm"]
    assert outline == pytest.approx(first.outline, abs=head["step_mm"])
    assert head["points"][1] is None
    assert head["points"][0]["contrast"] == pytest.approx(result.points[0].curve.response.contrast, abs=1e-5)  # type: ignore[union-attr]
    assert "default-src 'none'" in page
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", page)
    assert len(page) < 200_000


@pytest.mark.parametrize(
    ("over", "reason"),
    [
        (("lens.focus_mm=15:25:10", "emitter.offset_mm=0:0.1:20"), "200"),
        (("lens.focus_mm=15,25", "emitter.offset_mm=0,1", "body.arm_width_mm=3,4", "body.arm_length_mm=20,21"), "4"),
        (("lens.shape=none,spline",), "lens.shape"),
        (("lens.nonsense=1,2",), "lens.nonsense"),
    ],
)
def test_refuses_invalid_sliders(design: Design, over: tuple[str, ...], reason: str) -> None:
    with pytest.raises(SpecError, match=reason):
        sliders(design, SlidersOptions(over=over))


def test_refuses_impossible_design(design: Design) -> None:
    with pytest.raises(DesignError, match=r"body\.arm_width_mm"):
        sliders(design.set({"body.arm_width_mm": 50.0}))
