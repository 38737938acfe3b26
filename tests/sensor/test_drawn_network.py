"""Networks drawn by hand: what is read back from the drawing of a network is that network."""

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
from solen.sensor.network.places import suggestions
from solen.spec import Design, loads, template, with_values

TURN = {"name": "turns", "kind": "rotation", "part": "index-led", "at_deg": 2.0}


@pytest.fixture(scope="module")
def hand() -> Design:
    """The shipped hand in the plane, one of its emitters turned by a motion."""
    design = loads(template("hand-860"))
    network: dict[str, Any] = design.network.model_dump(exclude_defaults=True)
    emitters = [one | {"name": f"{one['name']}-led"} for one in network["emitters"]]
    network |= {"emitters": emitters, "motion": [TURN], "reading": []}
    return with_values(design, {"trace.dimension": "2d", "emitter.rays": 300, "network": network})


@pytest.fixture(scope="module")
def folder(hand: Design, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the drawing of the hand, all at rest."""
    return written(hand, tmp_path_factory.mktemp("drawn"), "svg").parent


def written(hand: Design, folder: Path, suffix: str) -> Path:
    """Drawing of a hand, all at rest."""
    at_rest = with_values(hand, {"network.motion[0].at_deg": 0.0})
    if suffix == "dxf":
        pytest.importorskip("ezdxf")
    draw = {"svg": as_svg, "dxf": as_dxf}[suffix]
    file = folder / f"hand.{suffix}"
    file.write_bytes(draw(Sensor.of(at_rest).body(), label_of(at_rest, "now")))
    return file


def drawn(hand: Design, file: Path, **network: Any) -> Design:
    """The design of a drawn hand: the names of its parts."""
    lists = {
        "lenses": [{"name": one.name} for one in hand.network.lenses],
        "emitters": [{"name": one.name, "lens": one.lens} for one in hand.network.emitters],
        "receivers": [{"name": one.name} for one in hand.network.receivers],
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
def test_a_drawing_of_a_network_read_back_has_its_powers(hand: Design, tmp_path: Path, suffix: str) -> None:
    flat = with_values(hand, {"lens": {"shape": "none"}})
    found, own = (network_trace(each) for each in (drawn(hand, written(flat, tmp_path, suffix)), flat))
    assert (found.emitters, found.receivers) == (own.emitters, own.receivers)
    assert np.count_nonzero(own.power > 1e-3) > 8
    assert found.power == pytest.approx(own.power, abs=1e-9)
    for mine, theirs in zip(found.sensors, own.sensors, strict=True):
        a, b = mine.body().emitter, theirs.body().emitter
        assert (*a.point, a.axis_deg) == pytest.approx((*b.point, b.axis_deg), abs=1e-9)


def test_of_ovals_drawn_within_a_nanometre_two_rays_of_4000_take_another_way(hand: Design, folder: Path) -> None:
    found, own = (
        network_trace(with_values(each, {"emitter.rays": 4000})) for each in (drawn(hand, folder / "hand.svg"), hand)
    )
    assert found.power == pytest.approx(own.power, abs=2.0 / 4000)
    assert found.sensors[0].body().area_mm2() == pytest.approx(own.sensors[0].body().area_mm2(), abs=1e-7)


def test_points_look_along_their_lenses_and_lenses_have_their_sizes(hand: Design, folder: Path) -> None:
    point = with_values(hand, {"emitter.width_mm": 0.0, "network.motion[0].at_deg": 0.0})
    svg = as_svg(Sensor.of(point).body(), label_of(point, "now"))
    (folder / "points.svg").write_bytes(svg)
    assert svg.count(b'<circle id="emitter-') == 3
    found, own = network_check(drawn(hand, folder / "points.svg", motion=[])), network_check(point)
    for mine, theirs in zip(found.emitters, own.emitters, strict=True):
        numbers = ((each.x_mm, each.z_mm, each.axis_deg) for each in (mine, theirs))
        assert next(numbers) == pytest.approx(next(numbers), abs=1e-9)
    sizes = ([(one.half_width_mm, one.depth_mm) for one in each.lenses] for each in (found, own))
    assert np.array(next(sizes)) == pytest.approx(np.array(next(sizes)), abs=1e-9)


def strip(tmp_path: Path, **network: Any) -> Design:
    """A strip in JSON, lit from both of its ends, with names of the design in capitals."""
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


def test_emitters_of_json_light_in_turn_under_the_names_of_the_design(tmp_path: Path) -> None:
    reading = {"name": "sides", "value": "Low.Side - high.Side"}
    found = network_trace(strip(tmp_path, reading=[reading]))
    assert (found.emitters, found.receivers) == (("Low", "high"), ("Side",))
    low, high = found.power[0, :, 0].tolist()
    assert low > high > 0.0  # the receiver is nearer to the lower end by the width of one receiver
    assert found.reading[0, 0] == low - high
    turned = strip(tmp_path, motion=[TURN | {"part": "Low"}])
    emitter = Sensor.of(turned).body().emitter  # about where its axis meets the end
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


@pytest.mark.parametrize(("text", "other", "named"), SVG_REFUSALS)
def test_a_drawing_without_what_the_design_lists_is_refused(
    hand: Design, folder: Path, text: str, other: str, named: str
) -> None:
    whole = (folder / "hand.svg").read_text()
    assert text in whole
    (folder / "bad.svg").write_text(whole.replace(text, other, 1))
    refused(lambda: network_check(drawn(hand, folder / "bad.svg")), named)


def refused(call: Any, named: str) -> None:
    with pytest.raises(SolenError) as refusal:
        call()
    line = str(refusal.value)
    assert len(line.splitlines()) == 1
    assert all(word in line for word in named.split())


def test_an_emitter_that_looks_past_its_lens_or_the_body_is_refused(hand: Design, folder: Path, tmp_path: Path) -> None:
    others = [{"name": one.name, "lens": one.lens} for one in hand.network.emitters]
    others[0]["lens"], others[1]["lens"] = others[1]["lens"], others[0]["lens"]
    refused(
        lambda: network_check(drawn(hand, folder / "hand.svg", emitters=others)), "emitters[0].lens index lens-wrist"
    )
    design = strip(tmp_path)
    text = (tmp_path / "strip.json").read_text()
    (tmp_path / "strip.json").write_text(text.replace("180.0", "0.0"))
    refused(lambda: network_check(design), "emitters[1].name high past 21")


@pytest.mark.parametrize(
    ("network", "named"),
    [
        ({"emitters": [{"name": "Low"}, {"name": "low"}, {"name": "high"}]}, "emitters[1].name low lower"),
        ({"emitters": [{"name": "Low"}, {"name": "middle"}]}, "emitters[1].name middle emitter-high"),
        ({"emitters": [{"name": "Low"}]}, "emitter-high emitters"),
        ({"emitters": [{"name": "Low", "distance_mm": 2.0}, {"name": "high"}]}, "emitters[0].distance_mm body.file"),
        ({"lenses": [{"name": "end"}]}, "lenses[0].name end illuminates"),
        ({"receivers": [{"name": "Side", "node": "tip"}], "nodes": [{"name": "tip"}]}, "network.nodes body.file"),
        ({"motion": [TURN | {"part": "Side"}]}, "motion[0].part Side"),
    ],
)
def test_lists_that_do_not_fit_a_drawing_are_refused(tmp_path: Path, network: dict[str, Any], named: str) -> None:
    refused(lambda: network_check(strip(tmp_path, **network)), named)


def test_keys_of_a_drawing_need_one_and_a_drawing_takes_no_lens(hand: Design, tmp_path: Path) -> None:
    refused(lambda: with_values(hand, {"body.units": "mm"}), "body.units body.file")
    refused(lambda: with_values(strip(tmp_path), {"lens.focus_mm": 12.0}), "lens.focus_mm body.file")
    refused(lambda: suggestions(strip(tmp_path)), "body.file strip.json drawn")


def test_what_a_drawing_holds_cannot_turn(hand: Design, folder: Path) -> None:
    lens = TURN | {"part": "wrist"}
    refused(lambda: drawn(hand, folder / "hand.svg", motion=[lens]), "network.motion[0].part wrist")
