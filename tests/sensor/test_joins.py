"""How a turned lens joins the stem decides the response where the lens leaves its place: about the emitter."""

import pytest

from solen.sensor import Sensor
from solen.spec import loads

TURNED = """
schema = 1
name = "join"
material.index = 1.44
emitter.width_mm = 0.2
motion.pivot = "emitter"
"""
BLACK = '\n[[wall]]\nface = "join-*"\nfinish = "black"\n'
AT_3_DEG = {"bridge": 0.9318, "seam": 0.8532, "smooth": 0.9504}
"""Contrast at -3 degrees with a chip of 0.2 mm in the plane, integrated to 1e-4."""


@pytest.mark.parametrize("join", AT_3_DEG)
def test_the_join_decides_the_contrast_about_the_emitter(join: str) -> None:
    response = Sensor.of(loads(f'{TURNED}motion.join = "{join}"')).power([-3.0, 3.0])
    assert response.contrast == pytest.approx([AT_3_DEG[join], -AT_3_DEG[join]], abs=3e-4)


def test_black_walls_at_the_join_give_nearly_what_a_smooth_one_gives() -> None:
    black = Sensor.of(loads(TURNED + BLACK)).power([-3.0])
    assert black.contrast == pytest.approx([0.951], abs=5e-4)
    assert black.contrast == pytest.approx([AT_3_DEG["smooth"]], abs=2e-3)
