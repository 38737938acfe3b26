"""Tuning a lens print by print, on a printer whose model is not solen's: the deviation falls, and predictions hold."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.errors import DataError, DesignError, SpecError
from solen.explore import TunedPrint, TuneOptions, log_text, read_log, tune
from solen.explore.print_model import PrintModel
from solen.metrology import measure_lens, read_image
from solen.pipeline.print.tune import tune as tune_files
from solen.samples import FOLDER
from solen.sensor import Sensor
from solen.spec import template, with_values
from tests.explore.print_simulator import Printer
from tests.explore.tuning_support import DESIGNED, SENSOR, UM_PER_PX, Lab, drawn_by, true_rms_um
from tests.metrology.inspect_support import lens
from tests.metrology.render.optics import gaussian

PRINTS = 3
EXAMPLE = FOLDER / "lens-simulated.ome.tif"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Lab:
    return Lab(tmp_path_factory.mktemp("lab"))


@pytest.fixture(scope="module")
def tuned(lab: Lab) -> list[TunedPrint]:
    """Three prints, each of the drawing that followed from those before."""
    answers: list[TunedPrint] = []
    ring: FloatArray = DESIGNED
    for _ in range(PRINTS):
        log = answers[-1].log if answers else None
        answers.append(lab.tuned(lab.image(ring), log))
        ring = drawn_by(answers[-1])
    return answers


@pytest.fixture(scope="module")
def true_um(lab: Lab, tuned: list[TunedPrint]) -> list[float]:
    """Deviation of the three prints and of a fourth, by the outlines themselves."""
    rings = [DESIGNED, *map(drawn_by, tuned)]
    return [true_rms_um(lab.printer.printed(ring, number)) for number, ring in enumerate(rings, start=1)]


def test_the_deviation_falls_to_what_prints_differ_by(tuned: list[TunedPrint], true_um: list[float]) -> None:
    assert true_um[0] > 3.0
    assert true_um[1] < 0.5 * true_um[0]
    assert true_um[3] < 0.35 * true_um[0]
    for one, true in zip(tuned, true_um, strict=False):
        assert one.rms_um == pytest.approx(true, abs=3.0 * one.u_rms_um)


def test_the_next_print_is_within_what_was_predicted(tuned: list[TunedPrint], true_um: list[float]) -> None:
    for one, true in zip(tuned, true_um[1:], strict=True):
        low, high = one.predicted.interval95_rms_um
        assert low < true < high
    assert tuned[-1].predicted.interval95_rms_um[1] < 0.6 * true_um[0]  # and that is no void statement


def test_the_history_pairs_each_print_with_its_prediction(tuned: list[TunedPrint]) -> None:
    last = tuned[-1]
    assert [step.drawing for step in last.history] == [0, 1, 2]
    assert last.history[0].predicted is None
    assert last.history[2].predicted == tuned[1].predicted
    assert last.drawn_by == "correction 2 (lens-tuned-2.toml)"


def test_a_log_comes_back_as_it_was_written(tuned: list[TunedPrint], tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    path.write_text(log_text(tuned[-1].log))
    assert log_text(read_log(path)) == path.read_text()
    path.write_text(path.read_text().replace('"drawing": 2', '"drawing": 3'))
    with pytest.raises(DataError, match=r"prints\[2\]"):
        read_log(path)


def test_an_image_counts_once(lab: Lab, tuned: list[TunedPrint]) -> None:
    with pytest.raises(DataError, match="print 2 of the log"):
        lab.tuned(lab.folder / "print-2.png", tuned[-1].log)


def test_a_print_of_another_drawing_is_refused_by_name(lab: Lab, tuned: list[TunedPrint], tmp_path: Path) -> None:
    """By its looks, or by the drawing that the user names."""
    again = Lab(lab.folder, lab.printer, taken=20)
    first = again.image(DESIGNED)
    with pytest.raises(DataError, match=r"looks like a print of correction 0 .*print of correction 1"):
        lab.tuned(first, tuned[0].log)
    design = tmp_path / "wanted.toml"
    design.write_text(template("solen-860"))
    with pytest.raises(DataError, match=r"is correction 0 .*print of correction 1"):
        lab.tuned(first, tuned[0].log, drawn=design)
    copy = lab.tuned(first, tuned[0].log, another_copy=True)
    assert [step.drawing for step in copy.history] == [0, 0]
    assert copy.common.u_overgrowth_um < tuned[0].common.u_overgrowth_um * 1.2


def test_a_log_of_another_design_or_printer_is_refused(lab: Lab, tuned: list[TunedPrint]) -> None:
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


def test_what_an_image_does_not_tell_is_not_corrected(lab: Lab, tuned: list[TunedPrint]) -> None:
    """Without the face the odd part stays, without the scale's uncertainty the size; both are said."""
    blind = lab.tuned(lab.folder / "print-1.png", seen_from=None, u_um_per_px=None)
    drawn, told = blind.compensation.drawn_um, tuned[0].compensation.drawn_um
    assert np.abs(drawn - drawn[::-1]).max() < 1.0
    assert np.abs(told - told[::-1]).max() > 4.0
    assert blind.scale == pytest.approx(1.0, abs=1e-4)
    assert blind.predicted.rms_um > 2.0
    assert "size" not in blind.corrected
    said = " ".join(blind.warnings)
    assert "--seen-from" in said
    assert "--u-um-per-px" in said
    # so the drawing is kept, and the next image is one of it, without a word
    assert blind.kept
    again = Lab(lab.folder, lab.printer, taken=50)
    second = again.tuned(again.image(DESIGNED), blind.log, seen_from=None, u_um_per_px=None)
    assert [step.drawing for step in second.history] == [0, 0]
    assert second.history[1].predicted == blind.predicted
    low, high = blind.predicted.interval95_rms_um
    assert low < second.rms_um < high
    assert second.common.prints == 2


def test_a_drawing_that_no_correction_betters_is_kept(tmp_path: Path) -> None:
    """Of this image, without its face and its scale's uncertainty, a correction is predicted to do harm."""
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


def test_a_lens_that_differs_by_height_is_not_tuned(tmp_path: Path) -> None:
    """It is refused before the image is asked for."""
    design, out = tmp_path / "sensor.toml", tmp_path / "out"
    design.write_text(template("solen-860"), encoding="utf-8")
    with pytest.raises(DesignError, match=r"layered.*--compensate.*--bottom"):
        tune_files(tmp_path / "none.tif", design=design, out=out, set_=["lens.shape=layered"])
    assert not out.exists()


def test_a_blurred_image_and_another_lens_are_said(lab: Lab) -> None:
    blurred = lab.tuned(Lab(lab.folder, lab.printer, taken=30).image(DESIGNED, optics=gaussian(9.0)))
    assert any("out of focus" in warning for warning in blurred.warnings)
    foreign = lab.tuned(Lab(lab.folder, Printer(curl_um=0.0), taken=40).image(lens("solen-450")))
    assert any("n = 1.54" in warning and warning.startswith("do not use") for warning in foreign.warnings)


@pytest.mark.evidence
def test_predictions_cover_on_many_printers(tmp_path: Path) -> None:
    """Of 12 printers, each with its own blur, growth, shrinkage, tilt, curl and scatter: three predictions each."""
    covered, above, fell = [], [], []
    for seed in range(12):
        rng = np.random.default_rng([seed, 5])
        printer = Printer(
            level=rng.uniform(0.18, 0.4),
            tilt=rng.uniform(-0.1, 0.1),
            shrinkage=rng.uniform(0.0, 0.012),
            curl_um=rng.uniform(1.0, 6.0),
            once_um=0.4 * 2.0 ** rng.normal(0.0, 0.7),
            disc_mm=rng.uniform(0.018, 0.03),
        )
        folder = tmp_path / str(seed)
        folder.mkdir()
        lab, ring, true = Lab(folder, printer), DESIGNED, []
        answers: list[TunedPrint] = []
        for number in range(1, PRINTS + 2):
            true.append(true_rms_um(printer.printed(ring, number)))
            if answers:
                low, high = answers[-1].predicted.interval95_rms_um
                covered.append(low < true[-1] < high)
                above.append(true[-1] > high)
                print(f"{seed}: {true[-1]:.2f} in {low:.2f} to {high:.2f}")
            if number <= PRINTS:
                answers.append(lab.tuned(lab.image(ring), answers[-1].log if answers else None))
                ring = drawn_by(answers[-1])
        fell.append(true[-1] / true[0])
        print(seed, [round(um, 2) for um in true], covered[-PRINTS:])
    print(f"{np.mean(covered):.3f} of {len(covered)} within, {sum(above)} above; median fall {np.median(fell):.2f}")
    assert np.mean(covered) > 0.75  # what is outside is nearer to the design than predicted
    assert np.mean(above) < 0.06
    assert np.median(fell) < 0.65


def test_a_measured_pixel_is_as_wide_as_prints_show_it(tmp_path: Path) -> None:
    """What is learnt of the printer's blur is the scale of its response, where the process states one."""
    lab = Lab(tmp_path, Printer())
    x = 3.0 * np.arange(-30, 31)
    light = np.exp(-0.5 * (x[:, None] ** 2 + (x - 6.0) ** 2) / 15.0**2)
    np.savetxt(tmp_path / "pixel.csv", light, delimiter=",")
    slicing = lab.slicing
    stated = '[process.response]\nfile = "pixel.csv"\npitch_um = 3.0\n'
    (tmp_path / "process.toml").write_text(f'schema = 1\nname = "lab"\n{stated}')
    model = PrintModel.of(SENSOR, slicing)
    assert model.settings.sigma_um is None
    assert model.wider is not None
    assert model.wider.settings.response_scale == pytest.approx(1.05)
    assert model.with_more_blur(-2.0).settings.response_scale == pytest.approx(0.9)
    assert model.min_blur == pytest.approx(-10.0)
