"""Lenses that differ by height, printed by the model layer by layer: doses by direct sums, compensation, and files."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import solen.cli.print.predict  # noqa: F401  registers its lines
from solen.cli.app import lines
from solen.errors import OutputError, SpecError
from solen.fabricate import mesh_of, sensor_part
from solen.fabricate.process import (
    FlatImage,
    FlatPrint,
    PrintedLayers,
    PrintOptions,
    Target,
    as_designed,
    lens_face,
    print_layers,
    process_text,
    rings_of,
)
from solen.fabricate.process.face_print import FacePrint
from solen.fabricate.process.stack import Stack
from solen.geometry import section
from solen.lens import LayeredLens, LayeredLensFromFile, read_layers
from solen.pipeline.print.predict import predict
from solen.sensor import Sensor
from solen.sensor.lens_responses import LensResponse, lens_responses
from solen.spec import Design, dumps, load, with_values
from tests.fabricate.direct_dose import dose_at
from tests.fabricate.print_support import box, process, settings
from tests.fabricate.solid_support import design

SPACE = {"emitter.pattern": "lambertian", "trace.dimension": "extruded", "lens.shape": "layered"}
SMALL = SPACE | {"lens.half_width_mm": 0.6, "emitter.distance_mm": 0.5, "body.thickness_mm": 0.5}
"""A lens 1.2 mm wide in a body of ten layers of 50 µm."""
FAST = {"layer_um": 50.0, "burn_in_layers": 2, "pixel_um": 30.0, "sigma_um": 20.0}


def small(**values: Any) -> Design:
    return with_values(design(), SMALL | {key.replace("__", "."): value for key, value in values.items()})


def printing(layer_um: float = 50.0, **values: Any) -> FacePrint:
    chosen = small(**{"lens__layer_mm": 0.05} | values)
    return FacePrint.of(Sensor.of(chosen).body(), settings(**FAST | {"layer_um": layer_um}))


def test_the_dose_of_different_layers_is_the_direct_sum() -> None:
    """Six layers, each with its own box: an overhang to the right, and one that stands back to the left."""
    s = settings(pixel_um=50.0, sigma_um=30.0, halo_um=60.0, halo_fraction=0.2, layer_um=40.0, burn_in_layers=1)
    layers = [[box((0.2 - 0.03 * k, 1.2 + 0.05 * k), (0.2, 1.0))] for k in range(6)]
    extent = np.array([(0.0, 0.0), (1.6, 1.2)])
    stack = Stack.of(layers, extent, s)
    corner = np.array(stack.grid.corner_um)
    images = np.array([FlatImage.of(rings, extent, s, 6).shares for rings in layers])
    places = np.array([(1210.0, 600.0), (1290.0, 620.0), (1420.0, 500.0), (130.0, 610.0), (700.0, 600.0)])
    for layer in (0, 2, 5):
        direct = dose_at(images, s, places - corner, stack.height_um(layer))
        found = s.Ec_mJ_per_cm2 * np.exp(stack.dose(layer).log_excess(places))
        assert found == pytest.approx(direct, abs=0.05)


def test_a_cylinder_prints_as_one_image_does() -> None:
    model = printing(lens__layer_mm=0.5)
    upright = section(model.body, 0.0)
    target = Target.of(lens_face(upright).curve, 401)
    flat = FlatPrint.of(rings_of(as_designed(upright)), target, model.settings, 0.5)
    found = model.printed()
    for layer in (0, 5, 9):
        whole = flat.offsets_um((layer + 0.5) * 50.0)
        assert whole == pytest.approx(whole[::-1], abs=1e-6)
        assert found.um[layer] == pytest.approx(whole[200:], abs=1.1)  # slabs that print alike within 1 µm are one
    assert len({round(float(row[0]), 6) for row in found.um}) > 2


def test_a_response_that_parts_the_halves_is_refused(tmp_path: Path) -> None:
    """One half of each layer is printed for both."""
    light = np.zeros((25, 25))
    light[8:17, 8:14], light[10:15, 14:20] = 1.0, 0.4
    table = {"light": light.tolist(), "pitch_um": 5.0, "centre_um": [55.0, 60.0]}
    made = process(**FAST | {"sigma_um": None, "response": table})
    (tmp_path / "process.toml").write_text(process_text(made), encoding="utf-8")
    with pytest.raises(SpecError, match=r"process\.response.*equally"):
        print_layers(Sensor.of(small(lens__layer_mm=0.05)), PrintOptions(process=tmp_path / "process.toml"))


def test_light_of_later_layers_fills_overhangs_and_compensation_takes_it_back() -> None:
    model = printing(body__thickness_mm=1.0, lens__layer_mm=0.1, layer_um=100.0)
    plain = model.printed()
    lower, upper = plain.um[2, 100:180].mean(), plain.um[7, 100:180].mean()
    assert upper > lower + 8.0  # the upper half of the lens hangs over
    made = model.compensated(plain)
    inner = np.abs(made.printed - model.wanted)[:, :230]
    assert 1e3 * float(np.sqrt(np.mean(inner**2))) < 1.5 < 0.1 * plain.rms_um
    assert made.rounds_um[0] > 5.0 * made.rounds_um[-1]
    again = FacePrint.of(model.drawn_body(made.drawn), model.settings).printed()
    assert again.printed[:, :230] == pytest.approx(made.printed[:, :230], abs=1e-4)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PrintedLayers]:
    """A print and its files, by a process without uncertainty."""
    folder = tmp_path_factory.mktemp("print")
    (folder / "lens.toml").write_text(dumps(small()), encoding="utf-8")
    (folder / "process.toml").write_text(process_text(process(**FAST)), encoding="utf-8")
    made = predict(
        folder / "lens.toml",
        options=PrintOptions(process=folder / "process.toml"),
        response=False,
        out=folder / "printed.json",
        compensate=folder / "drawn.toml",
    )
    assert isinstance(made.result, PrintedLayers)
    assert {path.name for path in made.files.values()} == {
        "printed.json",
        "drawn.toml",
        "drawn-drawn.json",
        "drawn-printed.json",
    }
    return folder, made.result


def test_a_printed_lens_goes_back_into_the_design(files: tuple[Path, PrintedLayers]) -> None:
    folder, made = files
    assert made.layers == 10  # of the process's 50 µm: the design states none
    assert made.simulated
    lens = Sensor.of(with_values(load(folder / "lens.toml"), {"lens.profile": "printed.json"})).lens
    assert isinstance(lens, LayeredLensFromFile)
    assert lens.simulated
    assert "predicted by a print model" in " ".join(lens.warnings)
    assert lens.z_at(np.array([0.3]), np.array([-0.225])) == pytest.approx(made.face.printed[-1, 128], abs=1e-6)
    assert lens.z_at(np.array([0.3]), np.array([0.225])) == pytest.approx(made.face.printed[0, 128], abs=1e-6)
    assert lens.nearest_mm < 0.0  # it has grown towards the emitter


def test_the_drawing_is_a_design_that_can_be_made(files: tuple[Path, PrintedLayers]) -> None:
    folder, made = files
    drawn = load(folder / "drawn.toml")
    assert "as drawn for the printer" in drawn.name
    part = sensor_part(drawn, Sensor.of(drawn).body())
    assert len(part.prisms) == 10
    assert mesh_of(part, 1e-3).volume_mm3 == pytest.approx(part.volume_mm3, rel=1e-3)
    assert made.compensated is not None
    profiles = read_layers(folder / "drawn-drawn.json")
    assert profiles.z_mm == pytest.approx(made.compensated.drawn[::-1], abs=1e-8)
    low, high = made.drawn_range_um or (0.0, 0.0)
    assert low < high < 0.0  # all of it is drawn back


def test_the_place_in_the_pixel_is_uncertain_unless_it_is_stated(files: tuple[Path, PrintedLayers]) -> None:
    folder, made = files
    assert all(0.0 < one.u_rms_um < 9.0 for one in made.deviations)
    assert any("--phase-px is not specified" in text for text in made.warnings)
    options = PrintOptions(process=folder / "process.toml", phase_px=(0.5, 0.5))
    moved = print_layers(Sensor.of(load(folder / "lens.toml")), options, response=False)
    assert not any("--phase-px" in text for text in moved.warnings)
    for one, other in zip(made.deviations, moved.deviations, strict=True):
        off = moved.face.um[one.layer - 1] - made.face.um[one.layer - 1]
        assert other.u_rms_um == 0.0
        assert one.u_rms_um == pytest.approx(np.sqrt(np.mean(off**2) / 3.0), rel=0.3)  # of slabs that print alike


@pytest.mark.parametrize(
    ("out", "what"), [("a-printed.json", "is also another output of this command"), (None, "is an input file")]
)
def test_no_file_is_written_twice_and_no_source_at_all(
    files: tuple[Path, PrintedLayers], tmp_path: Path, out: str | None, what: str
) -> None:
    """Of a design whose layers were drawn before, by the name that its drawing would have."""
    profile = "a-drawn.json"
    (tmp_path / profile).write_bytes((files[0] / "drawn-drawn.json").read_bytes())
    (tmp_path / "lens.toml").write_text(dumps(small(lens__profile=profile)), encoding="utf-8")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    target = None if out is None else tmp_path / out
    options = PrintOptions(process=files[0] / "process.toml")
    with pytest.raises(OutputError, match=what):
        predict(tmp_path / "lens.toml", options=options, response=False, out=target, compensate=tmp_path / "a.toml")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_smooth_face_is_printed_by_its_sections(tmp_path: Path) -> None:
    (tmp_path / "process.toml").write_text(process_text(process(**FAST)), encoding="utf-8")
    sensor = Sensor.of(with_values(small(), {"lens.shape": "line-focus", "lens.y_focus_mm": 3.0}))
    made = print_layers(sensor, PrintOptions(process=tmp_path / "process.toml"), response=False)
    assert (made.shape, made.layers, made.compensated_rms_um) == ("line-focus", 10, None)
    lens = made.model.lens_of(made.profile)
    x, y = np.linspace(0.0, 0.5, 21), np.full(21, 0.125)
    lean = np.hypot(1.0, sensor.lens.slope_at(x, y))  # type: ignore[attr-defined]  # a lens for skew rays
    off_um = 1e3 * (sensor.lens.z_at(x, y) - lens.z_at(x, y)) / lean  # type: ignore[attr-defined]  # a lens for skew rays
    assert float(off_um.mean()) == pytest.approx(float(made.face.um[2, :160].mean()), rel=0.1)


def test_a_body_of_no_whole_number_of_layers_has_the_lens_s_layers(tmp_path: Path) -> None:
    (tmp_path / "process.toml").write_text(process_text(process(**FAST | {"layer_um": 150.0})), encoding="utf-8")
    sensor = Sensor.of(small(lens__layer_mm=0.15))
    made = print_layers(sensor, PrintOptions(process=tmp_path / "process.toml"), response=False)
    assert isinstance(sensor.lens, LayeredLens)
    assert made.layers == sensor.lens.layers == 3
    assert made.profile.edges_mm == pytest.approx(sensor.lens.edges_mm, abs=1e-12)
    assert made.model.wanted[::-1] == pytest.approx(sensor.lens.profiles[0], abs=1e-9)
    assert "0.5 mm is 2 layers of 0.15 mm and one of 0.2 mm" in " ".join(made.warnings)


@pytest.mark.parametrize(
    ("options", "part", "words"),
    [
        (PrintOptions(orientation="upright"), False, ("--orientation", "flat")),
        (PrintOptions(choose_phase=True), False, ("--choose-phase",)),
        (PrintOptions(phase_px=(0.25, 0.0)), False, ("--phase-px", "0.5")),
        (PrintOptions(at="mean"), False, ("--at", "all heights")),
        (PrintOptions(), True, ("--solid",)),
    ],
)
def test_what_is_not_offered_is_refused(options: PrintOptions, part: bool, words: tuple[str, ...]) -> None:
    with pytest.raises(SpecError) as refusal:
        print_layers(Sensor.of(small()), options, part=part)
    assert all(word in str(refusal.value) for word in words)


def test_responses_of_lenses_are_those_of_the_sensor() -> None:
    sensor = Sensor.of(
        with_values(design(), SPACE | {"emitter.width_mm": 0.2, "emitter.height_mm": 0.2, "emitter.cone_deg": 120.0})
    )
    (found,) = lens_responses({"own": sensor}, [3.0])
    assert found.contrast[0] == pytest.approx(0.908, abs=0.006)
    assert 0.0 < found.u_contrast[0] < 3e-3
    assert found.light == pytest.approx(0.636, abs=0.03)


def test_errors_of_all_angles_are_counted_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are sampled with the same seed: a mean over more angles is not known any better."""
    sensor = Sensor.of(with_values(design(), SPACE))
    trace = sensor.scene(0.0, 64)
    monkeypatch.setattr(Sensor, "sampled", lambda *asked: (trace, 1e-3 * abs(asked[1])))
    monkeypatch.setattr("solen.sensor.response.powers", lambda _: {"right": 0.3, "left": 0.1})
    (found,) = lens_responses({"own": sensor}, [0.5, 0.5, 0.5, 0.25])
    assert found.light == pytest.approx(0.4)
    assert found.u_light == pytest.approx(2.0 * 0.5e-3)
    assert found.u_contrast[0] == pytest.approx(2.0 * 0.5e-3 / 0.4)


def test_what_remains_has_its_uncertainty(files: tuple[Path, PrintedLayers]) -> None:
    angle = np.array([0.5, 1.0])

    def lens(name: str, contrast: list[float], u: float) -> LensResponse:
        return LensResponse(name, angle, np.array(contrast), np.full(2, u), 0.6, 1e-3)

    responses = (lens("cylinder, printed", [0.2, 0.0], 0.002), lens("layered, printed", [0.3, 0.4], 0.005))
    made = replace(files[1], responses=responses)
    assert made.remaining["layered, printed"] == pytest.approx((1.5, np.nan), nan_ok=True)
    assert made.u_remaining["layered, printed"] == pytest.approx((0.04, np.nan), nan_ok=True)
    assert made.u_remaining["cylinder, printed"] == pytest.approx((0.0, np.nan), nan_ok=True)
    assert "layered, printed          1.500 ± 0.04" in "\n".join(lines(made))
    assert replace(files[1], responses=()).u_remaining == {}
