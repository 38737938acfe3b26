"""Scene files: a scene read back equals the one written, and an invalid file is refused with one line."""

import dataclasses
import inspect
import json
import math
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from solen import curve as curves
from solen import scene as scenes
from solen.curve import Arc, Bezier, CartesianOval, Conic, Curve, Parabola, Segment, Spline
from solen.errors import DataError, DesignError, SolenError
from solen.material import KINDS, Cauchy, Constant, Dispersion, Sellmeier, Tabulated
from solen.scene import (
    Ambient,
    Beam,
    Chip,
    CosinePower,
    Emitter,
    Fan,
    Interface,
    Monitor,
    PatternTable,
    RayFile,
    Rays,
    Region,
    Scene,
)
from solen.scene.json import SOURCES
from solen.spec.objects import CURVES
from tests.scene.rayfile_support import lambertian, zemax

ALL_CURVES: tuple[Curve, ...] = (
    Segment((0.1, -0.2), (1 / 3, 2.0)),
    Arc((0.5, 1.5), 2.0, -30.0, 275.0),
    Parabola((0.0, 1.0), (0.6, 0.8), -0.004, 3.0, -1.0),
    CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.44, 1.0, 20.0, 35.0, -35.0),
    Conic((0.0, 1.0), (0.6, 0.8), 0.5, -0.7, -1.5, 2.0),
    Bezier((0.0, 0.0), (1.0, 1 / 3), (2.0, -0.5), (3.0, 0.0)),
    Spline.through([(0.0, 0.0), (1.0, 0.3), (1.5, 1.7), (-0.2, 1.0)], closed=True),
)
FILE = zemax(Path(tempfile.mkdtemp()) / "rays.sdf", lambertian(9))
ALL_SOURCES = (
    Fan((0.0, -1.0), 3.0, 120.0, 101, power=0.25, s_share=1.0),
    Beam((-1.0, -2.0), (1.0, -2.0), -5.0, 7, s_share=0.0),
    Rays(((0.0, 0.0), (1.0, 2.0)), ((0.0, 1.0), (3.0, 4.0)), power=2.0),
    Chip((0.1, -1.0), 1 / 3, -3.0, 120.0, 101, power=0.25, s_share=1.0),
    Emitter((0.1, -1.0), -3.0, 101, PatternTable((0.0, 60.0, 1 / 3 + 90.0), (1.0, 0.5, 0.0)), 250.0, 0.2, 0.1, 0.3),
    Emitter((0.1, -1.0), -3.0, 101, CosinePower(1 / 3)),
    Emitter((0.1, -1.0), -3.0, 101, s_share=0.1),
    Ambient((0.1, 1 / 3), 30.0, 101, 4.0, power=0.25),
    RayFile(str(FILE), (0.1, -1.0), -3.0, 7, 0.2),
)
SCENE = Scene(
    (Region("air", 1.0), Region("body", 1.44, 0.01)),
    (
        *(Interface(f"i{i}", curve, "body", "air") for i, curve in enumerate(ALL_CURVES)),
        Interface("m", ALL_CURVES[0], "air", "air", "mirror"),
        Interface("a", ALL_CURVES[1], "air", "body", "absorbing"),
        Interface("r", ALL_CURVES[0], "air", "air", "receiver", "eye"),
    ),
    ALL_SOURCES,
    (Monitor("line", (0.0, 0.0), (1.0, 1.0), 8), Monitor("bare", (0.0, 1.0), (1.0, 1.0))),
    "everything",
    open_media=True,
)


def data() -> dict[str, Any]:
    return dict(json.loads(scenes.dumps(SCENE)))


def refused(text: str) -> str:
    with pytest.raises(SolenError) as refusal:
        scenes.loads(text, "scene.json")
    line = str(refusal.value)
    assert len(line.splitlines()) == 1
    return line


def test_round_trip_covers_every_curve_and_source() -> None:
    assert {type(curve) for curve in ALL_CURVES} == set(CURVES.values())
    assert {type(source) for source in ALL_SOURCES} == set(SOURCES.values())
    public = {value for value in vars(curves).values() if inspect.isclass(value) and issubclass(value, Curve)}
    assert {cls for cls in public if not inspect.isabstract(cls)} == set(CURVES.values())


def test_scene_read_back_equals_scene_written(tmp_path: Path) -> None:
    assert scenes.loads(scenes.dumps(SCENE)) == SCENE
    assert scenes.load(scenes.save(tmp_path / "s.json", SCENE)) == SCENE
    assert scenes.dumps(scenes.loads(scenes.dumps(SCENE))) == scenes.dumps(SCENE)


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(ends=st.tuples(st.tuples(finite, finite), st.tuples(finite, finite)), name=st.text())
def test_every_float_and_name_is_read_back(ends: Any, name: str) -> None:
    assume(ends[0] != ends[1])
    interface = Interface(name, Segment(*ends), "air", "air")
    scene = Scene((Region("air", 1.0),), (interface,), (ALL_SOURCES[0],), name=name)
    assert scenes.loads(scenes.dumps(scene)) == scene


def test_omits_defaults() -> None:
    face = Interface("face", ALL_CURVES[0], "air", "air")
    minimal = Scene((Region("air", 1.0),), (face,), (Fan((0.0, -1.0), 0.0, 60.0, 3),), (Monitor("m", (0, 1), (1, 1)),))
    text = json.loads(scenes.dumps(minimal))
    assert text["regions"] == [{"name": "air", "index": 1.0}]
    assert set(text["interfaces"][0]) == {"name", "curve", "left", "right"}
    assert set(text["sources"][0]) == {"kind", "point", "axis_deg", "cone_deg", "rays"}
    assert set(text["monitors"][0]) == {"name", "start", "end"}
    assert scenes.loads(json.dumps(text)) == minimal
    bare = Scene(minimal.regions, minimal.interfaces, minimal.sources)
    assert not {"monitors", "open_media"} & set(json.loads(scenes.dumps(bare)))
    assert scenes.loads(scenes.dumps(bare)) == bare


def test_writes_values_that_differ_from_defaults() -> None:
    text = data()
    assert text["regions"][1]["absorption_per_mm"] == 0.01
    assert (text["sources"][0]["power"], text["sources"][0]["s_share"]) == (0.25, 1.0)
    assert "power" not in text["sources"][1]
    assert text["sources"][1]["s_share"] == 0.0
    assert [text["interfaces"][-1][key] for key in ("behaviour", "receiver")] == ["receiver", "eye"]
    assert [monitor.get("bins") for monitor in text["monitors"]] == [8, None]
    assert text["open_media"] is True


def test_reads_scene_without_monitors_and_name() -> None:
    bare = {key: value for key, value in data().items() if key not in {"monitors", "name"}}
    assert scenes.loads(json.dumps(bare)).monitors == ()


@pytest.mark.parametrize(
    "text", ["", "{", "null", "[]", "3", "{}", '"text"', '{"solen_scene": 1}', '{"solen_scene": 1, "regions": 3}']
)
def test_refuses_text_that_is_not_a_scene(text: str) -> None:
    assert "scene.json" in refused(text)


def test_refuses_other_schema() -> None:
    assert "solen_scene = 2; this version of solen reads 1" in refused(json.dumps(data() | {"solen_scene": 2}))


@pytest.mark.parametrize(
    ("part", "key", "value"),
    [
        ("regions", "index", "high"),
        ("regions", "index", None),
        ("regions", "colour", "red"),
        ("interfaces", "curve", {"kind": "spiral"}),
        ("interfaces", "curve", {"a": [0, 0], "b": [1, 1]}),
        ("interfaces", "curve", {"kind": "segment", "a": [0, 0]}),
        ("interfaces", "curve", {"kind": ["segment"], "a": [0, 0], "b": [1, 1]}),
        ("interfaces", "curve", {"kind": "segment", "a": [0, 0], "b": [1, 1], "c": [2, 2]}),
        ("interfaces", "curve", {"kind": "spline", "control_points": "straight"}),
        ("interfaces", "curve", {"kind": "spline", "control_points": [[0, 0], [1, 0], [2, 1], [3, 1, 2]]}),
        ("interfaces", "curve", None),
        ("sources", "kind", "sun"),
        ("sources", "rays", "many"),
        ("sources", "colour", "red"),
        ("monitors", "colour", "red"),
    ],
)
def test_refuses_invalid_part_in_one_line(part: str, key: str, value: object) -> None:
    wrong = data()
    wrong[part][0][key] = value
    assert "scene" in refused(json.dumps(wrong))


@pytest.mark.parametrize("value", [1, 0, "true", None])
def test_refuses_open_media_that_is_not_boolean(value: object) -> None:
    assert "scene.json: open_media" in refused(json.dumps(data() | {"open_media": value}))


def test_refuses_open_media_unless_declared() -> None:
    with pytest.raises(DesignError, match="not closed"):
        scenes.loads(json.dumps(data() | {"open_media": False}))


def test_checks_of_scene_apply_to_files() -> None:
    wrong = data()
    wrong["regions"][1]["index"] = 0.5
    with pytest.raises(DesignError, match="region body"):
        scenes.loads(json.dumps(wrong))


@pytest.mark.parametrize(
    "curve",
    [
        {"kind": "spline", "control_points": [[0, 0], [1, 0], [2, 1], [3, 1], [4, 0]]},
        {"kind": "bezier", "a": [0, 0], "control_a": [0, 0], "control_b": [1, 1], "b": [2, 1]},
        {"kind": "conic", "vertex": [0, 0], "axis": [0, 1], "curvature_per_mm": 1, "conic_constant": 0}
        | {"from_mm": -1, "to_mm": 0.5},
    ],
)
def test_checks_of_curves_apply_to_files(curve: dict[str, Any]) -> None:
    wrong = data()
    wrong["interfaces"][0]["curve"] = curve
    assert refused(json.dumps(wrong)).startswith(curve["kind"])


def test_reports_missing_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        scenes.load(tmp_path / "none.json")


WRONG_TYPES: list[tuple[str, str, object]] = [
    ("interfaces", "curve", {"kind": "segment", "a": [0], "b": [1, 1]}),
    ("interfaces", "curve", {"kind": "segment", "a": "xy", "b": [1, 1]}),
    ("interfaces", "curve", {"kind": "segment", "a": [0, math.nan], "b": [1, 1]}),
    ("sources", "rays", 1.5),
    ("sources", "axis_deg", "up"),
    ("monitors", "bins", 2.5),
]


@pytest.mark.parametrize(("part", "key", "value"), WRONG_TYPES)
def test_refuses_values_of_wrong_type(part: str, key: str, value: object) -> None:
    wrong = data()
    wrong[part][0][key] = value
    refused(json.dumps(wrong))


def test_refuses_unknown_top_level_key() -> None:
    line = refused(json.dumps(data() | {"interface": []}))
    assert "scene.json: interface; unknown key; the known keys are extrusion, interfaces, monitors, name" in line


@pytest.mark.parametrize("part", ["regions", "interfaces", "sources", "monitors"])
def test_reports_position_of_unknown_or_missing_key(part: str) -> None:
    wrong = data()
    wrong[part][1]["colour"] = "red"
    assert f"scene.json: {part}[1]: colour; unknown key" in refused(json.dumps(wrong))
    wrong = data()
    needed = {"regions": "index", "interfaces": "left", "sources": "direction_deg", "monitors": "end"}[part]
    del wrong[part][1][needed]
    assert f"scene.json: {part}[1]: {needed}; is missing" in refused(json.dumps(wrong))


@pytest.mark.parametrize("kind", [None, 3, ["fan"], {"fan": 1}, "sun"])
@pytest.mark.parametrize("part", ["interfaces", "sources"])
def test_refuses_unknown_kind(part: str, kind: object) -> None:
    wrong = data()
    (wrong[part][0]["curve"] if part == "interfaces" else wrong[part][0])["kind"] = kind
    assert "must be one of" in refused(json.dumps(wrong))


def test_refuses_deeply_nested_json() -> None:
    refused("[" * 100_000)


class CustomCurve(Segment):
    """A curve that scene files do not support."""


@pytest.mark.parametrize("curve", [CustomCurve((0.0, 0.0), (1.0, 0.0))])
def test_refuses_to_write_custom_curve(curve: Curve) -> None:
    scene = Scene((Region("air", 1.0),), (Interface("i", curve, "air", "air"),), (ALL_SOURCES[0],))
    with pytest.raises(
        DesignError, match="CustomCurve; a scene file supports only segment, arc, parabola, cartesian-oval"
    ) as refusal:
        scenes.dumps(scene)
    assert len(str(refusal.value).splitlines()) == 1


INDICES: tuple[Dispersion, ...] = (
    Constant(n=1.44, u_n=0.002, valid_nm=(400.0, 1000.0)),
    Tabulated(
        wavelength_nm=(400.0, 500.0, 1000.0),
        n=(1.6, 1 / 0.7, 1.4),
        covariance=((1e-6, 0, 0), (0, 2e-6, 0), (0, 0, 1e-6)),
    ),
    Cauchy(A=1.5, B_um2=0.004, covariance=((1e-6, 1e-9, 0.0), (1e-9, 1e-8, 0.0), (0.0, 0.0, 0.0))),
    Sellmeier(B=(1.1, 0.2), C_um2=(0.01, 1 / 90), valid_nm=(400.0, 1000.0)),
)
SPECTRUM = ((860.0, 1.0), (1850.0 / 3.0, 0.1 + 0.2))
COLOURFUL = Scene(
    (Region("air", 1.0), *(Region(f"resin-{i}", index, 0.01 * i) for i, index in enumerate(INDICES))),
    (Interface("face", ALL_CURVES[0], "air", "air"),),
    tuple(dataclasses.replace(source, spectrum=SPECTRUM) for source in ALL_SOURCES),
)


def test_round_trip_covers_every_dispersion() -> None:
    assert {type(index) for index in INDICES} == set(KINDS.values())


def test_spectra_and_dispersions_read_back_equal_those_written() -> None:
    again = scenes.loads(scenes.dumps(COLOURFUL))
    assert again == COLOURFUL
    assert scenes.dumps(again) == scenes.dumps(COLOURFUL)
    for before, after in zip(COLOURFUL.regions, again.regions, strict=True):
        assert [after.index_at(nm) for nm in again.wavelengths_nm] == [
            before.index_at(nm) for nm in COLOURFUL.wavelengths_nm
        ]
        if isinstance(before.index, Dispersion):
            assert isinstance(after.index, Dispersion)
            assert after.index.u_index(860.0) == before.index.u_index(860.0)


def test_writes_readable_dispersions_and_spectra() -> None:
    text = json.loads(scenes.dumps(COLOURFUL))
    assert text["regions"][0] == {"name": "air", "index": 1.0}
    assert text["regions"][4]["index"] == {
        "kind": "sellmeier",
        "B": [1.1, 0.2],
        "C_um2": [0.01, 1 / 90],
        "valid_nm": [400.0, 1000.0],
    }
    assert [source["spectrum"] for source in text["sources"]] == [[list(line) for line in SPECTRUM]] * len(ALL_SOURCES)
    assert "spectrum" not in data()["sources"][0]


@pytest.mark.parametrize(
    ("index", "message"),
    [
        ({"A": 1.5}, "scene.json: regions[0]: index: kind; must be one of number, table, cauchy, sellmeier"),
        ({"kind": "abbe", "A": 1.5}, "index: kind = 'abbe'; must be one of"),
        ({"kind": ["cauchy"], "A": 1.5}, "index: kind = "),
        ({"kind": "cauchy"}, "scene.json: regions[0]: index: "),
        ({"kind": "cauchy", "A": "high"}, "scene.json: regions[0]: index: "),
        ({"kind": "cauchy", "A": 1.5, "D": 1.0}, "scene.json: regions[0]: index: "),
        ({"kind": "cauchy", "A": 1.5, "valid_nm": [900.0, 400.0]}, "scene.json: regions[0]: index: "),
        ({"kind": "table", "wavelength_nm": [1000.0, 400.0], "n": [1.4, 1.5]}, "scene.json: regions[0]: index: "),
    ],
)
def test_reports_position_of_invalid_index(index: object, message: str) -> None:
    wrong = data()
    wrong["regions"][0]["index"] = index
    assert message in refused(json.dumps(wrong))


@pytest.mark.parametrize("spectrum", [860.0, [860.0, 1.0], [[860.0]], [[860.0, 1.0, 2.0]], [["red", 1.0]], "red", None])
def test_reports_position_of_invalid_spectrum(spectrum: object) -> None:
    wrong = data()
    wrong["sources"][3]["spectrum"] = spectrum
    assert "scene.json: sources[3]: spectrum" in refused(json.dumps(wrong))


def test_checks_of_spectra_apply_to_files() -> None:
    wrong = data()
    wrong["sources"][0]["spectrum"] = [[860.0, 1.0]]
    assert "source spectrum; is missing in 8 of 9 sources" in refused(json.dumps(wrong))
    wrong = json.loads(scenes.dumps(COLOURFUL))
    wrong["sources"][0]["spectrum"] = [[1000.5, 1.0]]
    assert "index at 1000.5 nm; is known only from 400 to 1000 nm" in refused(json.dumps(wrong))
    for source in wrong["sources"]:
        del source["spectrum"]
    assert "region resin-0 index; depends on the wavelength" in refused(json.dumps(wrong))


class CustomIndex(Cauchy):
    """An index that scene files do not support."""


def test_refuses_to_write_custom_index() -> None:
    source = dataclasses.replace(ALL_SOURCES[0], spectrum=SPECTRUM)
    scene = Scene((Region("air", CustomIndex(A=1.2)),), (Interface("i", ALL_CURVES[0], "air", "air"),), (source,))
    with pytest.raises(DesignError, match="CustomIndex; a scene file supports only number, table, cauchy, sellmeier"):
        scenes.dumps(scene)


def test_reports_position_of_invalid_layer() -> None:
    wrong = data()
    wrong["interfaces"][0]["surface"] = {"coating": {"layers": [1]}}
    line = refused(json.dumps(wrong))
    assert line.startswith("scene.json: interfaces[0]: surface: coating: layers[0] = 1; must be an object")
