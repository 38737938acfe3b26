"""Surrogates and yields against exact answers and brute force."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.explore.default_variations import GROWTH, SHRINKAGE, process_variations, variations_of
from solen.explore.merits import NAMES
from solen.explore.prints import Prints
from solen.explore.requirement import Requirement
from solen.explore.store import Store
from solen.explore.surrogate import fit
from solen.explore.tolerance import ToleranceOptions, print_design, tolerance
from solen.explore.variations import Variation, deviations_by_key, draw_deviations, variation, weights_of
from solen.fabricate.process.growth import growth_um
from solen.fabricate.process.process_file import Process, default_process, process_text
from solen.report.explore.tolerance import tolerance_figure
from solen.sensor import Sensor
from solen.spec import Design

REQUIREMENTS = [Requirement.parse("abs(null_deg) < 0.9"), Requirement.parse("abs(slope_per_deg / base - 1) < 0.2")]
VARIATIONS = [
    Variation("a", "normal", 0.0, 1.0),
    Variation("b", "uniform", -0.3, 0.3),
    Variation("c", "normal", 0.1, 0.5),
]
BASE = dict.fromkeys(NAMES, 1.0) | {"null_deg": 0.0}


def merits_of(x: FloatArray) -> dict[str, FloatArray]:
    """Merits of prints by a formula."""
    null = 1.2 * x[:, 0] + 0.4 * x[:, 1] * x[:, 0] + 0.3 * x[:, 2] ** 2
    slope = 1.0 + 0.2 * np.sin(3.0 * x[:, 2]) + 0.1 * x[:, 1] + 0.05 * x[:, 0] ** 2
    others = dict.fromkeys(NAMES, np.zeros(len(x)))
    return others | {"null_deg": null, "slope_per_deg": slope}


def test_indices_of_ishigami_are_exact_ones() -> None:
    """Exact: first order 0.3139, 0.4424, 0; total 0.5576, 0.4424, 0.2437 (Ishigami and Homma 1990)."""
    variations = [Variation(key, "uniform", -math.pi, math.pi) for key in "abc"]
    x = draw_deviations(variations, 1024, 0)
    y = np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    made = fit(variations, x, y)
    assert made.first_order == pytest.approx([0.3139, 0.4424, 0.0], abs=0.005)
    assert made.total == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.005)
    fresh = draw_deviations(variations, 4096, 5)
    truth = np.sin(fresh[:, 0]) + 7.0 * np.sin(fresh[:, 1]) ** 2 + 0.1 * fresh[:, 2] ** 4 * np.sin(fresh[:, 0])
    missed = float(np.var(made(fresh) - truth) / np.var(truth))
    assert made.held_out / 10.0 < missed < 10.0 * made.held_out


def test_a_yield_is_that_of_brute_force_within_its_uncertainty() -> None:
    many = draw_deviations(VARIATIONS, 2**17, 77)
    truth = float(np.logical_and.reduce([one.met(merits_of(many), BASE) for one in REQUIREMENTS]).mean())
    off, ratio = [], []
    for seed in range(6):
        x = draw_deviations(VARIATIONS, 256, seed)
        share, u = Prints(VARIATIONS, x, merits_of(x), BASE).yield_of(REQUIREMENTS)
        off.append(share - truth)
        ratio.append((share - truth) / u)
    assert math.sqrt(np.mean(np.square(off))) < 0.01
    assert math.sqrt(np.mean(np.square(ratio))) < 1.3
    assert np.abs(ratio).max() < 3.5


def test_a_yield_states_what_its_merits_leave_undecided() -> None:
    x = draw_deviations(VARIATIONS, 64, 3)
    sharp = merits_of(x)
    blurred = sharp | {"u_null_deg": np.full(64, 0.5)}
    _, u_sharp = Prints(VARIATIONS, x, sharp, BASE).yield_of(REQUIREMENTS)
    _, u_blurred = Prints(VARIATIONS, x, blurred, BASE).yield_of(REQUIREMENTS)
    assert u_blurred**2 > u_sharp**2 + 0.03**2


def test_noise_of_each_print_is_no_doubt_about_all_of_them() -> None:
    """Noise of 4 % of the slope."""
    many = draw_deviations(VARIATIONS, 2**15, 77)
    truth = float(np.logical_and.reduce([one.met(merits_of(many), BASE) for one in REQUIREMENTS]).mean())
    off, u = np.empty(4), np.empty(4)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        x = draw_deviations(VARIATIONS, 128, seed)
        noisy = merits_of(x) | {"u_slope_per_deg": np.full(128, 0.04)}
        noisy["slope_per_deg"] = noisy["slope_per_deg"] + rng.normal(0.0, 0.04, 128)
        share, u[seed] = Prints(VARIATIONS, x, noisy, BASE).yield_of(REQUIREMENTS)
        off[seed] = share - truth
    assert math.sqrt(np.mean((off / u) ** 2)) < 1.3
    assert u.mean() < 0.05


def test_calibration_removes_null_and_gain() -> None:
    x = draw_deviations(VARIATIONS, 64, 3)
    share, u = Prints(VARIATIONS, x, merits_of(x), BASE).yield_of(REQUIREMENTS, calibrated=True)
    assert share == 1.0
    assert u == pytest.approx(1.0 / 66.0)


DESIGN = Design(
    name="small",
    material={"index": 1.44},
    motion={"from_deg": -1.0, "to_deg": 1.0, "step_deg": 0.5},
    emitter={"width_mm": 0.2, "pattern": "lambertian", "cone_deg": 120.0},
)
OPTIONS = ToleranceOptions(
    vary=("emitter.offset_mm=normal:0:0.02", "material.index=uniform:-0.005:0.005"),
    require=("abs(null_deg) < 0.3",),
    prints=32,
    rays=4096,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Prints that are traced once, whichever test comes first."""
    store = Store(tmp_path_factory.mktemp("prints"))
    tolerance(DESIGN, OPTIONS, store)
    return store


def test_the_null_is_due_to_the_decentre_and_its_yield_that_of_a_normal_distribution(folder: Store) -> None:
    found = tolerance(DESIGN, OPTIONS, folder)
    null = next(one for one in found.spreads if one.merit == "null_deg")
    assert null.total["emitter.offset_mm"] > 0.95
    exact = math.erf(0.3 / (math.sqrt(2.0) * null.sd))
    assert found.yields[-1].share == pytest.approx(exact, abs=3.0 * found.yields[-1].u_share)
    assert found.varied[0].key == "emitter.offset_mm"
    assert found.varied[0].share_if_exact == 1.0
    factor = found.varied[0].factor_alone
    assert factor is not None
    assert factor * null.sd == pytest.approx(0.3 / 1.96, rel=0.1)
    assert found.table().count("\n") == 34
    data = found.to_dataset().sel({"print": 7})
    assert float(data["null_deg"]) == found.merits["null_deg"][6]
    assert float(data["emitter.offset_mm"]) == found.deviations["emitter.offset_mm"][6]
    assert bool(data["meets_all"]) == (abs(data["null_deg"]) < 0.3)


def test_a_figure_says_which_prints_it_cannot_show(folder: Store) -> None:
    found = tolerance(DESIGN, OPTIONS, folder)
    lacking = {name: np.where(np.arange(32) < 5, np.nan, values) for name, values in found.merits.items()}
    texts = [text.get_text() for text in tolerance_figure(replace(found, merits=lacking)).findobj(Text)]
    assert any("5 without a response" in text for text in texts)
    assert sum("; 5 without" in text for text in texts) == len(found.spreads)
    assert any("grey: constant" in text for text in texts)  # the range is that of the motion in all prints


def test_the_print_of_a_number_is_a_design_with_its_null(folder: Store) -> None:
    found = tolerance(DESIGN, OPTIONS, folder)
    assert found.traced == 0
    reopened = print_design(DESIGN, OPTIONS.model_copy(update={"print_number": 7}))
    assert reopened is not None
    response = Sensor.of(reopened).power(tolerance=1e-3)
    null = response.null_deg()
    assert null == pytest.approx(found.merits["null_deg"][6], abs=3.0 * found.merits["u_null_deg"][6] + 0.02)


def test_usual_prints_can_be_built() -> None:
    """An absorption of 0 is not off to below 0; knots of a free form are numbers like others."""
    knots = {"lens.shape": "spline", "lens.knots_um": [0.0, 5.0]}
    for design in (DESIGN, DESIGN.set(knots)):
        sensor = Sensor.of(design)
        usual = {one.key: one for one in variations_of(sensor, ())}
        assert usual["material.absorption_per_mm"].first == 0.0
        assert usual["emitter.offset_mm"].first < 0.0
        assert ("lens.knots_um[1]" in usual) is (design is not DESIGN)
        assert deviations_by_key(list(usual.values()), [0.0] * len(usual)).keys() == usual.keys()


def test_tolerances_end_where_a_number_would_be_negative() -> None:
    sensor = Sensor.of(DESIGN.set({"material.absorption_per_mm": 0.004}))
    absorption = {one.key: one for one in variations_of(sensor, ())}["material.absorption_per_mm"]
    assert (absorption.first, absorption.second) == (-0.004, 0.005)


def test_a_mean_stays_where_a_deviation_is_tightened() -> None:
    off = [Variation("emitter.offset_mm", "normal", 2.0, 0.2)]
    x = draw_deviations(off, 64, 3)
    merits = dict.fromkeys(NAMES, np.zeros(64)) | {"null_deg": x[:, 0]}
    (row,) = Prints(off, x, merits, BASE).varied(Sensor.of(DESIGN), REQUIREMENTS[:1])
    assert (row.share_if_exact, row.factor_alone) == (0.0, None)


def test_what_surrogates_do_not_know_is_not_reported() -> None:
    x = draw_deviations(VARIATIONS, 64, 3)
    merits = merits_of(x)
    merits["null_deg"][5] = np.nan
    rows = Prints([Variation("emitter.offset_mm", "normal", 0.0, 1.0)], x[:, :1], merits, BASE).varied(
        Sensor.of(DESIGN), REQUIREMENTS
    )
    assert (rows[0].share_if_exact, rows[0].factor_alone) == (None, None)


def test_numbers_move_together_by_their_weights(folder: Store) -> None:
    assert weights_of("a.x_mm") == {"a.x_mm": 1.0}
    assert weights_of("a.x_mm + 0.5*b.y_mm-2e-1 * c.z") == {"a.x_mm": 1.0, "b.y_mm": 0.5, "c.z": -0.2}
    both = {"vary": ("emitter.offset_mm-0.5*emitter.offset_mm=normal:0:0.04", OPTIONS.vary[1])}
    found = tolerance(DESIGN, OPTIONS.model_copy(update=both), folder)
    alone = tolerance(DESIGN, OPTIONS, folder)
    assert found.merits["null_deg"] == pytest.approx(alone.merits["null_deg"], abs=1e-9)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("emitter.offset_mm", "distribution"),
        ("emitter.offset_mm=normal:0", "two numbers"),
        ("emitter.offset_mm=normal:0:-1", "standard deviation"),
        ("emitter.offset_mm=uniform:1:-1", "lower end"),
        ("emitter.offset_mm=cauchy:0:1", "cauchy"),
        ("emitter.ofset_mm=normal:0:1", "ofset"),
        ("emitter.height_mm=normal:0:1", "plane"),
        ("motion.step_deg=normal:0:0.1", "motion.step_deg"),
        ("fabricate.film_mm=normal:0:0.1", "fabricate.film_mm"),
        ("1.2.3*emitter.offset_mm=normal:0:1", "1.2.3"),
        ("emitter.offset_mm*2=normal:0:1", "emitter.offset_mm*2"),
        ("emitter.offset_mm+emitter.height_mm=normal:0:1", "emitter.height_mm"),
    ],
)
def test_a_malformed_variation_is_refused_by_name(text: str, named: str) -> None:
    with pytest.raises(SpecError) as refused:
        variation(text, Sensor.of(DESIGN))
    assert named in str(refused.value)


def test_an_adjustment_of_the_emitter_takes_its_decentre_away(folder: Store) -> None:
    """Prints whose emitter alone is off are the design again, but where the limit is less than the decentre."""
    found = tolerance(DESIGN, OPTIONS.model_copy(update={"adjust": "emitter.offset_mm=0.02"}), folder)
    (whole,) = found.yields
    assert whole.adjusted_share is not None
    assert whole.u_adjusted_share is not None
    reached = np.abs(found.deviations["emitter.offset_mm"]) < 0.02 + 0.3 * 0.02
    assert whole.share < reached.mean() - 0.05
    assert whole.adjusted_share == pytest.approx(reached.mean(), abs=3.0 * whole.u_adjusted_share)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("emitter.offset_mm=0", "greater than 0"),
        ("emitter.offset_mm", "greater than 0"),
        ("emitter.height_mm=0.1", "plane"),
        ("body.arm_width_mm=0.05", "monotonic"),
    ],
)
def test_an_adjustment_without_effect_is_refused(folder: Store, text: str, named: str) -> None:
    with pytest.raises(SpecError) as refused:
        tolerance(DESIGN, OPTIONS.model_copy(update={"adjust": text}), folder)
    assert named in str(refused.value)
    assert "--adjust" in str(refused.value)


def test_a_requirement_that_the_design_misses_is_said(folder: Store) -> None:
    found = tolerance(DESIGN, OPTIONS.model_copy(update={"require": ("span > 1.9", "abs(null_deg) < 0.3")}), folder)
    (warning,) = found.warnings
    assert "design itself" in warning
    assert "span > 1.9" in warning


def test_a_number_that_changes_nothing_is_said(folder: Store) -> None:
    both = ("emitter.offset_mm=normal:0:0.02", "emitter.offset_mm-1*emitter.offset_mm=normal:0:1")
    found = tolerance(DESIGN, OPTIONS.model_copy(update={"vary": both}), folder)
    (warning,) = found.warnings
    assert both[1].partition("=")[0] in warning


def test_what_nobody_states_names_its_source() -> None:
    known = Design(name="resin", material={"resin": "pmma"}, tolerance={"body_arm_width_mm": 0.03})
    sensor = Sensor.of(known)
    sensor = replace(sensor, material=replace(sensor.material, u_index=0.002))
    usual = {one.key: one for one in variations_of(sensor, ["emitter.offset_mm=normal:0:0.1", "usual"])}
    sources = {key: usual[key].source for key in ("emitter.offset_mm", "material.index", "body.arm_width_mm")}
    assert sources == {
        "emitter.offset_mm": "specified",
        "material.index": "resin pmma",
        "body.arm_width_mm": "[tolerance]",
    }
    assert usual["emitter.distance_mm"].source == "assumed"
    assert [one.source for one in variations_of(sensor, ["emitter.offset_mm=normal:0:0.1"])] == ["specified"]


def test_prints_of_a_process_grow_and_shrink_together() -> None:
    """Growth and shrinkage of 10 ± 2 µm and 1 ± 0.2 %, calibrated with a correlation of -0.6."""
    process = default_process().with_settings(shrinkage_percent=1.0)
    calibration = {"keys": ("growth_um", "shrinkage_percent"), "covariance": ((4.0, -0.24), (-0.24, 0.04))}
    calibrated = Process(**process.model_dump() | {"calibration": calibration, "uncertainty": {}})
    sensor = Sensor.of(DESIGN)
    made = {one.key: one for one in process_variations(sensor, calibrated, compensated=False)}
    assert made[GROWTH].first == pytest.approx(growth_um(calibrated.process))
    assert made[GROWTH].second == pytest.approx(2.0)
    x = draw_deviations(list(made.values()), 2**12, 0)
    moved = [deviations_by_key(list(made.values()), row) for row in x.tolist()]
    stem = np.array([one["body.stem_length_mm"] for one in moved]) / sensor.design.body.stem_length_mm
    distance = np.array([one["emitter.distance_mm"] for one in moved])
    assert -100.0 * stem.mean() == pytest.approx(1.0, rel=0.01)
    assert 100.0 * stem.std() == pytest.approx(0.2, rel=0.02)
    assert np.corrcoef(-stem, -distance)[0, 1] == pytest.approx(-0.6, abs=0.02)
    (growth, _) = process_variations(sensor, calibrated, compensated=True)
    assert growth.first == 0.0


def test_a_process_takes_the_place_of_tolerances_of_lengths(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(process_text(default_process()), encoding="utf-8")
    keys = [one.key for one in variations_of(Sensor.of(DESIGN), (), path)]
    assert keys[:2] == [GROWTH, SHRINKAGE]
    assert "body.arm_width_mm" not in keys
    assert "emitter.distance_mm" in keys


def test_a_print_that_no_design_file_describes_is_refused_with_why(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(process_text(default_process()), encoding="utf-8")
    offset = ("emitter.offset_mm=normal:0:0.02",)
    for more, named in (
        ({"vary": offset, "process": path}, "growth of --process"),
        ({"vary": ("emitter.distance_mm=normal:0:0.02",)}, "keep it"),
    ):
        with pytest.raises(SpecError, match=named):
            print_design(DESIGN, ToleranceOptions(print_number=3, prints=32, **more))
    bare = print_design(
        DESIGN.set({"lens.shape": "none"}), ToleranceOptions(print_number=3, prints=32, vary=offset, process=path)
    )
    assert bare is not None
    assert bare.emitter.distance_mm < DESIGN.emitter.distance_mm
