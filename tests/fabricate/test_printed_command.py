"""`solen print predict` and `solen print calibrate`: results, files and errors."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DataError, OutputError, SolenError, SpecError
from solen.fabricate.process import (
    MeasuredFeature,
    Orientation,
    PrintedDesign,
    PrintOptions,
    default_process,
    parsed_process,
    printed_mm,
    process_of,
    process_text,
    read_features,
    read_process,
    with_resin,
)
from solen.fabricate.process.source import curve_cautions
from solen.lens.profile import read_profile
from solen.pipeline.design.designs import open_design
from solen.pipeline.design.export import export
from solen.pipeline.print.calibrate import calibrate as calibrate_printer
from solen.pipeline.print.predict import predict
from solen.report.options import FigureOptions
from solen.sensor import Sensor
from solen.spec import template
from tests.fabricate.print_support import process_file, settings
from tests.fabricate.solid_support import oval_z

PROCESS = """schema = 1
name = "test"

[process]
sigma_um = 14.0
"""
"""A process file with a single parameter."""


@pytest.fixture
def sensor(tmp_path: Path) -> Path:
    path = tmp_path / "sensor.toml"
    path.write_text(template("paper-860"), encoding="utf-8")
    return path


def printed_design(file: Path, **options: Any) -> PrintedDesign:
    """Return the result of the command for a sensor that is a prism."""
    result = predict(file, **options).result
    assert isinstance(result, PrintedDesign)
    return result


@pytest.fixture(scope="module")
def prediction(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PrintedDesign]:
    """Folder with all files of a print, and its result."""
    folder = tmp_path_factory.mktemp("print")
    sensor = folder / "sensor.toml"
    sensor.write_text(template("paper-860"), encoding="utf-8")
    result = printed_design(
        sensor,
        options=PrintOptions(process=process_file(folder)),
        response=False,
        out=folder / "lens.json",
        compensate=folder / "drawn.toml",
        figure=FigureOptions(figure=folder / "print.svg"),
    )
    return folder, result


def test_result_and_files_of_a_print(prediction: tuple[Path, PrintedDesign]) -> None:
    folder, result = prediction
    values = result.to_dict()
    json.dumps(values, allow_nan=False)
    assert values["simulated"] is True
    assert result.deviation.rms_um > 20.0
    assert values["walls"]["layers"] == 160
    assert values["response"] is None
    assert values["sources"][0]["file"] == "process.toml"
    assert values["settings"]["exposure_s"] == 2.0
    assert result.compensation is not None
    assert result.compensation.printed.rms_um < 5.0
    profile = read_profile(folder / "lens.json")
    assert profile.simulated
    assert profile.edge == "predicted"
    deviation_um = 1e3 * (profile.z_mm - oval_z(np.abs(profile.x_mm)))
    inner = np.abs(profile.x_mm) < 0.5
    assert np.all(deviation_um[inner] < -20.0)  # additional material, towards the emitter
    assert "simulated" in (folder / "print.svg").read_text(encoding="utf-8")
    profile = read_profile(folder / "drawn-printed.json")
    assert float(np.abs(1e3 * (profile.z_mm - oval_z(np.abs(profile.x_mm))))[20:-20].max()) < 5.0


def test_the_drawing_is_a_design_that_can_be_exported(prediction: tuple[Path, PrintedDesign]) -> None:
    folder, _ = prediction
    drawn = folder / "drawn.toml"
    assert "not the intended shape" in drawn.read_text(encoding="utf-8")
    design = open_design(drawn)
    assert design.name.endswith("not the intended shape")
    body, intended = Sensor.of(design).body(), Sensor.of(open_design(folder / "sensor.toml")).body()
    assert sorted(face.name for face in body.all_faces) == sorted(face.name for face in intended.all_faces)
    # walls are moved inwards by about 33 µm, and the body is enlarged by 1 %
    assert body.area_mm2() == pytest.approx(intended.area_mm2() * 1.0203 - 0.033 * 138.0, rel=0.01)
    files = export(drawn, folder / "out", ("stl", "svg")).files
    assert Path(files["stl"]).stat().st_size > 10_000


def test_a_predicted_profile_can_be_used_in_a_design(prediction: tuple[Path, PrintedDesign]) -> None:
    folder, _ = prediction
    profile = (folder / "lens.json").as_posix()
    design = open_design(folder / "sensor.toml", ['lens.shape="measured"', f'lens.profile="{profile}"'])
    lens = Sensor.of(design).lens
    x = np.array([0.0, 0.5, 1.0])
    assert np.all(1e3 * (lens.z_mm(x) - oval_z(x)) < -20.0)  # type: ignore[attr-defined]  # of a measured lens


def test_responses_of_the_designed_and_the_printed_lens(sensor: Path, tmp_path: Path) -> None:
    options = PrintOptions(process=process_file(tmp_path))
    response = printed_design(sensor, options=options, set_=["motion.step_deg=3.0"]).response
    assert response is not None
    assert response.chip is not None
    assert response.own.angle_deg.tolist() == [-3.0, 0.0, 3.0]
    designed, as_printed = response.chip.contrast_designed, response.chip.contrast_printed
    # the sensor is symmetric; the tolerance is that of 16384 rays
    assert np.allclose(designed, -designed[::-1], atol=5e-3)
    assert np.allclose(as_printed, -as_printed[::-1], atol=5e-3)
    # with a chip of 0.2 mm, the contrast at 3° is 0.90 as designed, and lower with the printed lens
    assert designed[0] == pytest.approx(0.90, abs=0.01)
    assert 0.0 < designed[0] - as_printed[0] < 0.15
    assert response.chip.slope_lost_percent is not None
    assert 0.0 < response.chip.slope_lost_percent < 50.0


@pytest.mark.parametrize("orientation", ["upright", "on-edge"])
def test_parts_in_other_orientations_have_layer_steps(sensor: Path, tmp_path: Path, orientation: Orientation) -> None:
    options = PrintOptions(process=process_file(tmp_path), orientation=orientation)
    result = printed_design(sensor, options=options, response=False, figure=FigureOptions(figure=tmp_path / "a.svg"))
    assert result.walls is None
    assert result.ripple.along == "profile"
    assert 5.0 < result.ripple.peak_to_valley_um < 40.0
    assert any("layer steps" in warning for warning in result.warnings)


def test_default_values_of_a_process_file(tmp_path: Path) -> None:
    process = read_process(_written(tmp_path / "p.toml", PROCESS))
    assert process.process.sigma_um == 14.0
    assert process.process.Dp_um == default_process().process.Dp_um
    assert "sigma_um" not in process.uncertainty
    assert process.uncertainty["wash_um"] == default_process().uncertainty["wash_um"]
    assert parsed_process(process_text(process), "copy") == process


def test_the_default_process_has_sources() -> None:
    process = default_process()
    assert set(process.source) == set(type(process.process).model_fields) - {"response", "response_scale"}
    published = {key for key, text in process.source.items() if text.startswith("published")}
    assert published == {"layer_um", "irradiance_mW_per_cm2", "exposure_s", "burn_in_layers", "burn_in_s"}
    assert any(warning.startswith("assumed, not measured: Dp_um, Ec_mJ_per_cm2") for warning in process.warnings())


INVALID_PROCESSES = {
    "sigma_um = -3.0": r"process\.sigma_um = -3\.0; must be greater than 0",
    "sigma_um = nan": r"process\.sigma_um = nan; must be a finite number",
    "exposure_s = 0.1": r"process\.exposure_s = 0\.1; .*1\.3 mJ/cm².* 5 mJ/cm².*0\.385 s",
    "burn_in_s = 0.1": r"process\.burn_in_s = 0\.1; .*1\.3 mJ/cm²",
    "halo_um = 3.0": r"process\.halo_um = 3\.0; must be at least sigma_um, 15",
    "sigma_mm = 3.0": r"process\.sigma_mm; unknown key; did you mean process\.sigma_um",
    "layer_um = 0.0": r"process\.layer_um = 0\.0; must be at least 1",
    'Dp_um = "deep"': r"process\.Dp_um = 'deep'; must be a number",
    "[uncertainty]\nwash_um = -1.0": r"uncertainty.* must be at least 0",
    "[uncertainty]\nwosh_um = 1.0": r"uncertainty = 'wosh_um'; must be one of",
    "[uncertainty]\npixel_um = 1.0": r"uncertainty = 'pixel_um'",
}


@pytest.mark.parametrize("line", INVALID_PROCESSES)
def test_refuses_invalid_processes(line: str) -> None:
    with pytest.raises(DataError, match=INVALID_PROCESSES[line]) as error:
        parsed_process(f'schema = 1\nname = "x"\n[process]\n{line}\n', "bad.toml")
    assert "\n" not in str(error.value)


def test_warns_of_layers_thicker_than_the_cure_depth(sensor: Path, tmp_path: Path) -> None:
    process = process_file(tmp_path, layer_um=100.0, exposure_s=0.9, Dp_um=100.0)
    result = printed_design(sensor, options=PrintOptions(process=process), response=False)
    assert result.cure_depth_um < 100.0
    (warning,) = (line for line in result.warnings if line.startswith("do not use"))
    assert re.search(r"0\.9 s.*85 µm.*100 µm", warning)


@pytest.mark.parametrize(
    ("options", "files", "error", "match"),
    [
        ({"orientation": "tilted"}, {}, SpecError, "orientation = 'tilted'; must be 'flat', 'upright'"),
        ({"at": "top"}, {}, SpecError, "must be middle, mean, or a height .*0 to 4"),
        ({"at": "4.1"}, {}, SpecError, "0 to 4"),
        ({"at": "nan"}, {}, SpecError, "0 to 4"),
        ({"orientation": "upright", "at": "mean"}, {}, SpecError, "--at = 'mean'; .*flat"),
        ({"orientation": "on-edge"}, {"compensate": "d.toml"}, SpecError, "--orientation = .*flat with --compensate"),
        ({"orientation": "on-edge"}, {"solid": "d.stl"}, SpecError, "--orientation = .*flat with --solid"),
        ({}, {"compensate": "d.json"}, OutputError, "a design must end in .toml"),
        ({}, {"solid": "d.step"}, OutputError, "a solid must end in .stl"),
        ({}, {"out": "lens.toml"}, OutputError, "a result must end in .json"),
        ({"process": "nowhere.toml"}, {}, DataError, "no such file"),
        ({"printer": "asiga-max-x72"}, {}, DataError, "not in the library"),
    ],
)
def test_refuses_invalid_options(
    sensor: Path, options: dict[str, str], files: dict[str, str], error: type[SolenError], match: str
) -> None:
    paths: dict[str, Any] = {name: Path(file) for name, file in files.items()}
    with pytest.raises(error, match=match):
        predict(sensor, options=PrintOptions(**options), response=False, **paths)


def test_refuses_an_unknown_figure_format(sensor: Path) -> None:
    with pytest.raises(OutputError, match="a figure must end in"):
        predict(sensor, options=PrintOptions(), response=False, figure=FigureOptions(figure=Path("lens.gif")))


def test_pixels_are_those_of_the_selected_printer(tmp_path: Path) -> None:
    process, _ = process_of(PrintOptions(printer="asiga-max-x43"))
    assert process.process.pixel_um == 43.0
    assert process.source["pixel_um"].endswith("Asiga MAX X43")
    assert process.uncertainty == default_process().uncertainty
    with pytest.raises(DataError, match=r"process\.layer_um = 900\.0; .*Asiga MAX X43"):
        process_of(
            PrintOptions(process=process_file(tmp_path, layer_um=900.0, exposure_s=300.0), printer="asiga-max-x43")
        )
    calibration = "[calibration]\nkeys = ['growth_um']\ncovariance = [[0.04]]\nfeatures = 9\n"
    calibrated = _written(tmp_path / "mine.toml", PROCESS + calibration)
    assert process_of(PrintOptions(process=calibrated, printer="asiga-max-x27"))[0].keeps_growth
    with pytest.raises(DataError, match=r"calibrated.*27 µm"):
        process_of(PrintOptions(process=calibrated, printer="asiga-max-x43"))


def test_refuses_pixels_too_coarse_for_the_lens(sensor: Path, tmp_path: Path) -> None:
    coarse = process_file(tmp_path, pixel_um=250.0, sigma_um=120.0, halo_um=200.0)
    out = tmp_path / "lens.json"
    with pytest.raises(DataError, match=r"process\.pixel_um = 250\.0; .*200 µm"):
        predict(sensor, options=PrintOptions(process=coarse), response=False, out=out)
    assert not out.exists()


def features_file(path: Path, **changes: Any) -> Path:
    """Write a file of features printed by a simulated process."""
    process = settings(sigma_um=20.0, Ec_mJ_per_cm2=3.0)
    nominal = [("pillar", 0.06), ("pillar", 0.1), ("pillar", 0.3), ("pillar", 1.0), ("gap", 0.5), ("hole", 1.5)]
    features = [MeasuredFeature(kind, size, None, None, True) for kind, size in nominal]  # type: ignore[arg-type]
    rows = [
        {"kind": kind, "nominal_mm": size, "measured_mm": float(printed), "u_measured_mm": 0.003, "resolved": True}
        | changes
        for (kind, size), printed in zip(nominal, printed_mm(process, features), strict=True)
    ]
    path.write_text(json.dumps({"coupon": "A", "features": rows, "simulated": True}), encoding="utf-8")
    return path


def test_writes_a_calibrated_process(tmp_path: Path) -> None:
    coupons = features_file(tmp_path / "a.json")
    out = tmp_path / "p.toml"
    values = calibrate_printer([coupons], out=out, figure=FigureOptions(figure=tmp_path / "c.svg")).to_dict()
    json.dumps(values, allow_nan=False)
    assert "simulated" in values["warnings"][0]
    assert values["sources"][0]["simulated"] is True
    assert values["rms_um"] < 1.0
    process = read_process(out)
    assert process.keeps_growth
    assert process.calibration is not None
    assert process.calibration.simulated
    assert any("simulated" in warning for warning in process.warnings())
    assert "simulated" in (tmp_path / "c.svg").read_text(encoding="utf-8")


def test_features_that_are_not_resolved_have_no_size(tmp_path: Path) -> None:
    """Files of solen print fidelity contain names, reasons and steps that were not found."""
    path = features_file(tmp_path / "a.json")
    data = json.loads(path.read_text(encoding="utf-8"))
    step = {
        "name": "s1",
        "kind": "step",
        "nominal_mm": 0.01,
        "measured_mm": -0.002,
        "u_measured_mm": 0.0,
        "reason": "no step",
    }
    data["features"].append(step | {"resolved": False})
    data["undecided"] = [step | {"resolved": None}]
    path.write_text(json.dumps(data), encoding="utf-8")
    features = read_features(path).features
    assert [feature.measured_mm is not None for feature in features] == [True] * 6 + [False]
    assert features[6].u_measured_mm is None


def test_a_process_takes_the_working_curve_of_a_resin(sensor: Path, tmp_path: Path) -> None:
    resin = tmp_path / "resin.toml"
    cure = "[cure]\nDp_um = 80.0\nEc_mJ_per_cm2 = 4.0\ncovariance = [[9.0, 0.5], [0.5, 0.04]]\n"
    text = f'schema = 1\nname = "clear"\n[index]\nkind = "number"\nn = 1.44\n{cure}'
    resin.write_text(text, encoding="utf-8")
    design = open_design(sensor, [f'material.resin="{resin.as_posix()}"'])
    process = with_resin(default_process(), design)
    assert (process.process.Dp_um, process.process.Ec_mJ_per_cm2) == (80.0, 4.0)
    assert process.source["Dp_um"] == "resin: clear"
    keys, covariance = process.covariance()
    assert keys[:2] == ("Dp_um", "Ec_mJ_per_cm2")
    assert covariance[:2, :2].tolist() == [[9.0, 0.5], [0.5, 0.04]]
    with_lamp = default_process().with_settings(lamp=((0.5, 0.8), (0.5, 1.2)))
    assert curve_cautions(default_process(), design) == curve_cautions(process, design) == []
    resin.write_text(f'{text}warnings = ["few discs"]\n[[sources]]\nof = "cure"\nsimulated = true\n', encoding="utf-8")
    cautions = curve_cautions(process, design)
    assert all(word in " ".join(cautions) for word in ("simulated", "few discs"))
    resin.write_text(text, encoding="utf-8")
    assert all(part in curve_cautions(with_lamp, design)[0] for part in ("clear", "Dp 80 µm", with_lamp.name))
    measured = read_process(_written(tmp_path / "p.toml", PROCESS + 'Dp_um = 60.0\n[source]\nDp_um = "measured"\n'))
    assert with_resin(measured, design) is measured


def _written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


INVALID_FEATURES: list[tuple[dict[str, Any], str]] = [
    ({"kind": "cone"}, r"features\[0\]\.kind = 'cone'; must be 'pillar', 'hole', 'gap' or 'step'"),
    ({"nominal_mm": -1.0}, r"features\[0\]\.nominal_mm = -1\.0; must be greater than 0"),
    ({"nominal_mm": None}, r"features\[0\]\.nominal_mm"),
    ({"measured_mm": "wide"}, r"features\[0\]\.measured_mm = 'wide'"),
    ({"measured_mm": 9000.0}, r"at most 100"),
    ({"u_measured_mm": None}, r"features\[0\]\.u_measured_mm; is missing"),
    ({"u_measured_mm": 0}, r"features\[0\]\.u_measured_mm = 0; must be greater than 0"),
    ({"resolved": "yes"}, r"features\[0\]\.resolved = 'yes'"),
    ({"resolved": False}, r"coupons; .*at least 3"),
]


@pytest.mark.parametrize(("changes", "match"), INVALID_FEATURES)
def test_refuses_invalid_features(tmp_path: Path, changes: dict[str, Any], match: str) -> None:
    out = tmp_path / "p.toml"
    with pytest.raises(DataError, match=match):
        calibrate_printer([features_file(tmp_path / "a.json", **changes)], out=out)
    assert not out.exists()


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "in µm"), (1e-3, "in metres")])
def test_names_a_probable_error_of_the_unit(tmp_path: Path, factor: float, unit: str) -> None:
    path = features_file(tmp_path / "a.json")
    data = json.loads(path.read_text(encoding="utf-8"))
    for row in data["features"]:
        row["measured_mm"] *= factor
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(DataError, match=unit):
        read_features(path)


@pytest.mark.parametrize(
    "text", ["", "[1]", '{"features": 3}', '{"features": [1]}', '{"simulated": 1, "features": []}']
)
def test_refuses_files_without_features(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DataError):
        calibrate_printer([path])


def test_refuses_invalid_outputs_of_a_calibration(tmp_path: Path) -> None:
    existing = _written(tmp_path / "mine.toml", PROCESS)
    with pytest.raises(OutputError, match=r"mine\.toml; already exists.*--force"):
        calibrate_printer([features_file(tmp_path / "a.json")], out=existing)
    assert existing.read_text(encoding="utf-8") == PROCESS
    with pytest.raises(OutputError, match=r"a process must end in \.toml"):
        calibrate_printer([features_file(tmp_path / "a.json")], out=tmp_path / "p.json")
    with pytest.raises(DataError, match="features"):
        calibrate_printer([])


def test_refuses_to_overwrite_input_files(sensor: Path, tmp_path: Path) -> None:
    """Neither a design by its corrected drawing, nor the drawing of a design by an export."""
    text = sensor.read_text(encoding="utf-8")
    with pytest.raises(OutputError, match=r"sensor\.toml; is an input file"):
        predict(sensor, options=PrintOptions(process=process_file(tmp_path)), response=False, compensate=sensor)
    assert sensor.read_text(encoding="utf-8") == text
    drawing = export(sensor, tmp_path, ("dxf",)).files["dxf"].rename(tmp_path / "body.dxf")
    tables = '[material]\nindex = 1.44\n[body]\nkind = "outline"\nfile = "body.dxf"\n'
    design = _written(tmp_path / "body.toml", f'schema = 1\nname = "body"\n{tables}')
    before = drawing.read_bytes()
    with pytest.raises(OutputError, match=r"body\.dxf; is an input file"):
        export(design, tmp_path, ("dxf",))
    assert drawing.read_bytes() == before
