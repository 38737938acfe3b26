"""Prints of lenses that vary with height: doses, compensation, files and uncertainties."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import solen.cli.print.predict  # noqa: F401 - registers the printed lines
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
from solen.lens import LayeredLens, LayeredLensFromFile, LensInSpace, read_layers
from solen.pipeline.print.predict import predict
from solen.sensor import Sensor
from solen.sensor.lens_responses import LensResponse, lens_responses
from solen.spec import Design, dumps, load, with_values
from tests.fabricate.direct_dose import dose_at
from tests.fabricate.print_support import box, process, settings
from tests.fabricate.solid_support import design

SPACE = {"emitter.pattern": "lambertian", "trace.dimension": "extruded", "lens.shape": "layered"}
SMALL = SPACE | {"lens.half_width_mm": 0.6, "emitter.distance_mm": 0.5, "body.thickness_mm": 0.5}
"""A lens 1.2 mm wide, in a body of ten layers of 50 µm."""
COARSE = {"layer_um": 50.0, "burn_in_layers": 2, "pixel_um": 30.0, "sigma_um": 20.0}


def small(**values: Any) -> Design:
    return with_values(design(), SMALL | {key.replace("__", "."): value for key, value in values.items()})


def face_print(layer_um: float = 50.0, **values: Any) -> FacePrint:
    sensor = Sensor.of(small(**{"lens__layer_mm": 0.05} | values))
    return FacePrint.of(sensor.body(), settings(**COARSE | {"layer_um": layer_um}))


def test_doses_of_different_layers_agree_with_direct_sums() -> None:
    """Each of six layers is a box that is shifted to the right."""
    s = settings(pixel_um=50.0, sigma_um=30.0, halo_um=60.0, halo_fraction=0.2, layer_um=40.0, burn_in_layers=1)
    layers = [[box((0.2 - 0.03 * k, 1.2 + 0.05 * k), (0.2, 1.0))] for k in range(6)]
    extent = np.array([(0.0, 0.0), (1.6, 1.2)])
    stack = Stack.of(layers, extent, s)
    corner = np.array(stack.grid.corner_um)
    images = np.array([FlatImage.of(rings, extent, s, 6).light for rings in layers])
    points = np.array([(1210.0, 600.0), (1290.0, 620.0), (1420.0, 500.0), (130.0, 610.0), (700.0, 600.0)])
    for layer in (0, 2, 5):
        direct = dose_at(images, s, points - corner, stack.height_um(layer))
        dose = s.Ec_mJ_per_cm2 * np.exp(stack.dose(layer).log_excess(points))
        assert dose == pytest.approx(direct, abs=0.05)


def test_a_cylinder_prints_like_a_single_image() -> None:
    model = face_print(lens__layer_mm=0.5)
    upright = section(model.body, 0.0)
    target = Target.of(lens_face(upright).curve, 401)
    flat = FlatPrint.of(rings_of(as_designed(upright)), target, model.settings, 0.5)
    face = model.printed()
    for layer in (0, 5, 9):
        offsets_um = flat.offsets_um((layer + 0.5) * 50.0)
        assert offsets_um == pytest.approx(offsets_um[::-1], abs=1e-6)
        assert face.um[layer] == pytest.approx(offsets_um[200:], abs=1.1)  # equal layers are computed within 1 µm
    assert len({round(float(row[0]), 6) for row in face.um}) > 2


def test_refuses_a_response_that_is_not_symmetric(tmp_path: Path) -> None:
    """Only one half of each layer is computed."""
    light = np.zeros((25, 25))
    light[8:17, 8:14], light[10:15, 14:20] = 1.0, 0.4
    table = {"light": light.tolist(), "pitch_um": 5.0, "centre_um": [55.0, 60.0]}
    asymmetric = process(**COARSE | {"sigma_um": None, "response": table})
    (tmp_path / "process.toml").write_text(process_text(asymmetric), encoding="utf-8")
    with pytest.raises(SpecError, match=r"process\.response"):
        print_layers(Sensor.of(small(lens__layer_mm=0.05)), PrintOptions(process=tmp_path / "process.toml"))


def test_compensates_print_through_of_overhangs() -> None:
    model = face_print(body__thickness_mm=1.0, lens__layer_mm=0.1, layer_um=100.0)
    uncompensated = model.printed()
    lower, upper = uncompensated.um[2, 100:180].mean(), uncompensated.um[7, 100:180].mean()
    assert upper > lower + 8.0  # the upper half of the lens is an overhang
    face = model.compensated(uncompensated)
    deviation = (face.printed - model.intended)[:, :230]
    assert 1e3 * float(np.sqrt(np.mean(deviation**2))) < 1.5 < 0.1 * uncompensated.rms_um
    assert face.rounds_um[0] > 5.0 * face.rounds_um[-1]
    repeated = FacePrint.of(model.drawn_body(face.drawn), model.settings).printed()
    assert repeated.printed[:, :230] == pytest.approx(face.printed[:, :230], abs=1e-4)


@pytest.fixture(scope="module")
def prediction(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PrintedLayers]:
    """Folder with the files of a print by a process without uncertainties, and its result."""
    folder = tmp_path_factory.mktemp("print")
    (folder / "lens.toml").write_text(dumps(small()), encoding="utf-8")
    (folder / "process.toml").write_text(process_text(process(**COARSE)), encoding="utf-8")
    outcome = predict(
        folder / "lens.toml",
        options=PrintOptions(process=folder / "process.toml"),
        response=False,
        out=folder / "printed.json",
        compensate=folder / "drawn.toml",
    )
    assert isinstance(outcome.result, PrintedLayers)
    names = {"printed.json", "drawn.toml", "drawn-drawn.json", "drawn-printed.json"}
    assert {path.name for path in outcome.files.values()} == names
    return folder, outcome.result


def test_a_printed_lens_can_be_used_in_a_design(prediction: tuple[Path, PrintedLayers]) -> None:
    folder, result = prediction
    assert result.layers == 10  # layers of the process, 50 µm
    assert result.simulated
    lens = Sensor.of(with_values(load(folder / "lens.toml"), {"lens.profile": "printed.json"})).lens
    assert isinstance(lens, LayeredLensFromFile)
    assert lens.simulated
    assert "predicted by a print model" in " ".join(lens.warnings)
    printed = result.face.printed
    assert lens.z_at(np.array([0.3]), np.array([-0.225])) == pytest.approx(printed[-1, 128], abs=1e-6)
    assert lens.z_at(np.array([0.3]), np.array([0.225])) == pytest.approx(printed[0, 128], abs=1e-6)
    assert lens.nearest_mm < 0.0  # grown towards the emitter


def test_the_drawing_is_a_design_that_can_be_exported(prediction: tuple[Path, PrintedLayers]) -> None:
    folder, result = prediction
    assert "<function" not in (folder / "drawn.toml").read_text(encoding="utf-8")
    drawn = load(folder / "drawn.toml")
    assert "drawn for the printer" in drawn.name
    part = sensor_part(drawn, Sensor.of(drawn).body())
    assert len(part.prisms) == 10
    assert mesh_of(part, 1e-3).volume_mm3 == pytest.approx(part.volume_mm3, rel=1e-3)
    assert result.compensated is not None
    profiles = read_layers(folder / "drawn-drawn.json")
    assert profiles.z_mm == pytest.approx(result.compensated.drawn[::-1], abs=1e-8)
    low, high = result.drawn_range_um or (0.0, 0.0)
    assert low < high < 0.0  # all profiles are drawn smaller


def test_the_uncertainty_includes_an_unknown_position_in_the_pixel(prediction: tuple[Path, PrintedLayers]) -> None:
    folder, default = prediction
    assert all(0.0 < deviation.u_rms_um < 9.0 for deviation in default.deviations)
    assert any("--phase-px" in warning for warning in default.warnings)
    options = PrintOptions(process=folder / "process.toml", phase_px=(0.5, 0.5))
    known = print_layers(Sensor.of(load(folder / "lens.toml")), options, response=False)
    assert not any("--phase-px" in warning for warning in known.warnings)
    for deviation, exact in zip(default.deviations, known.deviations, strict=True):
        difference = known.face.um[deviation.layer - 1] - default.face.um[deviation.layer - 1]
        assert exact.u_rms_um == 0.0
        assert deviation.u_rms_um == pytest.approx(np.sqrt(np.mean(difference**2) / 3.0), rel=0.3)


@pytest.mark.parametrize(
    ("out", "message"), [("a-printed.json", "is also another output of this command"), (None, "is an input file")]
)
def test_refuses_to_overwrite_outputs_and_inputs(
    prediction: tuple[Path, PrintedLayers], tmp_path: Path, out: str | None, message: str
) -> None:
    """The profiles of the design have the name of those of the drawing."""
    profile = "a-drawn.json"
    (tmp_path / profile).write_bytes((prediction[0] / "drawn-drawn.json").read_bytes())
    (tmp_path / "lens.toml").write_text(dumps(small(lens__profile=profile)), encoding="utf-8")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    target = None if out is None else tmp_path / out
    options = PrintOptions(process=prediction[0] / "process.toml")
    with pytest.raises(OutputError, match=message):
        predict(tmp_path / "lens.toml", options=options, response=False, out=target, compensate=tmp_path / "a.toml")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_line_focus_lens_is_printed_layer_by_layer(tmp_path: Path) -> None:
    (tmp_path / "process.toml").write_text(process_text(process(**COARSE)), encoding="utf-8")
    sensor = Sensor.of(with_values(small(), {"lens.shape": "line-focus", "lens.y_focus_mm": 3.0}))
    result = print_layers(sensor, PrintOptions(process=tmp_path / "process.toml"), response=False)
    assert (result.shape, result.layers, result.compensated_rms_um) == ("line-focus", 10, None)
    assert isinstance(sensor.lens, LensInSpace)
    lens = result.model.lens_of(result.profile)
    x, y = np.linspace(0.0, 0.5, 21), np.full(21, 0.125)
    growth_um = 1e3 * (sensor.lens.z_at(x, y) - lens.z_at(x, y)) / np.hypot(1.0, sensor.lens.slope_at(x, y))
    assert float(growth_um.mean()) == pytest.approx(float(result.face.um[2, :160].mean()), rel=0.1)


def test_a_thickness_that_is_not_a_multiple_of_a_layer_has_the_layers_of_the_lens(tmp_path: Path) -> None:
    (tmp_path / "process.toml").write_text(process_text(process(**COARSE | {"layer_um": 150.0})), encoding="utf-8")
    sensor = Sensor.of(small(lens__layer_mm=0.15))
    result = print_layers(sensor, PrintOptions(process=tmp_path / "process.toml"), response=False)
    assert isinstance(sensor.lens, LayeredLens)
    assert result.layers == sensor.lens.layers == 3
    assert result.profile.edges_mm == pytest.approx(sensor.lens.edges_mm, abs=1e-12)
    assert result.model.intended[::-1] == pytest.approx(sensor.lens.profiles[0], abs=1e-9)
    assert re.search("2 layers of 0.15 mm .*0.2 mm", " ".join(result.warnings))


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
def test_refuses_unsupported_options(options: PrintOptions, part: bool, words: tuple[str, ...]) -> None:
    with pytest.raises(SpecError) as error:
        print_layers(Sensor.of(small()), options, part=part)
    assert [word for word in words if word not in str(error.value)] == []


def test_responses_of_lenses_agree_with_those_of_the_sensor() -> None:
    sensor = Sensor.of(
        with_values(design(), SPACE | {"emitter.width_mm": 0.2, "emitter.height_mm": 0.2, "emitter.cone_deg": 120.0})
    )
    (response,) = lens_responses({"sensor": sensor}, [3.0])
    assert response.contrast[0] == pytest.approx(0.908, abs=0.006)
    assert 0.0 < response.u_contrast[0] < 3e-3
    assert response.light == pytest.approx(0.636, abs=0.03)


def test_errors_at_all_angles_are_correlated(monkeypatch: pytest.MonkeyPatch) -> None:
    """All angles are sampled with the same seed, so the uncertainty of a mean does not decrease with their number."""
    sensor = Sensor.of(with_values(design(), SPACE))
    trace = sensor.scene(0.0, 64)
    monkeypatch.setattr(Sensor, "sampled", lambda _, angle_deg, *__: (trace, 1e-3 * abs(angle_deg)))
    monkeypatch.setattr("solen.sensor.response.powers", lambda _: {"right": 0.3, "left": 0.1})
    (response,) = lens_responses({"sensor": sensor}, [0.5, 0.5, 0.5, 0.25])
    assert response.light == pytest.approx(0.4)
    assert response.u_light == pytest.approx(2.0 * 0.5e-3)
    assert response.u_contrast[0] == pytest.approx(2.0 * 0.5e-3 / 0.4)


def test_uncertainty_of_the_remaining_contrast(prediction: tuple[Path, PrintedLayers]) -> None:
    angle = np.array([0.5, 1.0])

    def lens(name: str, contrast: list[float], u: float) -> LensResponse:
        return LensResponse(name, angle, np.array(contrast), np.full(2, u), 0.6, 1e-3)

    responses = (lens("cylinder, printed", [0.2, 0.0], 0.002), lens("layered, printed", [0.3, 0.4], 0.005))
    result = replace(prediction[1], responses=responses)
    assert result.remaining["layered, printed"] == pytest.approx((1.5, np.nan), nan_ok=True)
    assert result.u_remaining["layered, printed"] == pytest.approx((0.04, np.nan), nan_ok=True)
    assert result.u_remaining["cylinder, printed"] == pytest.approx((0.0, np.nan), nan_ok=True)
    assert "layered, printed          1.500 ± 0.04" in "\n".join(lines(result))
    assert replace(prediction[1], responses=()).u_remaining == {}
