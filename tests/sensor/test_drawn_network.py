"""Networks from drawings: reading back the drawing of a network gives the network."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import SolenError
from solen.fabricate.dxf import as_dxf
from solen.fabricate.label import label_of
from solen.fabricate.svg import as_svg
from solen.sensor import Sensor
from solen.sensor.network import network_check, network_trace
from solen.sensor.network.suggestions import suggestions
from solen.spec import Design, loads, template, with_values

TURN = {"name": "turns", "kind": "rotation", "part": "index-led", "at_deg": 2.0}


@pytest.fixture(scope="module")
def hand() -> Design:
    """The template of the hand in the plane, with one of its emitters rotated by a motion."""
    design = loads(template("hand-860"))
    network: dict[str, Any] = design.network.model_dump(exclude_defaults=True)
    emitters = [part | {"name": f"{part['name']}-led"} for part in network["emitters"]]
    network |= {"emitters": emitters, "motion": [TURN], "reading": []}
    return with_values(design, {"trace.dimension": "2d", "emitter.rays": 300, "network": network})


@pytest.fixture(scope="module")
def folder(hand: Design, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the drawing of the hand, with its motion at rest."""
    return written(hand, tmp_path_factory.mktemp("drawn"), "svg").parent


def written(hand: Design, folder: Path, suffix: str) -> Path:
    """Write the drawing of a hand, with its motion at rest."""
    at_rest = with_values(hand, {"network.motion[0].at_deg": 0.0})
    if suffix == "dxf":
        pytest.importorskip("ezdxf")
    draw = {"svg": as_svg, "dxf": as_dxf}[suffix]
    file = folder / f"hand.{suffix}"
    file.write_bytes(draw(Sensor.of(at_rest).body(), label_of(at_rest, "now")))
    return file


def drawn(hand: Design, file: Path, **network: Any) -> Design:
    """The design of a drawn hand, which lists the names of its parts."""
    lists = {
        "lenses": [{"name": part.name} for part in hand.network.lenses],
        "emitters": [{"name": part.name, "lens": part.lens} for part in hand.network.emitters],
        "receivers": [{"name": part.name} for part in hand.network.receivers],
        "motion": [TURN],
    }
    emitter = {"width_mm": 0.25, "pattern": "lambertian", "cone_deg": 180.0, "rays": 300}
    body = {"kind": "network", "file": str(file)}
    return Design(
        name="drawn",
        material={"index": 1.44},
        body=body,
        emitter=emitter,
        trace={"mode": "power"},
        network=lists | network,
    )


@pytest.mark.parametrize("suffix", ["svg", "dxf"])
def test_drawing_of_a_network_has_its_powers(hand: Design, tmp_path: Path, suffix: str) -> None:
    without_lenses = with_values(hand, {"lens": {"shape": "none"}})
    drawn_trace, own_trace = (
        network_trace(design) for design in (drawn(hand, written(without_lenses, tmp_path, suffix)), without_lenses)
    )
    assert (drawn_trace.emitters, drawn_trace.receivers) == (own_trace.emitters, own_trace.receivers)
    assert np.count_nonzero(own_trace.power > 1e-3) > 8
    assert drawn_trace.power == pytest.approx(own_trace.power, abs=1e-9)
    for drawn_sensor, own_sensor in zip(drawn_trace.sensors, own_trace.sensors, strict=True):
        a, b = drawn_sensor.body().emitter, own_sensor.body().emitter
        assert (*a.point, a.axis_deg) == pytest.approx((*b.point, b.axis_deg), abs=1e-9)


def test_drawn_ovals_change_at_most_two_rays_of_4000(hand: Design, folder: Path) -> None:
    drawn_trace, own_trace = (
        network_trace(with_values(design, {"emitter.rays": 4000}))
        for design in (drawn(hand, folder / "hand.svg"), hand)
    )
    assert drawn_trace.power == pytest.approx(own_trace.power, abs=2.0 / 4000)
    assert drawn_trace.sensors[0].body().area_mm2() == pytest.approx(own_trace.sensors[0].body().area_mm2(), abs=1e-7)


def test_point_emitters_and_lenses_are_recovered_from_the_drawing(hand: Design, folder: Path) -> None:
    point = with_values(hand, {"emitter.width_mm": 0.0, "network.motion[0].at_deg": 0.0})
    svg = as_svg(Sensor.of(point).body(), label_of(point, "now"))
    (folder / "points.svg").write_bytes(svg)
    assert svg.count(b'<circle id="emitter-') == 3
    drawn_check, own_check = network_check(drawn(hand, folder / "points.svg", motion=[])), network_check(point)
    for drawn_emitter, own_emitter in zip(drawn_check.emitters, own_check.emitters, strict=True):
        numbers = ((design.x_mm, design.z_mm, design.axis_deg) for design in (drawn_emitter, own_emitter))
        assert next(numbers) == pytest.approx(next(numbers), abs=1e-9)
    sizes = ([(part.half_width_mm, part.depth_mm) for part in design.lenses] for design in (drawn_check, own_check))
    assert np.array(next(sizes)) == pytest.approx(np.array(next(sizes)), abs=1e-9)


def strip(tmp_path: Path, **network: Any) -> Design:
    """A strip in JSON, lit from both of its ends, with some names capitalised in the design."""
    corners = [(-1.0, 0.0), (1.0, 0.0), (1.0, 10.0), (1.0, 12.0), (1.0, 20.0), (-1.0, 20.0)]
    names = ["wall", "wall", "receiver-side", "wall", "wall", "wall"]
    faces = [
        {"name": name, "curve": {"kind": "segment", "a": a, "b": b}}
        for name, a, b in zip(names, corners, [*corners[1:], corners[0]], strict=True)
    ]
    emitters = [{"name": "low", "point": [0.2, -1.0]}, {"name": "high", "point": [0.2, 21.0], "axis_deg": 180.0}]
    file = tmp_path / "strip.json"
    file.write_text(json.dumps({"solen_outline": 1, "faces": faces, "emitters": emitters}))
    lists = {"emitters": [{"name": "Low"}, {"name": "high"}], "receivers": [{"name": "Side"}]}
    body = {"kind": "network", "file": str(file)}
    return Design(name="strip", material={"index": 1.44}, body=body, network=lists | network)


def test_emitters_of_a_json_drawing_have_the_names_of_the_design(tmp_path: Path) -> None:
    reading = {"name": "sides", "value": "Low.Side - high.Side"}
    drawn_trace = network_trace(strip(tmp_path, reading=[reading]))
    assert (drawn_trace.emitters, drawn_trace.receivers) == (("Low", "high"), ("Side",))
    low, high = drawn_trace.power[0, :, 0].tolist()
    assert low > high > 0.0  # the receiver is nearer to the lower end
    assert drawn_trace.reading[0, 0] == low - high
    turned = strip(tmp_path, motion=[TURN | {"part": "Low"}])
    emitter = Sensor.of(turned).body().emitter  # about the point where its axis meets the end
    assert emitter.axis_deg == 2.0
    assert emitter.point == pytest.approx((0.2 + np.sin(np.radians(2.0)), -np.cos(np.radians(2.0))), abs=1e-12)


SVG_REFUSALS = [
    ('label="emitter-ring-led"', 'label="emitter-index-led"', "emitter-index-led twice"),
    ('label="emitter-ring-led"', 'label="emitter-little-led"', "ring-led emitter-little-led"),
    ('label="receiver-thumb"', 'label="receiver-thumbs"', "thumb receiver-thumbs"),
    ('label="receiver-thumb"', 'label="thumb-end"', "receivers[1].name thumb"),
    ('label="thumb-right"', 'label="lens-thumb"', "lens-thumb lenses"),
    ('label="index-left"', 'label="lens-wrist"', "lens-wrist several"),
    ("</g>", '<circle inkscape:label="pivot" cx="0" cy="-2" r="0.1"/></g>', "pivot network.motion"),
]


@pytest.mark.parametrize(("text", "replacement", "words"), SVG_REFUSALS)
def test_refuses_a_drawing_without_the_parts_of_the_design(
    hand: Design, folder: Path, text: str, replacement: str, words: str
) -> None:
    text_before = (folder / "hand.svg").read_text()
    assert text in text_before
    (folder / "bad.svg").write_text(text_before.replace(text, replacement, 1))
    assert_refused(lambda: network_check(drawn(hand, folder / "bad.svg")), words)


def assert_refused(call: Any, words: str) -> None:
    with pytest.raises(SolenError) as error:
        call()
    line = str(error.value)
    assert len(line.splitlines()) == 1
    assert all(word in line for word in words.split())


def test_refuses_an_emitter_that_misses_its_lens_or_the_body(hand: Design, folder: Path, tmp_path: Path) -> None:
    emitters = [{"name": part.name, "lens": part.lens} for part in hand.network.emitters]
    emitters[0]["lens"], emitters[1]["lens"] = emitters[1]["lens"], emitters[0]["lens"]
    assert_refused(
        lambda: network_check(drawn(hand, folder / "hand.svg", emitters=emitters)), "emitters[0].lens index lens-wrist"
    )
    design = strip(tmp_path)
    text = (tmp_path / "strip.json").read_text()
    (tmp_path / "strip.json").write_text(text.replace("180.0", "0.0"))
    assert_refused(lambda: network_check(design), "emitters[1].name high past 21")


@pytest.mark.parametrize(
    ("network", "words"),
    [
        ({"emitters": [{"name": "Low"}, {"name": "low"}, {"name": "high"}]}, "emitters[1].name low lower"),
        ({"emitters": [{"name": "Low"}, {"name": "middle"}]}, "emitters[1].name middle emitter-high"),
        ({"emitters": [{"name": "Low"}]}, "emitter-high emitters"),
        ({"emitters": [{"name": "Low", "distance_mm": 2.0}, {"name": "high"}]}, "emitters[0].distance_mm body.file"),
        ({"lenses": [{"name": "end"}]}, "lenses[0].name end illuminated"),
        ({"receivers": [{"name": "Side", "node": "tip"}], "nodes": [{"name": "tip"}]}, "network.nodes body.file"),
        ({"motion": [TURN | {"part": "Side"}]}, "motion[0].part Side"),
    ],
)
def test_refuses_lists_that_do_not_match_the_drawing(tmp_path: Path, network: dict[str, Any], words: str) -> None:
    assert_refused(lambda: network_check(strip(tmp_path, **network)), words)


def test_refuses_keys_that_do_not_apply_to_drawings(hand: Design, tmp_path: Path) -> None:
    assert_refused(lambda: with_values(hand, {"body.units": "mm"}), "body.units body.file")
    assert_refused(lambda: with_values(strip(tmp_path), {"lens.focus_mm": 12.0}), "lens.focus_mm body.file")
    assert_refused(lambda: suggestions(strip(tmp_path)), "body.file strip.json drawn")


def test_refuses_a_rotation_of_a_drawn_lens(hand: Design, folder: Path) -> None:
    lens = TURN | {"part": "wrist"}
    assert_refused(lambda: drawn(hand, folder / "hand.svg", motion=[lens]), "network.motion[0].part wrist")
