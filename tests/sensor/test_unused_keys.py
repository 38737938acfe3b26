"""Keys without effect: told exactly where a trace gives the same numbers with and without them."""

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


def touched(gap_um: float | None, **more: Any) -> dict[str, Any]:
    gap = {} if gap_um is None else {"gap_um": gap_um}
    return {"wall": [{"face": "outer-left", "outside": "skin", "index": 1.42, **gap, **more}]}


SPACE = {"trace": {"dimension": "extruded"}, "emitter": LAMBERTIAN}
FLAT = {"emitter": LAMBERTIAN}
CASES: list[tuple[dict[str, Any], dict[str, Any], Mode, str]] = [
    ({"receivers": {"height_mm": 1.0}}, {}, "count", "receivers.height_mm = 1 "),
    ({"emitter": LAMBERTIAN | {"height_mm": 0.3}}, FLAT, "power", "emitter.height_mm = 0.3 "),
    ({"material": {"index": 1.44, "absorption_per_mm": 0.1}}, {}, "count", "material.absorption_per_mm = 0.1 "),
    (touched(None, absorption_per_mm=3.0, beyond="air"), touched(None, beyond="air"), "count", "wall[0].absorption"),
    (
        {"wall": [{"face": "outer-*", "finish": "mirror", "reflectance": 0.5}]},
        {"wall": [{"face": "outer-*", "finish": "mirror"}]},
        "count",
        "wall[0].reflectance = 0.5 ",
    ),
    (coated(1.0, 400.0), {}, "count", "wall[0].coating "),
    (coated(1.6, 4000.0), {}, "count", "wall[0].coating "),
    (touched(0.5), touched(None), "count", "wall[0].gap_um "),
]
ACTING: list[tuple[dict[str, Any], dict[str, Any], Mode]] = [
    (SPACE | {"receivers": {"height_mm": 1.0}}, SPACE, "count"),
    (SPACE | {"emitter": LAMBERTIAN | {"height_mm": 3.0}}, SPACE, "power"),
    ({"material": {"index": 1.44, "absorption_per_mm": 0.1}}, {}, "power"),
    (coated(1.6, 400.0), {}, "power"),
    (touched(5.0), touched(None), "count"),
    (touched(0.5), touched(None), "power"),
]


def test_the_walls_of_these_cases_are_met() -> None:
    """Else no key of theirs could change anything."""
    black: dict[str, Any] = {"wall": [{"face": "outer-*", "finish": "black"}]}
    assert traced(black, "count") != traced({}, "count") != traced(touched(None), "count")


def traced(tables: dict[str, Any], mode: Mode) -> dict[str, float]:
    found = Sensor.of(Design.model_validate(PAPER | tables)).trace(1.0, mode, 1000)
    return {name: one.power for name, one in found.detectors.items()}


@pytest.mark.parametrize(("tables", "without", "mode", "told"), CASES, ids=[told for *_, told in CASES])
def test_a_key_that_is_reported_changes_nothing(
    tables: dict[str, Any], without: dict[str, Any], mode: Mode, told: str
) -> None:
    (sentence,) = keys_without_effect(Sensor.of(Design.model_validate(PAPER | tables)), mode)
    assert sentence.startswith(told)
    assert "has no effect in" in sentence
    assert traced(tables, mode) == traced(without, mode)


@pytest.mark.parametrize(("tables", "without", "mode"), ACTING)
def test_a_key_that_changes_something_is_not_reported_of(
    tables: dict[str, Any], without: dict[str, Any], mode: Mode
) -> None:
    assert keys_without_effect(Sensor.of(Design.model_validate(PAPER | tables)), mode) == ()
    assert traced(tables, mode) != traced(without, mode)


def test_a_ripple_across_is_reported_in_the_plane_alone() -> None:
    wall = {"face": "outer-*", "texture_pitch_um": 50.0, "texture_amplitude_um": 1.0, "texture_direction": "across"}
    (sentence,) = keys_without_effect(Sensor.of(Design.model_validate(PAPER | {"wall": [wall]})))
    assert sentence.startswith('wall[0].texture_direction = "across" has no effect in the plane')
    assert keys_without_effect(Sensor.of(Design.model_validate(PAPER | {"wall": [wall]} | SPACE))) == ()
