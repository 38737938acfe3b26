"""Lenses beside one another, by responses that are made up: any motion about any null, and gains with uncertainties."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DesignError
from solen.lens import LayeredLens, Profiles, layers_text
from solen.sensor import LensChoice, LensFigures, Response, Sensor
from solen.sensor.lens_choice import lens_choice
from solen.spec import loads, template, with_values

SLOPES = {"cartesian-oval": -0.1, "layered": -0.15, "line-focus": -0.16}
"""Of straight responses, per degree."""
U_POWER = 1e-3

Curve = Callable[[str, float], float]


def sensor(**values: Any) -> Sensor:
    """The shipped design, which has a chip and is in space; ``__`` stands for the dot of a key."""
    return Sensor.of(with_values(loads(template()), {key.replace("__", "."): one for key, one in values.items()}))


def response(contrasts: Sequence[float], angles: Sequence[float]) -> Response:
    contrast = np.array(contrasts)
    right, left = 0.25 * (1.0 + contrast), 0.25 * (1.0 - contrast)
    return Response("power", np.array(angles), right, left, np.full(len(angles), U_POWER), ())


def compared(one: Sensor, null_deg: float, angles: Sequence[float], curve: Curve | None = None) -> LensChoice:
    """The choice of a sensor whose lenses have straight responses about its null, or those of a curve."""

    def value(shape: str, angle: float) -> float:
        return SLOPES[shape] * (angle - null_deg) if curve is None else curve(shape, angle)

    def swept(one: Sensor, asked: Sequence[float], *_: object) -> Response:
        return response([value(one.design.lens.shape, angle) for angle in asked], asked)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("solen.sensor.lens_choice.swept", swept)
        return lens_choice(one, swept(one, angles), null_deg)


@pytest.fixture(scope="module")
def decentred() -> Sensor:
    return sensor(emitter__offset_mm=0.1)


@pytest.mark.parametrize("null_deg", [-2.8, 0.1, 1.7])
def test_a_decentred_design_is_compared_about_its_null(decentred: Sensor, null_deg: float) -> None:
    found = compared(decentred, null_deg, (-3.0, 0.0, 3.0))
    assert (len(found.lenses), found.skipped) == (3, {})
    for lens in found.lenses:
        low, high = (3.0 + null_deg) / 6.0, (3.0 - null_deg) / 6.0
        assert lens.slope_per_deg == pytest.approx(SLOPES[lens.shape])
        assert lens.u_slope_per_deg == pytest.approx(2.0 * (2.0 * U_POWER / 0.5) / (low + high))
        assert lens.within_deg == pytest.approx(0.5 * (low + high))
        assert lens.nonlinearity == pytest.approx(0.0, abs=1e-12)
        assert lens.off_deg - null_deg == pytest.approx(2.0 * max(low, high) * (1.0 if null_deg < 0.0 else -1.0))
    assert found.gain == pytest.approx(1.5)


def test_an_uneven_motion_is_compared() -> None:
    mirrored = compared(sensor(motion__from_deg=-1.0), 0.0, (-1.0, 0.0, 3.0))
    own = mirrored.of("layered")
    assert own is not None
    assert own.angle_deg.tolist() == pytest.approx([-1.0, -1 / 2, -1 / 3, -1 / 6])
    assert (own.slope_per_deg, own.within_deg) == pytest.approx((-0.15, 1 / 6))
    asymmetric = compared(sensor(motion__from_deg=-1.0, emitter__offset_mm=0.02), -0.5, (-1.0, 0.0, 3.0))
    assert [lens.slope_per_deg for lens in asymmetric.lenses] == pytest.approx(list(SLOPES.values()))


def test_a_symmetric_design_is_mirrored_about_0_even_where_its_null_is_interpolated() -> None:
    found = compared(sensor(), 0.01, (-3.0, -0.5, 0.6, 3.0), lambda shape, angle: SLOPES[shape] * angle)
    assert [lens.slope_per_deg for lens in found.lenses] == pytest.approx(list(SLOPES.values()))
    assert [lens.nonlinearity for lens in found.lenses] == pytest.approx([0.0] * 3, abs=1e-12)


@pytest.mark.parametrize(
    ("null_deg", "angles", "why"),
    [
        (-3.0, (-3.0, 0.0, 3.0), "begins or ends at the null"),
        (3.0, (-3.0, 0.0, 3.0), "begins or ends at the null"),
        (0.0, (0.0,), "does not extend beyond the null"),
    ],
)
def test_one_side_of_an_asymmetric_design_is_not_mirrored(
    decentred: Sensor, null_deg: float, angles: tuple[float, ...], why: str
) -> None:
    with pytest.raises(DesignError, match=why):
        compared(decentred, null_deg, angles)


def test_a_motion_of_0_alone_is_refused() -> None:
    with pytest.raises(DesignError, match="does not extend beyond the null"):
        compared(sensor(), 0.0, (0.0,))


def test_a_contrast_that_does_not_change_is_left_out() -> None:
    found = compared(sensor(), 0.0, (-3.0, 0.0, 3.0), lambda shape, angle: -0.1 * angle * (shape != "layered"))
    assert list(found.skipped) == ["layered"]
    assert "must change" in found.skipped["layered"]
    assert (found.gain, found.u_gain, found.layers_pay) == (None, None, None)


@pytest.fixture(scope="module")
def straight() -> LensChoice:
    return compared(sensor(), 0.0, (-3.0, 0.0, 3.0))


def with_layered(found: LensChoice, off_contrast: float, u: float) -> LensChoice:
    """The choice where the layered lens has another contrast with the emitter off."""

    def other(one: LensFigures) -> LensFigures:
        return replace(one, off_contrast=off_contrast, u_off_contrast=u) if one.shape == "layered" else one

    return replace(found, lenses=tuple(map(other, found.lenses)))


def test_a_layered_lens_without_a_signal_does_not_pay(straight: LensChoice) -> None:
    none = with_layered(straight, 0.0, 0.004)
    assert (none.gain, none.layers_pay) == (0.0, False)
    assert none.u_gain == pytest.approx(0.004 / 0.1)


@pytest.mark.parametrize(("gain", "u", "pays"), [(1.25, 0.006, True), (1.25, 0.01, False), (1.09, 0.0, False)])
def test_layers_pay_by_a_tenth_beyond_twice_the_uncertainty(
    straight: LensChoice, gain: float, u: float, pays: bool
) -> None:
    """Of a cylinder of 0.1 without uncertainty: half of 1.25 − 1.1 is 0.075."""
    exact = [replace(one, u_off_contrast=0.0, off_contrast=0.1) for one in straight.lenses]
    found = with_layered(replace(straight, lenses=tuple(exact)), 0.1 * gain, u)
    assert found.u_gain == pytest.approx(u / 0.1)
    assert found.layers_pay == pays


def test_given_profiles_are_put_off_to_their_worse_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A print does not mirror itself about the middle of the body."""
    plain = LayeredLens(1.0, 20.0, 2.0, 1.44, layer_mm=0.5)
    given = Profiles("a print", 2.0, plain.edges_mm, plain.profiles[0], simulated=True)
    (tmp_path / "printed.json").write_text(layers_text(given))
    printed = sensor(lens__shape="layered", lens__profile=str(tmp_path / "printed.json"))

    def swept(one: Sensor, asked: Sequence[float], *_: object) -> Response:
        lean = 2.0 * one.design.emitter.y_mm if one.design.lens.shape == "layered" else 0.0
        return response([-0.1 * (1.0 + lean) * angle for angle in asked], asked)

    monkeypatch.setattr("solen.sensor.lens_choice.swept", swept)
    found = lens_choice(printed, swept(printed, (-3.0, 0.0, 3.0)), 0.0)
    assert {lens.shape: lens.given for lens in found.lenses} == {shape: shape == "layered" for shape in SLOPES}
    own = found.of("layered")
    assert own is not None
    assert own.off_contrast == pytest.approx(0.1 * 0.8)
    assert found.gain == pytest.approx(0.8)
