"""Media in contact with walls: closed pads, films of air with frustrated total reflection, and wall finishes."""

import math
from typing import Any

import numpy as np
import pytest

from solen.curve import ArcLength
from solen.errors import DesignError
from solen.scene import Scene
from solen.scene.surface import Coating, Gaussian, Layer, Surface, Texture
from solen.sensor import Sensor
from solen.spec import Design
from solen.trace import trace

SKIN = {"outside": "skin", "index": 1.40}
RAYS = 1000


def design(*walls: dict[str, Any], **tables: Any) -> Design:
    return Design.model_validate({"name": "test", "material": {"index": 1.44}, "wall": list(walls)} | tables)


def scene(*walls: dict[str, Any], angle_deg: float = 0.0, **tables: Any) -> Scene:
    return Sensor.of(design(*walls, **tables)).scene(angle_deg, RAYS)


def edges(built: Scene, word: str) -> list[str]:
    return [interface.name for interface in built.interfaces if interface.name.endswith(word)]


def test_scene_without_walls_has_no_pads() -> None:
    built = scene()
    assert {region.name for region in built.regions} == {"air", "body"}
    assert built.wavelengths_nm == ()
    assert all(interface.surface is None for interface in built.interfaces)


def test_treated_part_has_specified_position_on_both_sides() -> None:
    built = scene({"face": "stem-*", "from_mm": 2.0, "to_mm": 6.0, **SKIN})
    curves = {i.name: i.curve for i in built.interfaces if i.right == "skin" and i.left == "body"}
    assert set(curves) == {"stem-right.2", "stem-left.2"}
    for curve in curves.values():
        assert ArcLength(curve).length_mm == pytest.approx(4.0, abs=1e-9)
    right, left = curves["stem-right.2"], curves["stem-left.2"]
    assert left.end == pytest.approx((-right.start[0], right.start[1]), abs=1e-12)
    unturned = Sensor.of(design()).body()
    first = next(i.curve for i in built.interfaces if i.name == "stem-right.1")
    assert first.start == unturned.face("stem-right").curve.start
    assert ArcLength(first).length_mm == pytest.approx(2.0, abs=1e-9)


@pytest.mark.parametrize("kind", ["rotation", "bend"])
@pytest.mark.parametrize("angle_deg", [0.0, -3.0, 2.0])
@pytest.mark.parametrize(
    "walls",
    [
        [{"face": "stem-*", "from_mm": 2.0, "to_mm": 6.0, **SKIN}],
        [{"face": "stem-right", **SKIN}, {"face": "outer-right", "outside": "glue", "index": 1.5, "depth_mm": 2.0}],
        [{"face": "stem-right", "to_mm": 4.0, **SKIN}, {"face": "stem-right", "from_mm": 4.0, **SKIN, "depth_mm": 0.5}],
        [{"face": "[so]*-left", "beyond": "air", **SKIN}],
        [{"face": "lens", **SKIN, "depth_mm": 0.05}],
    ],
)
def test_pads_are_closed_in_every_state_of_motion(kind: str, angle_deg: float, walls: list[dict[str, Any]]) -> None:
    built = scene(*walls, angle_deg=angle_deg, motion={"kind": kind})  # a scene refuses open media
    assert edges(built, "outer edge")
    traced = trace(built, "power")
    assert traced.ledger.total == pytest.approx(1.0, abs=1e-9)
    assert traced.undefined == 0


def test_neighbouring_faces_of_one_table_share_pad() -> None:
    shared = scene({"face": "[so]*-right", **SKIN})
    assert edges(shared, "first edge") == ["stem-right first edge"]
    assert edges(shared, "last edge") == ["outer-right last edge"]
    separate = scene({"face": "stem-right", **SKIN}, {"face": "outer-right", "outside": "glue", "index": 1.5})
    assert edges(separate, "shared edge") == ["outer-right shared edge"]


def test_last_table_takes_precedence() -> None:
    mirrored = {"face": "stem-right", "from_mm": 3.0, "to_mm": 5.0, "finish": "mirror"}
    built = scene({"face": "stem-right", **SKIN}, mirrored)
    stretches = [i for i in built.interfaces if i.name.startswith("stem-right.") and i.left == "body"]
    assert [(stretch.name, stretch.right, stretch.behaviour) for stretch in stretches] == [
        ("stem-right.1", "skin", "refracting"),
        ("stem-right.2", "air", "mirror"),
        ("stem-right.3", "skin", "refracting"),
    ]


def test_surfaces_have_specified_treatment() -> None:
    built = scene(
        {"face": "stem-right", "scatter": "gaussian", "sigma": 0.1, "scatter_share": 0.5},
        {"face": "stem-left", "texture_pitch_um": 25.0, "texture_amplitude_um": 1.0, "texture_direction": "across"},
        {"face": "outer-right", "gap_um": 0.5, "coating": [{"index": 1.38, "thickness_nm": 100.0}], **SKIN},
        {"face": "outer-left", "finish": "mirror", "reflectance": 0.9},
    )
    surfaces = {interface.name: interface.surface for interface in built.interfaces}
    assert surfaces["stem-right"] == Surface(scatter=Gaussian(0.1, 0.5))
    assert surfaces["stem-left"] == Surface(texture=Texture(25.0, 1.0, "across"))
    assert surfaces["outer-right"] == Surface(coating=Coating((Layer(1.38, 100.0), Layer(1.0, 500.0))))
    assert surfaces["outer-left"] == Surface(reflectance=0.9)
    assert built.wavelengths_nm == (860.0,)


def received(*walls: dict[str, Any]) -> float:
    return trace(scene(*walls, angle_deg=-1.0), "power").ledger.detected


def test_film_of_air_restores_total_reflection_lost_by_contact() -> None:
    """A black pad with the index of the body absorbs all light that reaches it, but hardly any behind a thick film."""
    pad = {"face": "[so]*-right", "outside": "glue", "index": 1.44}
    bare, in_contact = received(), received(pad)
    assert in_contact < bare - 0.05
    films = [received({**pad, "gap_um": gap_um}) for gap_um in (1e-4, 0.1, 0.5, 20.0)]
    assert films[0] == pytest.approx(in_contact, abs=1e-3)
    assert films == sorted(films)
    assert films[-1] == pytest.approx(bare, abs=2e-3)


def test_pad_absorbs_light_that_receivers_lack() -> None:
    """The light absorbed by the edges of the pad equals the decrease of the detected and escaped light."""
    wall = {"face": "outer-right", "outside": "glue", "index": 1.44}
    bare, in_contact = (trace(scene(*walls, angle_deg=-1.0), "power").ledger for walls in ((), (wall,)))
    assert bare.absorbed == 0.0
    assert in_contact.absorbed == pytest.approx(
        bare.detected + bare.escaped - in_contact.detected - in_contact.escaped, abs=1e-9
    )
    assert in_contact.absorbed > 0.05


def test_light_returns_from_clear_pad() -> None:
    """A cladding with the index of the body is part of the body: its outer edge reflects as the wall did."""
    wall = {"face": "[so]*-*", "outside": "clad", "index": 1.44, "depth_mm": 0.2}
    black, clear = received(wall), received({**wall, "beyond": "air"})
    assert black < clear - 0.05
    assert clear == pytest.approx(received(), rel=0.1)


@pytest.mark.parametrize(
    ("walls", "message"),
    [
        ([{"face": "stern-*"}], r"wall\[0\]\.face = 'stern-\*'; matches no wall; the walls are lens, stem-right"),
        ([{"face": "joint-*"}], r"wall\[0\]\.face = 'joint-\*'; matches no wall"),
        ([{"face": "receiver-right"}], r"wall\[0\]\.face = 'receiver-right'; matches no wall"),
        ([{"face": "stem-right", "from_mm": 17.0}], r"wall\[0\]\.from_mm = 17\.0; must be below 16\.2"),
        ([{"face": "stem-right", **SKIN}, {"face": "stem-left", **SKIN, "index": 1.5}], r"wall\[1\]\.outside = 'skin'"),
        (
            [{"face": "stem-right", "from_mm": 5.0, "to_mm": 5.0 + 1e-9, **SKIN}],
            r"wall\[0\]\.to_mm = .*at least 1e-06 mm",
        ),
        ([{"face": "inner-*", **SKIN}], "reaches into|turns inwards"),
        ([{"face": "stem-right", **SKIN, "depth_mm": 300.0}], "reaches into|radius below 300 mm"),
        ([{"face": "lens", **SKIN}], "reaches into the emitter|radius below"),
    ],
)
def test_refuses_invalid_walls(walls: list[dict[str, Any]], message: str) -> None:
    with pytest.raises(DesignError, match=message) as refusal:
        scene(*walls)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("gap_mm", [0.0, 1e-12, 1e-9, 1e-7, -1e-9])
def test_tables_that_meet_within_rounding_are_neighbours(gap_mm: float) -> None:
    glue = {"outside": "glue", "index": 1.5}
    built = scene(
        {"face": "stem-right", "from_mm": 2.0, "to_mm": 5.0, **SKIN},
        {"face": "stem-right", "from_mm": 5.0 + gap_mm, "to_mm": 9.0, **glue},
    )
    assert len([i for i in built.interfaces if i.name in {f"stem-right.{k}" for k in range(1, 9)}]) == 4


@pytest.mark.parametrize("angle_deg", [3.0, -3.0])
def test_contact_stays_in_place_when_lens_turns(angle_deg: float) -> None:
    wall = {"face": "stem-*", "from_mm": 2.0, "to_mm": 6.0, **SKIN}
    turned, unturned = (scene(wall, angle_deg=angle) for angle in (angle_deg, 0.0))
    for name in ("stem-right.2", "stem-left.2"):
        curve_turned, curve_at_rest = (
            next(i.curve for i in state.interfaces if i.name == name) for state in (turned, unturned)
        )
        assert math.dist(curve_turned.start, curve_at_rest.start) < 1e-9
        assert math.dist(curve_turned.end, curve_at_rest.end) < 1e-9
        assert np.isfinite(ArcLength(curve_turned).length_mm)
