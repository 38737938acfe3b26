"""`solen print predict` and `solen print calibrate`: files in, files out, and every bad input in one line."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DataError, OutputError, SolenError, SpecError
from solen.fabricate.process import (
    MeasuredFeature,
    Orientation,
    PrintedDesign,
    PrinterCalibration,
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
from solen.pipeline.print.calibrate import calibrate as calibrate_printer
from solen.pipeline.print.predict import predict
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor
from solen.spec import template
from tests.fabricate.print_support import settings
from tests.fabricate.solid_support import oval_z

KNOWN = """schema = 1
name = "test"

[process]
sigma_um = 14.0
"""
"""A process of which nothing but its own number is said."""


@pytest.fixture
def sensor(tmp_path: Path) -> Path:
    path = tmp_path / "sensor.toml"
    path.write_text(template("paper-860"), encoding="utf-8")
    return path


def sure(folder: Path, **values: float) -> Path:
    """Process file of numbers without uncertainty, so that one print is enough."""
    path = folder / "process.toml"
    none = default_process().model_copy(update={"uncertainty": {}, "process": settings(**values)})
    path.write_text(process_text(none), encoding="utf-8")
    return path


def print_of(file: Path, **asked: Any) -> PrintedDesign:
    """What the command finds of a prism."""
    found = predict(file, **asked).result
    assert isinstance(found, PrintedDesign)
    return found


def strict(text: str) -> Any:
    return json.loads(text, parse_constant=pytest.fail)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PrintedDesign]:
    """One print with all of its files, and what it told."""
    folder = tmp_path_factory.mktemp("print")
    sensor = folder / "sensor.toml"
    sensor.write_text(template("paper-860"), encoding="utf-8")
    outcome = print_of(
        sensor,
        options=PrintOptions(process=sure(folder)),
        response=False,
        out=folder / "lens.json",
        compensate=folder / "drawn.toml",
        figure=FigureOptions(figure=folder / "print.svg"),
    )
    return folder, outcome


def test_a_print_is_reported_with_its_profile_and_its_drawing(made: tuple[Path, PrintedDesign]) -> None:
    folder, found = made
    told = found.to_dict()
    strict(json.dumps(told, allow_nan=False))
    assert told["simulated"] is True
    assert found.deviation.rms_um > 20.0
    assert told["walls"]["layers"] == 160
    assert told["response"] is None
    assert told["sources"][0]["file"] == "process.toml"
    assert told["settings"]["exposure_s"] == 2.0
    assert found.compensation is not None
    assert found.compensation.printed.rms_um < 5.0
    profile = read_profile(folder / "lens.json")
    assert profile.simulated
    assert profile.edge == "predicted"
    off = 1e3 * (profile.z_mm - oval_z(np.abs(profile.x_mm)))
    inner = np.abs(profile.x_mm) < 0.5
    assert np.all(off[inner] < -20.0)  # more material: nearer to the emitter
    assert "simulated" in (folder / "print.svg").read_text(encoding="utf-8")
    again = read_profile(folder / "drawn-printed.json")
    assert float(np.abs(1e3 * (again.z_mm - oval_z(np.abs(again.x_mm))))[20:-20].max()) < 5.0


def test_the_drawing_is_a_design_that_can_be_exported(made: tuple[Path, PrintedDesign]) -> None:
    from solen.pipeline.design.export import export

    folder, _ = made
    drawn = folder / "drawn.toml"
    assert "As drawn for the printer, not the intended shape" in drawn.read_text(encoding="utf-8")
    found = open_design(drawn)
    assert found.name.endswith("as drawn for the printer, not the intended shape")
    body, wanted = Sensor.of(found).body(), Sensor.of(open_design(folder / "sensor.toml")).body()
    assert sorted(face.name for face in body.all_faces) == sorted(face.name for face in wanted.all_faces)
    # walls some 32 um farther in, all of it 1 % larger
    assert body.area_mm2() == pytest.approx(wanted.area_mm2() * 1.0203 - 0.033 * 138.0, rel=0.01)
    files = export(drawn, folder / "out", ("stl", "svg")).files
    assert Path(files["stl"]).stat().st_size > 10_000


def test_a_predicted_profile_goes_back_into_the_design(made: tuple[Path, PrintedDesign]) -> None:
    profile = (made[0] / "lens.json").as_posix()
    again = open_design(made[0] / "sensor.toml", ['lens.shape="measured"', f'lens.profile="{profile}"'])
    lens = Sensor.of(again).lens
    x = np.array([0.0, 0.5, 1.0])
    assert np.all(1e3 * (lens.z_mm(x) - oval_z(x)) < -20.0)  # type: ignore[attr-defined]  # a measured lens has it


def test_the_response_of_both_lenses_is_traced(sensor: Path, tmp_path: Path) -> None:
    response = print_of(sensor, options=PrintOptions(process=sure(tmp_path)), set_=["motion.step_deg=3.0"]).response
    assert response is not None
    assert response.chip is not None
    assert response.own.angle_deg.tolist() == [-3.0, 0.0, 3.0]
    designed, as_printed = response.chip.contrast_designed, response.chip.contrast_printed
    # a mirror image of a symmetric sensor, within the step of a ray of 16384
    assert np.allclose(designed, -designed[::-1], atol=5e-3)
    assert np.allclose(as_printed, -as_printed[::-1], atol=5e-3)
    # a chip of 0.2 mm: 0.90 at 3 deg as designed; the printed lens gives up some of it
    assert designed[0] == pytest.approx(0.90, abs=0.01)
    assert 0.0 < designed[0] - as_printed[0] < 0.15
    assert response.chip.slope_lost_percent is not None
    assert 0.0 < response.chip.slope_lost_percent < 50.0


@pytest.mark.parametrize("orientation", ["upright", "on-edge"])
def test_other_orientations_have_steps(sensor: Path, tmp_path: Path, orientation: Orientation) -> None:
    options = PrintOptions(process=sure(tmp_path), orientation=orientation)
    found = print_of(sensor, options=options, response=False, figure=FigureOptions(figure=tmp_path / "a.svg"))
    assert found.walls is None
    assert found.ripple.along == "profile"
    assert 5.0 < found.ripple.peak_to_valley_um < 40.0
    assert any("layer steps" in text for text in found.warnings)


def test_what_is_left_out_of_a_process_is_the_default(tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    path.write_text(KNOWN, encoding="utf-8")
    found = read_process(path)
    assert found.process.sigma_um == 14.0
    assert found.process.Dp_um == default_process().process.Dp_um
    assert "sigma_um" not in found.uncertainty
    assert found.uncertainty["wash_um"] == default_process().uncertainty["wash_um"]
    assert parsed_process(process_text(found), "again") == found


def test_the_default_says_where_each_number_comes_from() -> None:
    found = default_process()
    of_a_response = {"response", "response_scale"}  # it states none, but a blur
    assert set(found.source) == set(type(found.process).model_fields) - of_a_response
    published = {key for key, text in found.source.items() if text.startswith("published")}
    assert published == {"layer_um", "irradiance_mW_per_cm2", "exposure_s", "burn_in_layers", "burn_in_s"}
    assert any(text.startswith("assumed, not measured: Dp_um, Ec_mJ_per_cm2") for text in found.warnings())


BAD_PROCESSES = {
    "sigma_um = -3.0": r"process\.sigma_um = -3\.0; must be greater than 0",
    "sigma_um = nan": r"process\.sigma_um = nan; must be a finite number",
    "exposure_s = 0.1": r"process\.exposure_s = 0\.1; gives 1\.3 mJ/cm², but the resin sets at 5 mJ/cm²: nothing "
    r"cures; expose for more than 0\.385 s",
    "burn_in_s = 0.1": r"process\.burn_in_s = 0\.1; gives 1\.3 mJ/cm²",
    "halo_um = 3.0": r"process\.halo_um = 3\.0; must be at least sigma_um, 15",
    "sigma_mm = 3.0": r"process\.sigma_mm; unknown key; did you mean process\.sigma_um",
    "layer_um = 0.0": r"process\.layer_um = 0\.0; must be at least 1",
    'Dp_um = "deep"': r"process\.Dp_um = 'deep'; must be a number",
    "[uncertainty]\nwash_um = -1.0": r"uncertainty.* must be at least 0",
    "[uncertainty]\nwosh_um = 1.0": r"uncertainty = 'wosh_um'; must be one of",
    "[uncertainty]\npixel_um = 1.0": r"uncertainty = 'pixel_um'",
}


@pytest.mark.parametrize("line", BAD_PROCESSES)
def test_bad_processes_are_refused_in_one_line(line: str) -> None:
    with pytest.raises(DataError, match=BAD_PROCESSES[line]) as bad:
        parsed_process(f'schema = 1\nname = "x"\n[process]\n{line}\n', "bad.toml")
    assert "\n" not in str(bad.value)


def test_layers_thicker_than_the_cure_depth_are_warned_of(sensor: Path, tmp_path: Path) -> None:
    process = sure(tmp_path, layer_um=100.0, exposure_s=0.9, Dp_um=100.0)
    found = print_of(sensor, options=PrintOptions(process=process), response=False)
    assert found.cure_depth_um < 100.0
    assert any(
        text.startswith("do not use: the layers do not adhere: 0.9 s (11.7 mJ/cm2) cure 85 µm")
        for text in found.warnings
    )


@pytest.mark.parametrize(
    ("options", "files", "error", "match"),
    [
        ({"orientation": "tilted"}, {}, SpecError, "orientation = 'tilted'; must be 'flat', 'upright'"),
        ({"at": "top"}, {}, SpecError, "must be middle, mean, or a height in mm from 0 to 4"),
        ({"at": "4.1"}, {}, SpecError, "from 0 to 4"),
        ({"at": "nan"}, {}, SpecError, "from 0 to 4"),
        ({"orientation": "upright", "at": "mean"}, {}, SpecError, "--at = 'mean'; applies to parts printed flat"),
        ({"orientation": "on-edge"}, {"compensate": "d.toml"}, SpecError, "--compensate applies to parts printed flat"),
        ({"orientation": "on-edge"}, {"solid": "d.stl"}, SpecError, "--solid applies to parts printed flat"),
        ({}, {"compensate": "d.json"}, OutputError, "a design must end in .toml"),
        ({}, {"solid": "d.step"}, OutputError, "a solid must end in .stl"),
        ({}, {"out": "lens.toml"}, OutputError, "a result must end in .json"),
        ({"process": "nowhere.toml"}, {}, DataError, "no such file"),
        ({"printer": "asiga-max-x72"}, {}, DataError, "not in the library"),
    ],
)
def test_bad_demands_are_refused(
    sensor: Path, options: dict[str, str], files: dict[str, str], error: type[SolenError], match: str
) -> None:
    paths: dict[str, Any] = {name: Path(file) for name, file in files.items()}
    with pytest.raises(error, match=match):
        predict(sensor, options=PrintOptions(**options), response=False, **paths)


def test_a_figure_of_an_unknown_kind_is_refused(sensor: Path) -> None:
    with pytest.raises(OutputError, match="a figure must end in"):
        predict(sensor, options=PrintOptions(), response=False, figure=FigureOptions(figure=Path("lens.gif")))


def test_a_named_printer_gives_its_pixels(tmp_path: Path) -> None:
    process, _ = process_of(PrintOptions(printer="asiga-max-x43"))
    assert process.process.pixel_um == 43.0
    assert process.source["pixel_um"].endswith("Asiga MAX X43")
    assert process.uncertainty == default_process().uncertainty
    with pytest.raises(DataError, match=r"process\.layer_um = 900\.0; Asiga MAX X43 prints layers of"):
        process_of(PrintOptions(process=sure(tmp_path, layer_um=900.0, exposure_s=300.0), printer="asiga-max-x43"))
    calibration = "[calibration]\nkeys = ['growth_um']\ncovariance = [[0.04]]\nfeatures = 9\n"
    calibrated = _written(tmp_path / "mine.toml", KNOWN + calibration)
    assert process_of(PrintOptions(process=calibrated, printer="asiga-max-x27"))[0].keeps_growth
    with pytest.raises(DataError, match="the process was calibrated with 27 µm pixels"):
        process_of(PrintOptions(process=calibrated, printer="asiga-max-x43"))


def test_a_sensor_without_a_lens_has_none_to_print(sensor: Path, tmp_path: Path) -> None:
    coarse = sure(tmp_path, pixel_um=250.0, sigma_um=120.0, halo_um=200.0)
    out = tmp_path / "lens.json"
    with pytest.raises(DataError, match="must be at least 20 pixels wide; use a printer with pixels below 200 µm"):
        predict(sensor, options=PrintOptions(process=coarse), response=False, out=out)
    assert not out.exists()


def features_file(path: Path, **changes: Any) -> Path:
    """Simulated coupons of a blurred process."""
    one = settings(sigma_um=20.0, Ec_mJ_per_cm2=3.0)
    nominal = [("pillar", 0.06), ("pillar", 0.1), ("pillar", 0.3), ("pillar", 1.0), ("gap", 0.5), ("hole", 1.5)]
    features = [MeasuredFeature(kind, size, None, None, True) for kind, size in nominal]  # type: ignore[arg-type]
    found = [
        {"kind": kind, "nominal_mm": size, "measured_mm": float(made), "u_measured_mm": 0.003, "resolved": True}
        | changes
        for (kind, size), made in zip(nominal, printed_mm(one, features), strict=True)
    ]
    path.write_text(json.dumps({"coupon": "A", "features": found, "simulated": True}), encoding="utf-8")
    return path


def test_a_calibration_is_written_as_a_process(tmp_path: Path) -> None:
    coupons = features_file(tmp_path / "a.json")
    out = tmp_path / "p.toml"
    outcome: Outcome[PrinterCalibration] = calibrate_printer(
        [coupons], out=out, figure=FigureOptions(figure=tmp_path / "c.svg")
    )
    told = outcome.to_dict()
    strict(json.dumps(told, allow_nan=False))
    assert told["warnings"][0] == "the features are simulated, not measured"
    assert told["sources"][0]["simulated"] is True
    assert told["rms_um"] < 1.0
    found = read_process(out)
    assert found.keeps_growth
    assert found.calibration is not None
    assert found.calibration.simulated
    assert any("from simulated coupons" in text for text in found.warnings())
    assert "simulated" in (tmp_path / "c.svg").read_text(encoding="utf-8")


def test_what_is_not_resolved_needs_no_size(tmp_path: Path) -> None:
    """As a program that measures writes it: names, reasons, and a step that is none."""
    path = features_file(tmp_path / "a.json")
    data = json.loads(path.read_text(encoding="utf-8"))
    step = {
        "name": "s1",
        "kind": "step",
        "nominal_mm": 0.01,
        "measured_mm": -0.002,
        "u_measured_mm": 0.0,
        "reason": "no rise",
    }
    data["features"].append(step | {"resolved": False})
    data["undecided"] = [step | {"resolved": None}]
    path.write_text(json.dumps(data), encoding="utf-8")
    features = read_features(path).features
    assert [one.measured_mm is not None for one in features] == [True] * 6 + [False]
    assert features[6].u_measured_mm is None


def test_a_resin_with_a_working_curve_gives_it(sensor: Path, tmp_path: Path) -> None:
    resin = tmp_path / "resin.toml"
    cure = "[cure]\nDp_um = 80.0\nEc_mJ_per_cm2 = 4.0\ncovariance = [[9.0, 0.5], [0.5, 0.04]]\n"
    text = f'schema = 1\nname = "clear"\n[index]\nkind = "number"\nn = 1.44\n{cure}'
    resin.write_text(text, encoding="utf-8")
    design = open_design(sensor, [f'material.resin="{resin.as_posix()}"'])
    found = with_resin(default_process(), design)
    assert (found.process.Dp_um, found.process.Ec_mJ_per_cm2) == (80.0, 4.0)
    assert found.source["Dp_um"] == "resin: clear"
    keys, covariance = found.covariance()
    assert keys[:2] == ("Dp_um", "Ec_mJ_per_cm2")
    assert covariance[:2, :2].tolist() == [[9.0, 0.5], [0.5, 0.04]]
    lit = default_process().with_settings(lamp=((0.5, 0.8), (0.5, 1.2)))
    assert curve_cautions(default_process(), design) == curve_cautions(found, design) == []
    resin.write_text(f'{text}warnings = ["few discs"]\n[[sources]]\nof = "cure"\nsimulated = true\n', encoding="utf-8")
    assert curve_cautions(found, design) == ["cure: from simulated data, not measured", "cure: few discs"]
    resin.write_text(text, encoding="utf-8")
    assert all(part in curve_cautions(lit, design)[0] for part in ("clear", "Dp 80 µm", lit.name))
    stated = read_process(_written(tmp_path / "p.toml", KNOWN + 'Dp_um = 60.0\n[source]\nDp_um = "measured"\n'))
    assert with_resin(stated, design) is stated


def _written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


BAD_FEATURES: list[tuple[dict[str, Any], str]] = [
    ({"kind": "cone"}, r"features\[0\]\.kind = 'cone'; must be 'pillar', 'hole', 'gap' or 'step'"),
    ({"nominal_mm": -1.0}, r"features\[0\]\.nominal_mm = -1\.0; must be greater than 0"),
    ({"nominal_mm": None}, r"features\[0\]\.nominal_mm"),
    ({"measured_mm": "wide"}, r"features\[0\]\.measured_mm = 'wide'"),
    ({"measured_mm": 9000.0}, r"at most 100"),
    ({"u_measured_mm": None}, r"features\[0\]\.u_measured_mm; missing: a measured size must have an uncertainty"),
    ({"u_measured_mm": 0}, r"features\[0\]\.u_measured_mm = 0; must be greater than 0"),
    ({"resolved": "yes"}, r"features\[0\]\.resolved = 'yes'"),
    ({"resolved": False}, r"coupons = '0 of 6 features'; must have at least 3"),
]


@pytest.mark.parametrize(("changes", "match"), BAD_FEATURES)
def test_bad_features_are_refused(tmp_path: Path, changes: dict[str, Any], match: str) -> None:
    out = tmp_path / "p.toml"
    with pytest.raises(DataError, match=match):
        calibrate_printer([features_file(tmp_path / "a.json", **changes)], out=out)
    assert not out.exists()


@pytest.mark.parametrize(("factor", "said"), [(1e3, "in µm"), (1e-3, "in mm")])
def test_sizes_in_another_unit_are_named_first(tmp_path: Path, factor: float, said: str) -> None:
    path = features_file(tmp_path / "a.json")
    data = json.loads(path.read_text(encoding="utf-8"))
    for row in data["features"]:
        row["measured_mm"] *= factor
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(DataError, match=said):
        read_features(path)


@pytest.mark.parametrize(
    "text", ["", "[1]", '{"features": 3}', '{"features": [1]}', '{"simulated": 1, "features": []}']
)
def test_files_that_hold_no_features_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DataError):
        calibrate_printer([path])


def test_bad_outputs_of_a_calibration_are_refused(tmp_path: Path) -> None:
    kept = tmp_path / "mine.toml"
    kept.write_text(KNOWN, encoding="utf-8")
    with pytest.raises(OutputError, match=r"mine\.toml; already exists.*--force"):
        calibrate_printer([features_file(tmp_path / "a.json")], out=kept)
    assert kept.read_text(encoding="utf-8") == KNOWN
    with pytest.raises(OutputError, match=r"a process must end in \.toml"):
        calibrate_printer([features_file(tmp_path / "a.json")], out=tmp_path / "p.json")
    with pytest.raises(DataError, match="no file of features"):
        calibrate_printer([])


def test_a_file_that_is_read_is_never_written(sensor: Path, tmp_path: Path) -> None:
    """Not the design by its own correction, nor a drawing that a design names by its export or its layers."""
    text = sensor.read_text(encoding="utf-8")
    with pytest.raises(OutputError, match=r"sensor\.toml; is an input file"):
        predict(sensor, options=PrintOptions(process=sure(tmp_path)), response=False, compensate=sensor)
    assert sensor.read_text(encoding="utf-8") == text
    from solen.pipeline.design.export import export

    drawing = export(sensor, tmp_path, ("dxf",)).files["dxf"]
    named = drawing.rename(tmp_path / "body.dxf")
    design = tmp_path / "body.toml"
    design.write_text(
        f'schema = 1\nname = "body"\n[material]\nindex = 1.44\n[body]\nkind = "outline"\nfile = "{named.name}"\n'
    )
    before = named.read_bytes()
    with pytest.raises(OutputError, match=r"body\.dxf; is an input file"):
        export(design, tmp_path, ("dxf",))
    assert named.read_bytes() == before
