"""The join between a rotated lens and the stem determines the response if the lens is displaced by the rotation."""

import pytest

from solen.sensor import Sensor
from solen.spec import loads

DESIGN = """
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
def test_join_determines_the_contrast_for_a_pivot_at_the_emitter(join: str) -> None:
    response = Sensor.of(loads(f'{DESIGN}motion.join = "{join}"')).power([-3.0, 3.0])
    assert response.contrast == pytest.approx([AT_3_DEG[join], -AT_3_DEG[join]], abs=3e-4)


def test_black_join_has_nearly_the_contrast_of_a_smooth_one() -> None:
    black = Sensor.of(loads(DESIGN + BLACK)).power([-3.0])
    assert black.contrast == pytest.approx([0.951], abs=5e-4)
    assert black.contrast == pytest.approx([AT_3_DEG["smooth"]], abs=2e-3)
