"""Cut-back: exact lines, units, replicates, outliers, orientations, and the coverage of the interval."""

import math

import numpy as np
import pytest

from solen.errors import DataError
from solen.material.loss import (
    GuideLoss,
    absorption_per_mm,
    cut_back,
    launched_level_dB,
    levels_dB,
    smallest_loss_dB_per_cm,
)

LENGTHS = np.repeat([10.0, 20.0, 30.0, 40.0, 50.0], 3)
GUIDES = [str(number) for number in range(15)]


def table(
    rng: np.random.Generator, loss: float = 1.5, guide_dB: float = 0.3, reading_dB: float = 0.1, readings: int = 4
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return the lengths, levels and names of fifteen guides, each measured several times."""
    lengths = np.repeat(LENGTHS, readings)
    deviation = np.repeat(rng.normal(0.0, guide_dB, 15), readings)
    level = -5.0 - loss * lengths / 10.0 + deviation + rng.normal(0.0, reading_dB, len(lengths))
    return lengths, level, [name for name in GUIDES for _ in range(readings)]


def covers(result: GuideLoss, loss: float) -> bool:
    low, high = result.interval95_loss_dB_per_cm
    return low <= loss <= high


def test_an_exact_table_yields_its_loss() -> None:
    result = cut_back([10.0, 20.0, 40.0, 40.0], [-3.0, -4.0, -6.0, -6.0], ["a", "b", "c", "d"])
    assert result.loss_dB_per_cm == pytest.approx(1.0, rel=1e-12)
    assert result.start_dB == pytest.approx(-2.0, rel=1e-12)
    assert result.interval95_loss_dB_per_cm == pytest.approx((1.0, 1.0), rel=1e-9)
    assert result.absorption_per_mm == pytest.approx(math.log(10.0) / 100.0)
    assert result.outliers == ()
    assert result.level_dB([0.0, 100.0]) == pytest.approx([-2.0, -12.0])


def test_the_absorption_coefficient_refers_to_power_and_base_e() -> None:
    per_mm = absorption_per_mm(2.5)
    assert math.exp(-per_mm * 40.0) == pytest.approx(10.0 ** (-2.5 * 4.0 / 10.0), rel=1e-12)


def test_a_thin_layer_does_not_resolve_the_loss() -> None:
    """0.1 % in 25 µm corresponds to 0.4 per cm, 1.7 dB/cm, and a factor of 5 in 40 mm."""
    loss = smallest_loss_dB_per_cm(25.0, 1e-3)
    assert loss == pytest.approx(1.738, abs=1e-3)
    assert absorption_per_mm(loss) * 10.0 == pytest.approx(0.4002, abs=1e-4)
    assert 10.0 ** (loss * 4.0 / 10.0) == pytest.approx(5.0, abs=0.05)
    with pytest.raises(DataError, match="above 0 µm"):
        smallest_loss_dB_per_cm(0.0, 1e-3)


@pytest.mark.parametrize(
    ("readings", "unit", "dark"),
    [
        ([2.0, 1.0, 0.5], "mW", None),
        ([2000.0, 1000.0, 500.0], "µW", None),
        ([3.0103, 0.0, -3.0103], "dBm", None),
        ([2.1, 1.1, 0.6], "V", 0.1),
        ([2.9, 3.9, 4.4], "V", 4.9),  # light lowers the voltage
        ([10 * math.log10(2.0 + 0.1), 10 * math.log10(1.1), 10 * math.log10(0.6)], "dBm", -10.0),
        ([100.0, 50.0, 25.0], "%", None),
    ],
)
def test_differences_of_levels_are_ratios_of_power(readings: list[float], unit: str, dark: float | None) -> None:
    levels = levels_dB(readings, unit, dark)
    assert np.diff(levels) == pytest.approx([-3.0103, -3.0103], abs=1e-4)


@pytest.mark.parametrize(
    ("readings", "unit", "dark", "line"),
    [
        ([1.0, 0.0], "mW", None, r"0 mW \(reading 2\)'; must be above 0"),
        ([1.0, -0.2, 0.3, -1.0, -2.0, -3.0], "V", None, r"-0.2 V \(reading 2\).* and 1 more'; must be above 0"),
        ([1.0, 0.2], "V", 0.5, r"0.2 V .*above, or all below, the dark reading of 0.5 V"),
    ],
)
def test_refuses_readings_without_light(readings: list[float], unit: str, dark: float | None, line: str) -> None:
    with pytest.raises(DataError, match=line):
        levels_dB(readings, unit, dark)


def test_the_launched_level_follows_from_the_unit() -> None:
    assert launched_level_dB("mW", 2.0, [1.0]) == pytest.approx(3.0103, abs=1e-4)
    assert launched_level_dB("mW", None, [1.0]) is None
    assert launched_level_dB("%", None, [50.0]) == pytest.approx(20.0)
    assert launched_level_dB("%", None, [150.0]) is None  # not relative to the launched power
    assert launched_level_dB("dB", None, [-3.0]) == 0.0
    assert launched_level_dB("dBm", 3.0, [-3.0]) == 3.0
    with pytest.raises(DataError, match="above 0 mW"):
        launched_level_dB("mW", -1.0, [1.0])


def test_the_interval_of_guides_with_repeated_readings_covers_the_truth() -> None:
    """Readings scatter less than guides: treating them as independent pieces yields intervals that are too narrow."""
    rng, draws = np.random.default_rng(11), 600
    tables = [table(rng) for _ in range(draws)]
    covered = np.mean([covers(cut_back(*columns), 1.5) for columns in tables])
    assert abs(covered - 0.95) < 3.5 * math.sqrt(0.95 * 0.05 / draws)
    pieces = [str(number) for number in range(60)]
    naive = np.mean([covers(cut_back(lengths, level, pieces), 1.5) for lengths, level, _ in tables[:100]])
    assert naive < 0.8


@pytest.mark.parametrize(("guides", "cuts", "loss_sd"), [(5, 4, 0.0), (5, 4, 0.15), (3, 5, 0.15)])
def test_the_interval_of_guides_that_were_cut_covers_the_truth(guides: int, cuts: int, loss_sd: float) -> None:
    """Guides cut to several lengths, each with a different coupling and, with ``loss_sd``, a different loss."""
    rng, draws = np.random.default_rng(13), 150
    lengths, names = np.tile(np.linspace(10.0, 40.0, cuts), guides), np.repeat(np.arange(guides), cuts)
    covered = 0
    for _ in range(draws):
        loss = 1.5 + rng.normal(0.0, loss_sd, guides)[names]
        level = -loss * lengths / 10.0 + rng.normal(0.0, 0.4, guides)[names] + rng.normal(0.0, 0.1, len(lengths))
        covered += covers(cut_back(lengths, level, [str(name) for name in names], keep_all=True), 1.5)
    assert 0.95 - 4.0 * math.sqrt(0.95 * 0.05 / draws) < covered / draws <= 1.0  # REML is conservative if loss_sd is 0


def test_the_coupling_of_guides_that_are_cut_does_not_affect_the_loss() -> None:
    """Guides of very different coupling, each cut to three lengths: only the slopes within guides matter."""
    lengths = np.tile([10.0, 20.0, 30.0], 3)
    noise = np.array([0.01, -0.02, 0.01] * 3) * np.repeat([1.0, -1.0, 1.0], 3)
    level = np.repeat([0.0, -7.0, -3.0], 3) - 1.2 * lengths / 10.0 + noise
    result = cut_back(lengths, level, [name for name in "abc" for _ in range(3)])
    assert result.loss_dB_per_cm == pytest.approx(1.2, abs=1e-3)
    assert result.u_loss_dB_per_cm < 0.02
    assert result.sd_guide_dB == pytest.approx(np.std([0.0, -7.0, -3.0], ddof=1), rel=0.02)


def test_an_outlier_is_named_and_both_results_are_reported() -> None:
    rng = np.random.default_rng(17)
    lengths, level, guides = table(rng)
    level[4 * 13 : 4 * 14] -= 4.0
    result = cut_back(lengths, level, guides)
    assert [outlier.piece.guide for outlier in result.outliers] == ["13"]
    assert result.outliers[0].deviation_dB == pytest.approx(-4.0, abs=1.0)
    assert covers(result, 1.5)
    assert result.with_outliers is not None
    assert result.with_outliers.loss_dB_per_cm > result.interval95_loss_dB_per_cm[1]
    assert "guide 13 (50 mm) is excluded as an outlier" in result.warnings[0]
    assert f"{result.with_outliers.loss_dB_per_cm:.3g} dB/cm" in result.warnings[1]
    with_all = cut_back(lengths, level, guides, keep_all=True)
    assert with_all.outliers == ()
    assert with_all.loss_dB_per_cm == result.with_outliers.loss_dB_per_cm


def two_orientations(rng: np.random.Generator, flat_loss: float, upright_loss: float) -> GuideLoss:
    flat, upright = table(rng, flat_loss, readings=1), table(rng, upright_loss, readings=1)
    lengths, levels = (np.concatenate([flat[column], upright[column]]) for column in (0, 1))
    return cut_back(lengths, levels, flat[2] + upright[2], ["flat"] * 15 + ["upright"] * 15)


def test_orientations_that_differ_are_distinguished() -> None:
    result = two_orientations(np.random.default_rng(19), 1.3, 2.1)
    assert [line.orientation for line in result.by_orientation] == ["flat", "upright"]
    for line, loss in zip(result.by_orientation, (1.3, 2.1), strict=True):
        assert line.interval95_loss_dB_per_cm[0] < loss < line.interval95_loss_dB_per_cm[1]
        assert line.pieces == 15
    assert result.p_orientation is not None
    assert result.p_orientation < 1e-4
    assert any("use the value for your orientation" in line for line in result.warnings)


def test_the_false_alarm_rate_of_the_test_of_orientations_is_nominal() -> None:
    rng, draws = np.random.default_rng(23), 300
    results = [two_orientations(rng, 1.5, 1.5) for _ in range(draws)]
    alarms = np.mean([result.p_orientation is not None and result.p_orientation < 0.05 for result in results])
    assert abs(alarms - 0.05) < 3.5 * math.sqrt(0.05 * 0.95 / draws)
    quiet = next(result for result in results if result.p_orientation is not None and result.p_orientation > 0.05)
    assert any("does not prove that there is none" in line for line in quiet.warnings)


def test_an_orientation_with_a_single_length_has_no_loss_and_is_reported() -> None:
    lengths, level, guides = table(np.random.default_rng(27), readings=1)
    flat = cut_back(lengths, level, guides, ["flat"] * 15)
    assert [line.orientation for line in flat.by_orientation] == ["flat"]
    assert flat.by_orientation[0].loss_dB_per_cm == pytest.approx(flat.loss_dB_per_cm)
    assert flat.p_orientation is None
    both = cut_back(lengths, level, guides, ["upright"] * 3 + ["flat"] * 12)
    assert [line.orientation for line in both.by_orientation] == ["flat"]
    assert any("separate loss: upright" in line for line in both.warnings)


def test_guides_of_the_same_name_in_two_orientations_are_distinct() -> None:
    lengths = np.tile([10.0, 20.0, 30.0], 4)
    orientations = ["flat"] * 6 + ["upright"] * 6
    rng = np.random.default_rng(29)
    level = -lengths / 10.0 + rng.normal(0.0, 0.1, 12)
    result = cut_back(lengths, level, ["1", "2", "3"] * 4, orientations)
    assert result.guides == 6
    assert result.pieces == 6  # the same guide at the same length is one piece


def test_a_background_that_was_not_subtracted_flattens_the_line() -> None:
    rng = np.random.default_rng(31)
    lengths = np.repeat([10.0, 30.0, 50.0, 70.0, 90.0], 3)
    power = 10.0 ** (-0.15 * lengths / 10.0 + rng.normal(0.0, 0.005, 15)) + 0.05
    result = cut_back(lengths, levels_dB(power, "mW"), GUIDES)
    assert result.p_curved is not None
    assert result.p_curved < 0.01
    assert any("flattens with length" in line and "dark reading" in line for line in result.warnings)
    corrected = cut_back(lengths, levels_dB(power, "mW", 0.05), GUIDES)
    assert covers(corrected, 1.5)
    assert not any("flattens" in line for line in corrected.warnings)


@pytest.mark.parametrize(
    ("lengths", "guides", "orientations", "line"),
    [
        ([20.0, 20.0, 20.0], ["a", "b", "c"], None, "single length"),
        ([10.0, 20.0], ["a", "b"], None, "pieces = 2; must be more than the number of fitted parameters, 2"),
        ([10.0, 20.0, 10.0, 20.0], ["a", "b", "a", "b"], None, "pieces = 2; "),
        ([10.0, 20.0, 30.0], None, ["x", "y", "z"], "a single length in each orientation"),
        ([10.0, -20.0, 30.0], None, None, r"length = '-20 \(reading 2\)'; must be from 0.001 to 1e.06 mm"),
    ],
)
def test_refuses_guides_that_determine_no_loss(
    lengths: list[float], guides: list[str] | None, orientations: list[str] | None, line: str
) -> None:
    with pytest.raises(DataError, match=line):
        cut_back(lengths, -0.1 * np.abs(lengths), guides, orientations)


def test_refuses_a_level_that_is_not_a_number() -> None:
    with pytest.raises(DataError, match="level"):
        cut_back([10.0, 20.0, 30.0], [0.0, math.nan, -2.0])


@pytest.mark.parametrize(
    ("lengths", "loss", "scatter", "line"),
    [
        ([10.0, 10.0, 20.0, 20.0], 1.0, 0.05, "two lengths"),
        ([10.0, 10.5, 11.0, 11.5, 12.0], 1.0, 0.5, "not resolved"),
        ([10.0, 20.0, 30.0, 40.0, 50.0], -2.0, 0.1, "not a loss"),
        ([10.0, 12.0, 14.0, 16.0, 20.0], 1.2, 0.2, "within a factor"),
        ([10.0, 20.0, 30.0], 1.0, 0.02, "1.0 degrees of freedom"),
    ],
)
def test_warns_of_poorly_determined_results(lengths: list[float], loss: float, scatter: float, line: str) -> None:
    noise = scatter * np.resize([1.0, -0.6, -0.8, 0.5, -0.1], len(lengths))
    result = cut_back(lengths, noise - loss * np.array(lengths) / 10.0, [str(k) for k in range(len(lengths))])
    assert any(line in warning for warning in result.warnings), result.warnings


def test_without_names_readings_of_the_same_length_belong_to_one_guide() -> None:
    lengths, level, _ = table(np.random.default_rng(37))
    result = cut_back(lengths, level)
    assert result.pieces == result.lengths == 5
    assert result.sd_reading_dB is not None
    assert result.sd_reading_dB > 0.2  # includes the scatter between guides
