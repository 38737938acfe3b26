"""Tolerance analysis: surrogates and yields compared with exact values and brute force, and default variations."""

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
    """Return merits of prints from a formula."""
    null = 1.2 * x[:, 0] + 0.4 * x[:, 1] * x[:, 0] + 0.3 * x[:, 2] ** 2
    slope = 1.0 + 0.2 * np.sin(3.0 * x[:, 2]) + 0.1 * x[:, 1] + 0.05 * x[:, 0] ** 2
    others = dict.fromkeys(NAMES, np.zeros(len(x)))
    return others | {"null_deg": null, "slope_per_deg": slope}


def test_sobol_indices_of_ishigami_function() -> None:
    """Exact: first order 0.3139, 0.4424, 0; total 0.5576, 0.4424, 0.2437 (Ishigami and Homma 1990)."""
    variations = [Variation(key, "uniform", -math.pi, math.pi) for key in "abc"]
    x = draw_deviations(variations, 1024, 0)
    y = np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    surrogate = fit(variations, x, y)
    assert surrogate.first_order == pytest.approx([0.3139, 0.4424, 0.0], abs=0.005)
    assert surrogate.total == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.005)
    x = draw_deviations(variations, 4096, 5)
    truth = np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    unexplained = float(np.var(surrogate(x) - truth) / np.var(truth))
    assert surrogate.held_out / 10.0 < unexplained < 10.0 * surrogate.held_out


def brute_force_yield(prints: int) -> float:
    merits = merits_of(draw_deviations(VARIATIONS, prints, 77))
    return float(np.logical_and.reduce([requirement.met(merits, BASE) for requirement in REQUIREMENTS]).mean())


def test_yield_agrees_with_brute_force() -> None:
    truth = brute_force_yield(2**17)
    errors, ratio = [], []
    for seed in range(6):
        x = draw_deviations(VARIATIONS, 256, seed)
        estimate, u = Prints(VARIATIONS, x, merits_of(x), BASE).yield_of(REQUIREMENTS)
        errors.append(estimate - truth)
        ratio.append((estimate - truth) / u)
    assert math.sqrt(np.mean(np.square(errors))) < 0.01
    assert math.sqrt(np.mean(np.square(ratio))) < 1.3
    assert np.abs(ratio).max() < 3.5


def test_uncertainty_of_yield_includes_that_of_merits() -> None:
    x = draw_deviations(VARIATIONS, 64, 3)
    exact = merits_of(x)
    uncertain = exact | {"u_null_deg": np.full(64, 0.5)}
    _, u_exact = Prints(VARIATIONS, x, exact, BASE).yield_of(REQUIREMENTS)
    _, u_uncertain = Prints(VARIATIONS, x, uncertain, BASE).yield_of(REQUIREMENTS)
    assert u_uncertain**2 > u_exact**2 + 0.03**2


def test_individual_noise_is_not_treated_as_common() -> None:
    """The slope of each print has a noise of 4 %."""
    truth = brute_force_yield(2**15)
    errors, u = np.empty(4), np.empty(4)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        x = draw_deviations(VARIATIONS, 128, seed)
        noisy = merits_of(x) | {"u_slope_per_deg": np.full(128, 0.04)}
        noisy["slope_per_deg"] = noisy["slope_per_deg"] + rng.normal(0.0, 0.04, 128)
        estimate, u[seed] = Prints(VARIATIONS, x, noisy, BASE).yield_of(REQUIREMENTS)
        errors[seed] = estimate - truth
    assert math.sqrt(np.mean((errors / u) ** 2)) < 1.3
    assert u.mean() < 0.05


def test_calibration_corrects_null_and_gain() -> None:
    x = draw_deviations(VARIATIONS, 64, 3)
    estimate, u = Prints(VARIATIONS, x, merits_of(x), BASE).yield_of(REQUIREMENTS, calibrated=True)
    assert estimate == 1.0
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
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Store with the prints of OPTIONS, traced once for all tests."""
    store = Store(tmp_path_factory.mktemp("prints"))
    tolerance(DESIGN, OPTIONS, store)
    return store


def test_null_is_due_to_decentre(store: Store) -> None:
    result = tolerance(DESIGN, OPTIONS, store)
    null = next(spread for spread in result.spreads if spread.merit == "null_deg")
    assert null.total["emitter.offset_mm"] > 0.95
    exact = math.erf(0.3 / (math.sqrt(2.0) * null.sd))
    assert result.yields[-1].share == pytest.approx(exact, abs=3.0 * result.yields[-1].u_share)
    assert result.varied[0].key == "emitter.offset_mm"
    assert result.varied[0].share_if_exact == 1.0
    factor = result.varied[0].factor_alone
    assert factor is not None
    assert factor * null.sd == pytest.approx(0.3 / 1.96, rel=0.1)
    assert result.table().count("\n") == 34
    data = result.to_dataset().sel({"print": 7})
    assert float(data["null_deg"]) == result.merits["null_deg"][6]
    assert float(data["emitter.offset_mm"]) == result.deviations["emitter.offset_mm"][6]
    assert bool(data["meets_all"]) == (abs(data["null_deg"]) < 0.3)


def test_figure_reports_prints_without_response(store: Store) -> None:
    result = tolerance(DESIGN, OPTIONS, store)
    incomplete = {name: np.where(np.arange(32) < 5, np.nan, values) for name, values in result.merits.items()}
    texts = [text.get_text() for text in tolerance_figure(replace(result, merits=incomplete)).findobj(Text)]
    assert any("5 without a response" in text for text in texts)
    assert sum("; 5 without" in text for text in texts) == len(result.spreads)
    assert any("grey: constant" in text for text in texts)  # in all prints, the range is that of the motion


def test_numbered_print_is_reproduced_as_design(store: Store) -> None:
    result = tolerance(DESIGN, OPTIONS, store)
    assert result.traced == 0
    design = print_design(DESIGN, OPTIONS.model_copy(update={"print_number": 7}))
    assert design is not None
    response = Sensor.of(design).power(tolerance=1e-3)
    null = response.null_deg()
    assert null == pytest.approx(result.merits["null_deg"][6], abs=3.0 * result.merits["u_null_deg"][6] + 0.02)


def test_default_variations_can_be_built() -> None:
    """An absorption of 0 does not vary to negative values; knots of a free form vary like other parameters."""
    knots = {"lens.shape": "spline", "lens.knots_um": [0.0, 5.0]}
    for design in (DESIGN, DESIGN.set(knots)):
        sensor = Sensor.of(design)
        default = {variation.key: variation for variation in variations_of(sensor, ())}
        assert default["material.absorption_per_mm"].first == 0.0
        assert default["emitter.offset_mm"].first < 0.0
        assert ("lens.knots_um[1]" in default) is (design is not DESIGN)
        assert deviations_by_key(list(default.values()), [0.0] * len(default)).keys() == default.keys()


def test_tolerance_does_not_extend_to_negative_absorption() -> None:
    sensor = Sensor.of(DESIGN.set({"material.absorption_per_mm": 0.004}))
    absorption = next(each for each in variations_of(sensor, ()) if each.key == "material.absorption_per_mm")
    assert (absorption.first, absorption.second) == (-0.004, 0.005)


def test_tightening_keeps_mean_of_normal_deviation() -> None:
    variations = [Variation("emitter.offset_mm", "normal", 2.0, 0.2)]
    x = draw_deviations(variations, 64, 3)
    merits = dict.fromkeys(NAMES, np.zeros(64)) | {"null_deg": x[:, 0]}
    (row,) = Prints(variations, x, merits, BASE).varied(Sensor.of(DESIGN), REQUIREMENTS[:1])
    assert (row.share_if_exact, row.factor_alone) == (0.0, None)


def test_missing_merits_give_no_yield_losses() -> None:
    x = draw_deviations(VARIATIONS, 64, 3)
    merits = merits_of(x)
    merits["null_deg"][5] = np.nan
    rows = Prints([Variation("emitter.offset_mm", "normal", 0.0, 1.0)], x[:, :1], merits, BASE).varied(
        Sensor.of(DESIGN), REQUIREMENTS
    )
    assert (rows[0].share_if_exact, rows[0].factor_alone) == (None, None)


def test_parameters_vary_together_with_weights(store: Store) -> None:
    assert weights_of("a.x_mm") == {"a.x_mm": 1.0}
    assert weights_of("a.x_mm + 0.5*b.y_mm-2e-1 * c.z") == {"a.x_mm": 1.0, "b.y_mm": 0.5, "c.z": -0.2}
    weighted = {"vary": ("emitter.offset_mm-0.5*emitter.offset_mm=normal:0:0.04", OPTIONS.vary[1])}
    result = tolerance(DESIGN, OPTIONS.model_copy(update=weighted), store)
    equivalent = tolerance(DESIGN, OPTIONS, store)
    assert result.merits["null_deg"] == pytest.approx(equivalent.merits["null_deg"], abs=1e-9)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("emitter.offset_mm", "distribution"),
        ("emitter.offset_mm=normal:0", "two numbers"),
        ("emitter.offset_mm=normal:0:-1", "standard deviation"),
        ("emitter.offset_mm=uniform:1:-1", "lower limit"),
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
def test_refuses_malformed_variation(text: str, reason: str) -> None:
    with pytest.raises(SpecError) as error:
        variation(text, Sensor.of(DESIGN))
    assert reason in str(error.value)


def test_adjustment_compensates_decentre(store: Store) -> None:
    """A decentred emitter is adjusted to the position of the design, unless the decentre exceeds the limit."""
    result = tolerance(DESIGN, OPTIONS.model_copy(update={"adjust": "emitter.offset_mm=0.02"}), store)
    (total,) = result.yields
    assert total.adjusted_share is not None
    assert total.u_adjusted_share is not None
    good = np.abs(result.deviations["emitter.offset_mm"]) < 0.02 + 0.3 * 0.02
    assert total.share < good.mean() - 0.05
    assert total.adjusted_share == pytest.approx(good.mean(), abs=3.0 * total.u_adjusted_share)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("emitter.offset_mm=0", "greater than 0"),
        ("emitter.offset_mm", "greater than 0"),
        ("emitter.height_mm=0.1", "plane"),
        ("body.arm_width_mm=0.05", "monotonic"),
    ],
)
def test_refuses_adjustment_without_effect(store: Store, text: str, reason: str) -> None:
    with pytest.raises(SpecError) as error:
        tolerance(DESIGN, OPTIONS.model_copy(update={"adjust": text}), store)
    assert reason in str(error.value)
    assert "--adjust" in str(error.value)


def test_warns_of_requirement_missed_by_design(store: Store) -> None:
    result = tolerance(DESIGN, OPTIONS.model_copy(update={"require": ("span > 1.9", "abs(null_deg) < 0.3")}), store)
    (warning,) = result.warnings
    assert "design itself" in warning
    assert "span > 1.9" in warning


def test_warns_of_variation_without_effect(store: Store) -> None:
    vary = ("emitter.offset_mm=normal:0:0.02", "emitter.offset_mm-1*emitter.offset_mm=normal:0:1")
    result = tolerance(DESIGN, OPTIONS.model_copy(update={"vary": vary}), store)
    (warning,) = result.warnings
    assert vary[1].partition("=")[0] in warning


def test_default_variations_name_their_sources() -> None:
    sensor = Sensor.of(Design(name="resin", material={"resin": "pmma"}, tolerance={"body_arm_width_mm": 0.03}))
    sensor = replace(sensor, material=replace(sensor.material, u_index=0.002))
    vary = ["emitter.offset_mm=normal:0:0.1", "usual"]
    sources = {variation.key: variation.source for variation in variations_of(sensor, vary)}
    expected = {
        "emitter.offset_mm": "specified",
        "material.index": "resin pmma",
        "body.arm_width_mm": "[tolerance]",
        "emitter.distance_mm": "assumed",
    }
    assert {key: sources[key] for key in expected} == expected
    assert [variation.source for variation in variations_of(sensor, vary[:1])] == ["specified"]


def test_growth_and_shrinkage_are_correlated() -> None:
    """Growth and shrinkage of 10 ± 2 µm and 1 ± 0.2 %, calibrated with a correlation of -0.6."""
    process = default_process().with_settings(shrinkage_percent=1.0)
    calibration = {"keys": ("growth_um", "shrinkage_percent"), "covariance": ((4.0, -0.24), (-0.24, 0.04))}
    calibrated = Process(**process.model_dump() | {"calibration": calibration, "uncertainty": {}})
    sensor = Sensor.of(DESIGN)
    variations = process_variations(sensor, calibrated, compensated=False)
    growth = next(variation for variation in variations if variation.key == GROWTH)
    assert growth.first == pytest.approx(growth_um(calibrated.process))
    assert growth.second == pytest.approx(2.0)
    x = draw_deviations(variations, 2**12, 0)
    deviations = [deviations_by_key(variations, row) for row in x.tolist()]
    stem = np.array([print_["body.stem_length_mm"] for print_ in deviations]) / sensor.design.body.stem_length_mm
    distance = np.array([print_["emitter.distance_mm"] for print_ in deviations])
    assert -100.0 * stem.mean() == pytest.approx(1.0, rel=0.01)
    assert 100.0 * stem.std() == pytest.approx(0.2, rel=0.02)
    assert np.corrcoef(-stem, -distance)[0, 1] == pytest.approx(-0.6, abs=0.02)
    (growth, _) = process_variations(sensor, calibrated, compensated=True)
    assert growth.first == 0.0


def test_process_replaces_tolerances_of_lengths(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(process_text(default_process()), encoding="utf-8")
    keys = [variation.key for variation in variations_of(Sensor.of(DESIGN), (), path)]
    assert keys[:2] == [GROWTH, SHRINKAGE]
    assert "body.arm_width_mm" not in keys
    assert "emitter.distance_mm" in keys


def test_refuses_print_that_design_file_cannot_describe(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(process_text(default_process()), encoding="utf-8")
    offset = ("emitter.offset_mm=normal:0:0.02",)
    for options, reason in (
        ({"vary": offset, "process": path}, "growth of --process"),
        ({"vary": ("emitter.distance_mm=normal:0:0.02",)}, "keep this parameter"),
    ):
        with pytest.raises(SpecError, match=reason):
            print_design(DESIGN, ToleranceOptions(print_number=3, prints=32, **options))
    without_lens = print_design(
        DESIGN.set({"lens.shape": "none"}), ToleranceOptions(print_number=3, prints=32, vary=offset, process=path)
    )
    assert without_lens is not None
    assert without_lens.emitter.distance_mm < DESIGN.emitter.distance_mm
