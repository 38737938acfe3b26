"""What lenses for space promise, with a chip: by the engine, by brute force of its own, and by figures.

The figures are those of a prototype, a third tracer.
"""

import math
from dataclasses import replace

import pytest

from solen.sensor import Sensor
from solen.trace import Trace
from tests.agreement import brute_force_support as brute
from tests.agreement.lens_support import LAYERED, LINE, contrast, light, sampled, sensor, u_contrast

LENSES: dict[str, tuple[dict[str, object], brute.Shape]] = {
    "line-focus": (LINE, brute.LineFocus(2.0)),
    "layered": (LAYERED, brute.Layers(0.025)),
}
AS_DESIGNED: dict[str, object] = {"lens.design_index": 1.44}


def agree(found: Trace, plain: brute.Found, what: str = "") -> None:
    """Contrast, light and leaks within three standard errors of both."""
    stated = {
        "contrast": (contrast(found), u_contrast(found), *plain.contrast),
        "light": (light(found), 2.0 * found.u_power, *plain.light),
        "leaked": (found.leaked, found.u_leaked, *plain.mean(plain.leaked)),
    }
    for name, (value, u, other, u_other) in stated.items():
        print(f"{what} {name:9} engine {value:.4f} ± {u:.4f}, brute force {other:.4f} ± {u_other:.4f}")
        assert value == pytest.approx(other, abs=3.0 * math.hypot(u, u_other)), name
    assert plain.lost.mean() < 3e-4


@pytest.mark.parametrize("name", LENSES)
def test_brute_force_agrees(name: str) -> None:
    lens, shape = LENSES[name]
    agree(sampled(sensor(lens)), brute.Sensor(shape, -1.0).traced(2**12))


def test_brute_force_agrees_on_the_cylinder() -> None:
    agree(sampled(sensor()), brute.Sensor(brute.Layers(4.0), -1.0).traced(2**11))


@pytest.mark.evidence
@pytest.mark.parametrize(("angle_deg", "value"), [(-1.0, 0.278), (-3.0, 0.653)])
def test_integrals_of_the_cylinder_are_those_of_two_million_rays_by_brute_force(angle_deg: float, value: float) -> None:
    found, plain = sensor().integrate(angle_deg), brute.Sensor(brute.Layers(4.0), angle_deg).traced(2**21)
    agree(found, plain, f"cylinder at {angle_deg:g}°:")
    assert contrast(found) == pytest.approx(value, abs=1e-3)
    assert plain.contrast[0] == pytest.approx(value, abs=1e-3)


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("name", "contrasts", "received"),
    [
        ("line-focus", (0.244, 0.474, 0.933), 0.657),
        ("layered", (0.229, 0.440, 0.906), 0.636),  # of the light the prototype had 0.632
    ],
)
def test_brute_force_gives_the_promised_figures(name: str, contrasts: tuple[float, ...], received: float) -> None:
    """Half a million rays each; both tracers within 0.003 of the figures, and the brute force to 0.001."""
    lens, shape = LENSES[name]
    for angle_deg, value in zip((0.5, 1.0, 3.0), contrasts, strict=True):
        found, plain = sampled(sensor(lens), -angle_deg, 2**19), brute.Sensor(shape, -angle_deg).traced(2**19)
        agree(found, plain, f"{name} at {angle_deg:g}°:")
        assert max(plain.contrast[1], plain.light[1]) <= 1e-3
        assert (contrast(found), plain.contrast[0]) == pytest.approx((value, value), abs=3e-3)
        assert (light(found), plain.light[0]) == pytest.approx((received, received), abs=3e-3)


def test_what_the_prototype_gave() -> None:
    for name, contrasts in (("line-focus", (0.244, 0.474, 0.933)), ("layered", (0.229, 0.440, 0.906))):
        made = sensor(LENSES[name][0])
        found = [contrast(sampled(made, -angle_deg, 2**17)) for angle_deg in (0.5, 1.0, 3.0)]
        assert found == pytest.approx(contrasts, abs=3e-3)


def test_a_point_is_taken_to_the_line() -> None:
    point = {"emitter.width_mm": 0.0, "emitter.height_mm": 0.0}
    assert contrast(sampled(sensor(LINE, **point))) >= 0.999
    assert contrast(sampled(sensor(**point))) == pytest.approx(0.543, abs=0.01)


TOLERANCES: dict[str, tuple[dict[str, object], float, float, tuple[float, float, float]]] = {
    "n = 1.45": (AS_DESIGNED | {"material.index": 1.45}, 0.481, 1.45, (0.0, 0.0, 0.0)),
    "n = 1.43": (AS_DESIGNED | {"material.index": 1.43}, 0.423, 1.43, (0.0, 0.0, 0.0)),
    "0.1 mm off in y": ({"emitter.y_mm": 0.1}, 0.452, 1.44, (0.0, 0.1, 0.0)),
    "0.2 mm off in y": ({"emitter.y_mm": -0.2}, 0.398, 1.44, (0.0, -0.2, 0.0)),
    "0.02 mm off in x": ({"emitter.offset_mm": 0.02}, 0.299, 1.44, (0.02, 0.0, 0.0)),
    "0.1 mm nearer": ({"emitter.distance_mm": 0.9}, 0.425, 1.44, (0.0, 0.0, 0.1)),
    "0.1 mm farther": ({"emitter.distance_mm": 1.1}, 0.503, 1.44, (0.0, 0.0, -0.1)),
}
"""What is off with a line focus: values of the design, the prototype's contrast at 1°, index, place of the emitter."""


def off(what: str) -> Sensor:
    """The lens is cut for an emitter at 1 mm."""
    return replace(sensor(LINE, **TOLERANCES[what][0]), cut=sensor(LINE).lens)


@pytest.mark.parametrize("what", TOLERANCES)
def test_tolerances_of_a_line_focus(what: str) -> None:
    assert contrast(sampled(off(what))) == pytest.approx(TOLERANCES[what][1], abs=5e-3)


@pytest.mark.evidence
@pytest.mark.parametrize("what", TOLERANCES)
def test_brute_force_gives_the_tolerances(what: str) -> None:
    _, value, index, at = TOLERANCES[what]
    plain = brute.Sensor(brute.LineFocus(2.0), -1.0, index, at).traced(2**18)
    agree(sampled(off(what), rays=2**18), plain, f"{what}:")
    assert plain.contrast[0] == pytest.approx(value, abs=5e-3)
