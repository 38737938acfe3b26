"""Comparison of lenses with made-up responses: any motion about any null, and gains with uncertainties."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DesignError
from solen.lens import LayeredLens, LayerProfiles, layers_text
from solen.sensor import LensChoice, LensFigures, Response, Sensor
from solen.sensor.lens_choice import lens_choice
from solen.spec import loads, template, with_values

SLOPES = {"cartesian-oval": -0.1, "layered": -0.15, "line-focus": -0.16}
"""Slopes of linear responses, per degree."""
U_POWER = 1e-3

Curve = Callable[[str, float], float]


def sensor(**values: Any) -> Sensor:
    """The template, which has a chip and is in space; ``__`` stands for the dot of a key."""
    return Sensor.of(with_values(loads(template()), {key.replace("__", "."): value for key, value in values.items()}))


def response(contrasts: Sequence[float], angles: Sequence[float]) -> Response:
    contrast = np.array(contrasts)
    right, left = 0.25 * (1.0 + contrast), 0.25 * (1.0 - contrast)
    return Response("power", np.array(angles), right, left, np.full(len(angles), U_POWER), ())


def compared(base_sensor: Sensor, null_deg: float, angles: Sequence[float], curve: Curve | None = None) -> LensChoice:
    """The choice for a sensor whose lenses have linear responses about its null, or the responses of a curve."""

    def value(shape: str, angle: float) -> float:
        return SLOPES[shape] * (angle - null_deg) if curve is None else curve(shape, angle)

    def made_up_response(traced_sensor: Sensor, angles_deg: Sequence[float], *_: object) -> Response:
        return response([value(traced_sensor.design.lens.shape, angle) for angle in angles_deg], angles_deg)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("solen.sensor.lens_choice.response_at", made_up_response)
        return lens_choice(base_sensor, made_up_response(base_sensor, angles), null_deg)


@pytest.fixture(scope="module")
def decentred() -> Sensor:
    return sensor(emitter__offset_mm=0.1)


@pytest.mark.parametrize("null_deg", [-2.8, 0.1, 1.7])
def test_decentred_design_is_compared_about_its_null(decentred: Sensor, null_deg: float) -> None:
    choice = compared(decentred, null_deg, (-3.0, 0.0, 3.0))
    assert (len(choice.lenses), choice.skipped) == (3, {})
    for lens in choice.lenses:
        low, high = (3.0 + null_deg) / 6.0, (3.0 - null_deg) / 6.0
        assert lens.slope_per_deg == pytest.approx(SLOPES[lens.shape])
        assert lens.u_slope_per_deg == pytest.approx(2.0 * (2.0 * U_POWER / 0.5) / (low + high))
        assert lens.within_deg == pytest.approx(0.5 * (low + high))
        assert lens.nonlinearity == pytest.approx(0.0, abs=1e-12)
        assert lens.off_deg - null_deg == pytest.approx(2.0 * max(low, high) * (1.0 if null_deg < 0.0 else -1.0))
    assert choice.gain == pytest.approx(1.5)


def test_asymmetric_motion_is_compared() -> None:
    mirrored = compared(sensor(motion__from_deg=-1.0), 0.0, (-1.0, 0.0, 3.0))
    figures = mirrored.of("layered")
    assert figures is not None
    assert figures.angle_deg.tolist() == pytest.approx([-1.0, -1 / 2, -1 / 3, -1 / 6])
    assert (figures.slope_per_deg, figures.within_deg) == pytest.approx((-0.15, 1 / 6))
    asymmetric = compared(sensor(motion__from_deg=-1.0, emitter__offset_mm=0.02), -0.5, (-1.0, 0.0, 3.0))
    assert [lens.slope_per_deg for lens in asymmetric.lenses] == pytest.approx(list(SLOPES.values()))


def test_symmetric_design_is_mirrored_about_0_and_not_its_interpolated_null() -> None:
    choice = compared(sensor(), 0.01, (-3.0, -0.5, 0.6, 3.0), lambda shape, angle: SLOPES[shape] * angle)
    assert [lens.slope_per_deg for lens in choice.lenses] == pytest.approx(list(SLOPES.values()))
    assert [lens.nonlinearity for lens in choice.lenses] == pytest.approx([0.0] * 3, abs=1e-12)


@pytest.mark.parametrize(
    ("null_deg", "angles", "message"),
    [
        (-3.0, (-3.0, 0.0, 3.0), "begins or ends at the null"),
        (3.0, (-3.0, 0.0, 3.0), "begins or ends at the null"),
        (0.0, (0.0,), "does not extend beyond the null"),
    ],
)
def test_refuses_one_side_of_an_asymmetric_design(
    decentred: Sensor, null_deg: float, angles: tuple[float, ...], message: str
) -> None:
    with pytest.raises(DesignError, match=message):
        compared(decentred, null_deg, angles)


def test_refuses_a_motion_of_a_single_angle() -> None:
    with pytest.raises(DesignError, match="does not extend beyond the null"):
        compared(sensor(), 0.0, (0.0,))


def test_skips_a_lens_with_constant_contrast() -> None:
    choice = compared(sensor(), 0.0, (-3.0, 0.0, 3.0), lambda shape, angle: -0.1 * angle * (shape != "layered"))
    assert list(choice.skipped) == ["layered"]
    assert "must change" in choice.skipped["layered"]
    assert (choice.gain, choice.u_gain, choice.layers_pay) == (None, None, None)


@pytest.fixture(scope="module")
def straight() -> LensChoice:
    return compared(sensor(), 0.0, (-3.0, 0.0, 3.0))


def with_layered(choice: LensChoice, off_contrast: float, u: float) -> LensChoice:
    """The choice with another contrast of the layered lens with the emitter displaced."""

    def with_contrast(figures: LensFigures) -> LensFigures:
        return replace(figures, off_contrast=off_contrast, u_off_contrast=u) if figures.shape == "layered" else figures

    return replace(choice, lenses=tuple(map(with_contrast, choice.lenses)))


def test_layered_lens_without_a_signal_has_no_gain(straight: LensChoice) -> None:
    without_signal = with_layered(straight, 0.0, 0.004)
    assert (without_signal.gain, without_signal.layers_pay) == (0.0, False)
    assert without_signal.u_gain == pytest.approx(0.004 / 0.1)


@pytest.mark.parametrize(("gain", "u", "pays"), [(1.25, 0.006, True), (1.25, 0.01, False), (1.09, 0.0, False)])
def test_layers_pay_if_the_gain_significantly_exceeds_a_tenth(
    straight: LensChoice, gain: float, u: float, pays: bool
) -> None:
    """The cylinder has a contrast of 0.1 without uncertainty; half of 1.25 − 1.1 is 0.075."""
    cylinders = [replace(figures, u_off_contrast=0.0, off_contrast=0.1) for figures in straight.lenses]
    choice = with_layered(replace(straight, lenses=tuple(cylinders)), 0.1 * gain, u)
    assert choice.u_gain == pytest.approx(u / 0.1)
    assert choice.layers_pay == pays


def test_emitter_is_displaced_to_the_worse_side_of_given_profiles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A print is not symmetric about the mid-plane of the body."""
    plain = LayeredLens(1.0, 20.0, 2.0, 1.44, layer_mm=0.5)
    profiles = LayerProfiles("a print", 2.0, plain.edges_mm, plain.profiles[0], simulated=True)
    (tmp_path / "printed.json").write_text(layers_text(profiles))
    printed = sensor(lens__shape="layered", lens__profile=str(tmp_path / "printed.json"))

    def made_up_response(traced_sensor: Sensor, angles_deg: Sequence[float], *_: object) -> Response:
        lean = 2.0 * traced_sensor.design.emitter.y_mm if traced_sensor.design.lens.shape == "layered" else 0.0
        return response([-0.1 * (1.0 + lean) * angle for angle in angles_deg], angles_deg)

    monkeypatch.setattr("solen.sensor.lens_choice.response_at", made_up_response)
    choice = lens_choice(printed, made_up_response(printed, (-3.0, 0.0, 3.0)), 0.0)
    assert {lens.shape: lens.given for lens in choice.lenses} == {shape: shape == "layered" for shape in SLOPES}
    figures = choice.of("layered")
    assert figures is not None
    assert figures.off_contrast == pytest.approx(0.1 * 0.8)
    assert choice.gain == pytest.approx(0.8)
