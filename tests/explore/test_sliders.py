"""Responses and pictures beforehand: each point is the design with these values, and pages have a size."""

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
def found(design: Design) -> Sliders:
    over = ("emitter.offset_mm=0,0.05", "body.arm_width_mm=3,50")
    return sliders(design, SlidersOptions(over=over, drawn_rays=10))


def test_each_point_is_the_design_with_its_values(design: Design, found: Sliders) -> None:
    assert found.keys == ("emitter.offset_mm", "body.arm_width_mm")
    right, wide, moved, both = found.points
    assert wide is None, "arms of 50 mm do not part"
    assert both is None
    assert right is not None
    assert moved is not None
    exact = Sensor.of(design.set({"emitter.offset_mm": 0.05})).power(moved.curve.response.angle_deg.tolist())
    off = np.abs(moved.curve.response.contrast - exact.contrast)
    assert (off <= 4 * moved.curve.response.u_contrast + 1e-4).all()
    assert np.nanmax(found.u_contrast) <= 2e-3
    assert found.contrast[2] == pytest.approx(moved.curve.response.contrast)
    assert np.isnan(found.contrast[1]).all()
    assert len(moved.pictures) == len(exact.angle_deg)


def test_the_page_holds_the_pictures_and_asks_for_nothing(design: Design, found: Sliders) -> None:
    page = html(found)
    head = json.loads(re.findall(r'id="head">(.*?)</script>', page, re.DOTALL)[0])
    numbers = np.frombuffer(base64.b64decode(re.findall(r'id="numbers">(.*?)</script>', page)[0]), "<i2")
    first = picture(Sensor.of(design.set({"emitter.offset_mm": 0.0, "body.arm_width_mm": 3.0})), -3.0, 10)
    outline = numbers[: first.outline.size].reshape(-1, 2) * head["step_mm"]
    assert outline == pytest.approx(first.outline, abs=head["step_mm"])
    assert head["points"][1] is None
    assert head["points"][0]["contrast"] == pytest.approx(found.points[0].curve.response.contrast, abs=1e-5)  # type: ignore[union-attr]
    assert "default-src 'none'" in page
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", page)
    assert len(page) < 200_000


@pytest.mark.parametrize(
    ("over", "named"),
    [
        (("lens.focus_mm=15:25:10", "emitter.offset_mm=0:0.1:20"), "200"),
        (("lens.focus_mm=15,25", "emitter.offset_mm=0,1", "body.arm_width_mm=3,4", "body.arm_length_mm=20,21"), "4"),
        (("lens.shape=none,spline",), "lens.shape"),
        (("lens.nonsense=1,2",), "lens.nonsense"),
    ],
)
def test_sliders_that_make_no_page_are_refused(design: Design, over: tuple[str, ...], named: str) -> None:
    with pytest.raises(SpecError, match=named):
        sliders(design, SlidersOptions(over=over))


def test_a_design_that_cannot_be_built_is_refused(design: Design) -> None:
    with pytest.raises(DesignError, match=r"body\.arm_width_mm"):
        sliders(design.set({"body.arm_width_mm": 50.0}))
