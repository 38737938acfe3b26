"""Keys without effect are reported exactly if a trace gives the same powers without them."""

from typing import Any

import pytest

from solen.sensor import Sensor, keys_without_effect
from solen.spec import Design
from solen.trace import Mode

PAPER: dict[str, Any] = {"name": "paper", "material": {"index": 1.44}}
LAMBERTIAN = {"pattern": "lambertian", "width_mm": 0.2, "rays": 400}


def coated(index: float, thickness_nm: float) -> dict[str, Any]:
    film = {"index": index, "thickness_nm": thickness_nm, "extinction": 0.1}
    return {"wall": [{"face": "outer-*", "coating": [film]}]}


def with_contact(gap_um: float | None, **keys: Any) -> dict[str, Any]:
    gap = {} if gap_um is None else {"gap_um": gap_um}
    return {"wall": [{"face": "outer-left", "outside": "skin", "index": 1.42, **gap, **keys}]}


SPACE = {"trace": {"dimension": "extruded"}, "emitter": LAMBERTIAN}
FLAT = {"emitter": LAMBERTIAN}
CASES: list[tuple[dict[str, Any], dict[str, Any], Mode, str]] = [
    ({"receivers": {"height_mm": 1.0}}, {}, "count", "receivers.height_mm = 1 "),
    ({"emitter": LAMBERTIAN | {"height_mm": 0.3}}, FLAT, "power", "emitter.height_mm = 0.3 "),
    ({"material": {"index": 1.44, "absorption_per_mm": 0.1}}, {}, "count", "material.absorption_per_mm = 0.1 "),
    (
        with_contact(None, absorption_per_mm=3.0, beyond="air"),
        with_contact(None, beyond="air"),
        "count",
        "wall[0].absorption",
    ),
    (
        {"wall": [{"face": "outer-*", "finish": "mirror", "reflectance": 0.5}]},
        {"wall": [{"face": "outer-*", "finish": "mirror"}]},
        "count",
        "wall[0].reflectance = 0.5 ",
    ),
    (coated(1.0, 400.0), {}, "count", "wall[0].coating "),
    (coated(1.6, 4000.0), {}, "count", "wall[0].coating "),
    (with_contact(0.5), with_contact(None), "count", "wall[0].gap_um "),
]
EFFECTIVE: list[tuple[dict[str, Any], dict[str, Any], Mode]] = [
    (SPACE | {"receivers": {"height_mm": 1.0}}, SPACE, "count"),
    (SPACE | {"emitter": LAMBERTIAN | {"height_mm": 3.0}}, SPACE, "power"),
    ({"material": {"index": 1.44, "absorption_per_mm": 0.1}}, {}, "power"),
    (coated(1.6, 400.0), {}, "power"),
    (with_contact(5.0), with_contact(None), "count"),
    (with_contact(0.5), with_contact(None), "power"),
]


def test_light_reaches_the_walls_of_these_cases() -> None:
    """Otherwise, no key of the walls could have an effect."""
    black: dict[str, Any] = {"wall": [{"face": "outer-*", "finish": "black"}]}
    assert traced(black, "count") != traced({}, "count") != traced(with_contact(None), "count")


def traced(tables: dict[str, Any], mode: Mode) -> dict[str, float]:
    trace = Sensor.of(Design.model_validate(PAPER | tables)).trace(1.0, mode, 1000)
    return {name: detector.power for name, detector in trace.detectors.items()}


@pytest.mark.parametrize(("tables", "without", "mode", "start"), CASES, ids=[start for *_, start in CASES])
def test_reported_key_changes_no_power(tables: dict[str, Any], without: dict[str, Any], mode: Mode, start: str) -> None:
    (sentence,) = keys_without_effect(Sensor.of(Design.model_validate(PAPER | tables)), mode)
    assert sentence.startswith(start)
    assert "has no effect in" in sentence
    assert traced(tables, mode) == traced(without, mode)


@pytest.mark.parametrize(("tables", "without", "mode"), EFFECTIVE)
def test_key_with_an_effect_is_not_reported(tables: dict[str, Any], without: dict[str, Any], mode: Mode) -> None:
    assert keys_without_effect(Sensor.of(Design.model_validate(PAPER | tables)), mode) == ()
    assert traced(tables, mode) != traced(without, mode)


def test_texture_across_is_reported_only_in_the_plane() -> None:
    wall = {"face": "outer-*", "texture_pitch_um": 50.0, "texture_amplitude_um": 1.0, "texture_direction": "across"}
    (sentence,) = keys_without_effect(Sensor.of(Design.model_validate(PAPER | {"wall": [wall]})))
    assert sentence.startswith('wall[0].texture_direction = "across" has no effect in the plane')
    assert keys_without_effect(Sensor.of(Design.model_validate(PAPER | {"wall": [wall]} | SPACE))) == ()
