"""Tuning of a lens print by print on a simulated printer with another model than solen's."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.errors import DataError, DesignError, SpecError
from solen.explore import TunedPrint, TuneOptions, log_text, read_log, tune
from solen.explore.print_model import PrintModel
from solen.explore.tuning_warnings import image_warnings
from solen.metrology import measure_lens, read_image
from solen.pipeline.print.tune import tune as tune_files
from solen.samples import FOLDER
from solen.sensor import Sensor
from solen.spec import template, with_values
from tests.explore.print_simulator import Printer
from tests.explore.tuning_support import DESIGNED, SENSOR, UM_PER_PX, Lab, drawing_of, true_rms_um
from tests.metrology.inspect_support import lens
from tests.metrology.render.optics import gaussian

PRINTS, MORE_PRINTS = 2, 3
EXAMPLE = FOLDER / "lens-simulated.ome.tif"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Lab:
    return Lab(tmp_path_factory.mktemp("lab"))


@pytest.fixture(scope="module")
def tuned(lab: Lab) -> list[TunedPrint]:
    """Two prints, the second from the drawing that was corrected after the first."""
    steps: list[TunedPrint] = []
    ring: FloatArray = DESIGNED
    for _ in range(PRINTS):
        log = steps[-1].log if steps else None
        steps.append(lab.tuned(lab.image(ring), log))
        ring = drawing_of(steps[-1])
    return steps


@pytest.fixture(scope="module")
def true_um(lab: Lab, tuned: list[TunedPrint]) -> list[float]:
    """True deviations of the prints and of the next print, from their outlines."""
    rings = [DESIGNED, *map(drawing_of, tuned)]
    return [true_rms_um(lab.printer.printed(ring, number)) for number, ring in enumerate(rings, start=1)]


def test_deviation_decreases_from_print_to_print(tuned: list[TunedPrint], true_um: list[float]) -> None:
    assert true_um[0] > 3.0
    assert true_um[1] < 0.5 * true_um[0]
    assert true_um[2] < 0.35 * true_um[0]
    for step, true in zip(tuned, true_um, strict=False):
        assert step.rms_um == pytest.approx(true, abs=3.0 * step.u_rms_um)


def test_next_print_is_within_prediction(tuned: list[TunedPrint], true_um: list[float]) -> None:
    for step, true in zip(tuned, true_um[1:], strict=True):
        low, high = step.predicted.interval95_rms_um
        assert low < true < high
    assert tuned[-1].predicted.interval95_rms_um[1] < 0.6 * true_um[0]  # the interval is narrow


def test_history_contains_predictions(tuned: list[TunedPrint]) -> None:
    last = tuned[-1]
    assert [step.drawing for step in last.history] == [0, 1]
    assert last.history[0].predicted is None
    assert last.history[1].predicted == tuned[0].predicted
    assert last.drawn_by == "correction 1 (lens-tuned-1.toml)"


def test_log_round_trip(tuned: list[TunedPrint], tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    path.write_text(log_text(tuned[-1].log))
    assert log_text(read_log(path)) == path.read_text()
    path.write_text(path.read_text().replace('"drawing": 1', '"drawing": 2'))
    with pytest.raises(DataError, match=r"prints\[1\]"):
        read_log(path)


def test_refuses_image_twice(lab: Lab, tuned: list[TunedPrint]) -> None:
    with pytest.raises(DataError, match="print 2 of the log"):
        lab.tuned(lab.folder / "print-2.png", tuned[-1].log)


def test_refuses_print_of_other_drawing(lab: Lab, tuned: list[TunedPrint], tmp_path: Path) -> None:
    """The drawing is identified from the image, or from the file specified with --drawn."""
    image = Lab(lab.folder, lab.printer, prints=20).image(DESIGNED)
    with pytest.raises(DataError, match=r"looks like a print of correction 0 .*print of correction 1"):
        lab.tuned(image, tuned[0].log)
    design = tmp_path / "design.toml"
    design.write_text(template("solen-860"))
    with pytest.raises(DataError, match=r"is correction 0 .*print of correction 1"):
        lab.tuned(image, tuned[0].log, drawn=design)
    copy = lab.tuned(image, tuned[0].log, another_copy=True)
    assert [step.drawing for step in copy.history] == [0, 0]
    assert copy.common.u_overgrowth_um < tuned[0].common.u_overgrowth_um * 1.2


def test_refuses_log_of_other_design_or_printer(lab: Lab, tuned: list[TunedPrint]) -> None:
    options = TuneOptions(um_per_px=UM_PER_PX, seen_from="top")
    measured = measure_lens(read_image(lab.folder / "print-1.png", options=options), SENSOR.design)
    other = Sensor.of(with_values(SENSOR.design, {"lens.focus_mm": 19.0}))
    log = replace(tuned[0].log, prints=())
    with pytest.raises(DataError, match="design of the log"):
        tune(measured, other, lab.slicing, options, log, response=False)
    coarser = lab.slicing.model_copy(update={"printer": "generic", "process": None})
    with pytest.raises(DataError, match="27 x 27"):
        tune(measured, SENSOR, coarser, options, log, response=False)
    with pytest.raises(SpecError, match="another-copy"):
        tune(measured, SENSOR, lab.slicing, options.model_copy(update={"another_copy": True}), log, response=False)
    with pytest.raises(SpecError, match="orientation"):
        tune(measured, SENSOR, lab.slicing.model_copy(update={"orientation": "upright"}), options, log)


def test_does_not_correct_unknown_face_and_scale(lab: Lab, tuned: list[TunedPrint]) -> None:
    """If the face is unknown, only the symmetric part is corrected; without u of the scale, the size is not."""
    unknown = {"seen_from": None, "u_um_per_px": None}
    first = lab.tuned(lab.folder / "print-1.png", **unknown)
    symmetric, correct = first.compensation.drawn_um, tuned[0].compensation.drawn_um
    assert np.abs(symmetric - symmetric[::-1]).max() < 1.0
    assert np.abs(correct - correct[::-1]).max() > 4.0
    assert first.scale == pytest.approx(1.0, abs=1e-4)
    assert first.predicted.rms_um > 2.0
    assert "size" not in first.corrected
    warnings = " ".join(first.warnings)
    assert "--seen-from" in warnings
    assert "--u-um-per-px" in warnings
    # the drawing is therefore kept, and the next image shows another print of it
    assert first.kept
    second = lab.tuned(Lab(lab.folder, lab.printer, prints=50).image(DESIGNED), first.log, **unknown)
    assert [step.drawing for step in second.history] == [0, 0]
    assert second.history[1].predicted == first.predicted
    low, high = first.predicted.interval95_rms_um
    assert low < second.rms_um < high
    assert second.common.prints == 2


def test_keeps_drawing_if_no_correction_is_better(tmp_path: Path) -> None:
    """Without the face and the uncertainty of the scale, a correction would increase the predicted deviation."""
    design, out = tmp_path / "sensor.toml", tmp_path / "out"
    design.write_text(template("solen-860"))
    tuned = tune_files(EXAMPLE, design=design, out=out, response=False).result
    assert tuned.kept
    assert [path.name for path in out.iterdir()] == ["sensor-tuning.json"]
    assert tuned.predicted == tuned.unchanged
    assert (tuned.wall_um, tuned.scale, tuned.drawn_range_um) == (0.0, 1.0, (0.0, 0.0))
    log = read_log(out / "sensor-tuning.json")
    assert log.last_drawing == log.prints[0].correction.number == 0
    assert any("correction 0" in warning and "kept" in warning for warning in tuned.warnings)


def test_refuses_lens_that_varies_with_height(tmp_path: Path) -> None:
    """The design is refused before the image is read."""
    design, out = tmp_path / "sensor.toml", tmp_path / "out"
    design.write_text(template("solen-860"), encoding="utf-8")
    with pytest.raises(DesignError, match=r"layered.*--compensate.*--bottom"):
        tune_files(tmp_path / "none.tif", design=design, out=out, set_=["lens.shape=layered"])
    assert not out.exists()


def test_warns_of_blurred_image_and_other_lens(lab: Lab) -> None:
    model = PrintModel.of(SENSOR, lab.slicing)
    blurred = lab.inspected(Lab(lab.folder, lab.printer, prints=30).image(DESIGNED, optics=gaussian(9.0)))
    assert any("out of focus" in warning for warning in image_warnings(blurred, model))
    other = lab.inspected(Lab(lab.folder, Printer(curl_um=0.0), prints=40).image(lens("solen-450")))
    warnings = image_warnings(other, model)
    assert any("n = 1.54" in warning and warning.startswith("do not use") for warning in warnings)


@pytest.mark.evidence
def test_predictions_hold_for_many_printers(tmp_path: Path) -> None:
    """Three predictions for each of 12 printers, which differ in blur, growth, shrinkage, tilt, curl and scatter."""
    covered, above, ratios = [], [], []
    for seed in range(12):
        rng = np.random.default_rng([seed, 5])
        printer = Printer(
            level=rng.uniform(0.18, 0.4),
            tilt=rng.uniform(-0.1, 0.1),
            shrinkage=rng.uniform(0.0, 0.012),
            curl_um=rng.uniform(1.0, 6.0),
            scatter_um=0.4 * 2.0 ** rng.normal(0.0, 0.7),
            disc_mm=rng.uniform(0.018, 0.03),
        )
        folder = tmp_path / str(seed)
        folder.mkdir()
        lab, ring, true = Lab(folder, printer), DESIGNED, []
        steps: list[TunedPrint] = []
        for number in range(1, MORE_PRINTS + 2):
            true.append(true_rms_um(printer.printed(ring, number)))
            if steps:
                low, high = steps[-1].predicted.interval95_rms_um
                covered.append(low < true[-1] < high)
                above.append(true[-1] > high)
                print(f"{seed}: {true[-1]:.2f} in {low:.2f} to {high:.2f}")
            if number <= MORE_PRINTS:
                steps.append(lab.tuned(lab.image(ring), steps[-1].log if steps else None))
                ring = drawing_of(steps[-1])
        ratios.append(true[-1] / true[0])
        print(seed, [round(um, 2) for um in true], covered[-MORE_PRINTS:])
    print(f"{np.mean(covered):.3f} of {len(covered)} within, {sum(above)} above; median ratio {np.median(ratios):.2f}")
    assert np.mean(covered) > 0.75  # most of the others are below the interval
    assert np.mean(above) < 0.06
    assert np.median(ratios) < 0.65


def test_blur_scales_measured_response(tmp_path: Path) -> None:
    """If the process contains a measured response, the fitted blur scales its width."""
    lab = Lab(tmp_path, Printer())
    x = 3.0 * np.arange(-30, 31)
    light = np.exp(-0.5 * (x[:, None] ** 2 + (x - 6.0) ** 2) / 15.0**2)
    np.savetxt(tmp_path / "pixel.csv", light, delimiter=",")
    slicing = lab.slicing
    response = '[process.response]\nfile = "pixel.csv"\npitch_um = 3.0\n'
    (tmp_path / "process.toml").write_text(f'schema = 1\nname = "lab"\n{response}')
    model = PrintModel.of(SENSOR, slicing)
    assert model.settings.sigma_um is None
    assert model.wider is not None
    assert model.wider.settings.response_scale == pytest.approx(1.05)
    assert model.with_more_blur(-2.0).settings.response_scale == pytest.approx(0.9)
    assert model.min_blur == pytest.approx(-10.0)
