"""Cut-back: exact lines, units, replicates, bad pieces, orientations, and how often the interval holds the truth."""

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
    """Lengths, levels and guides of fifteen guides, each read several times."""
    lengths = np.repeat(LENGTHS, readings)
    own = np.repeat(rng.normal(0.0, guide_dB, 15), readings)
    level = -5.0 - loss * lengths / 10.0 + own + rng.normal(0.0, reading_dB, len(lengths))
    return lengths, level, [name for name in GUIDES for _ in range(readings)]


def holds(found: GuideLoss, loss: float) -> bool:
    low, high = found.interval95_loss_dB_per_cm
    return low <= loss <= high


def test_an_exact_table_gives_its_loss() -> None:
    found = cut_back([10.0, 20.0, 40.0, 40.0], [-3.0, -4.0, -6.0, -6.0], ["a", "b", "c", "d"])
    assert found.loss_dB_per_cm == pytest.approx(1.0, rel=1e-12)
    assert found.start_dB == pytest.approx(-2.0, rel=1e-12)
    assert found.interval95_loss_dB_per_cm == pytest.approx((1.0, 1.0), rel=1e-9)
    assert found.absorption_per_mm == pytest.approx(math.log(10.0) / 100.0)
    assert found.outliers == ()
    assert found.level_dB([0.0, 100.0]) == pytest.approx([-2.0, -12.0])


def test_absorption_is_that_of_power_base_e() -> None:
    per_mm = absorption_per_mm(2.5)
    assert math.exp(-per_mm * 40.0) == pytest.approx(10.0 ** (-2.5 * 4.0 / 10.0), rel=1e-12)


def test_one_thin_layer_says_nothing_of_loss() -> None:
    """0.1 % over 25 µm: 0.4 per cm, 1.7 dB/cm, and a factor 5 over 40 mm."""
    least = smallest_loss_dB_per_cm(25.0, 1e-3)
    assert least == pytest.approx(1.738, abs=1e-3)
    assert absorption_per_mm(least) * 10.0 == pytest.approx(0.4002, abs=1e-4)
    assert 10.0 ** (least * 4.0 / 10.0) == pytest.approx(5.0, abs=0.05)
    with pytest.raises(DataError, match="above 0 µm"):
        smallest_loss_dB_per_cm(0.0, 1e-3)


@pytest.mark.parametrize(
    ("readings", "unit", "dark"),
    [
        ([2.0, 1.0, 0.5], "mW", None),
        ([2000.0, 1000.0, 500.0], "µW", None),
        ([3.0103, 0.0, -3.0103], "dBm", None),
        ([2.1, 1.1, 0.6], "V", 0.1),
        ([2.9, 3.9, 4.4], "V", 4.9),  # pulled down by light
        ([10 * math.log10(2.0 + 0.1), 10 * math.log10(1.1), 10 * math.log10(0.6)], "dBm", -10.0),
        ([100.0, 50.0, 25.0], "%", None),
    ],
)
def test_levels_differ_by_the_ratio_of_the_light(readings: list[float], unit: str, dark: float | None) -> None:
    levels = levels_dB(readings, unit, dark)
    assert np.diff(levels) == pytest.approx([-3.0103, -3.0103], abs=1e-4)


@pytest.mark.parametrize(
    ("readings", "unit", "dark", "told"),
    [
        ([1.0, 0.0], "mW", None, r"0 mW \(reading 2\)'; must be above 0"),
        ([1.0, -0.2, 0.3, -1.0, -2.0, -3.0], "V", None, r"-0.2 V \(reading 2\).* and 1 more'; must be above 0"),
        ([1.0, 0.2], "V", 0.5, "above, or all below, the dark reading 0.5 V"),
    ],
)
def test_readings_without_light_are_refused(readings: list[float], unit: str, dark: float | None, told: str) -> None:
    with pytest.raises(DataError, match=told):
        levels_dB(readings, unit, dark)


def test_what_was_launched_is_known_or_not() -> None:
    assert launched_level_dB("mW", 2.0, [1.0]) == pytest.approx(3.0103, abs=1e-4)
    assert launched_level_dB("mW", None, [1.0]) is None
    assert launched_level_dB("%", None, [50.0]) == pytest.approx(20.0)
    assert launched_level_dB("%", None, [150.0]) is None  # a share of something else
    assert launched_level_dB("dB", None, [-3.0]) == 0.0
    assert launched_level_dB("dBm", 3.0, [-3.0]) == 3.0
    with pytest.raises(DataError, match="above 0 mW"):
        launched_level_dB("mW", -1.0, [1.0])


def test_the_interval_of_guides_read_often_holds_the_truth() -> None:
    """600 tables; readings repeat far better than guides, so counting them as guides would be badly wrong."""
    rng, draws = np.random.default_rng(11), 600
    tables = [table(rng) for _ in range(draws)]
    share = np.mean([holds(cut_back(*one), 1.5) for one in tables])
    assert abs(share - 0.95) < 3.5 * math.sqrt(0.95 * 0.05 / draws)
    naive = np.mean([holds(cut_back(one[0], one[1], [str(k) for k in range(60)]), 1.5) for one in tables[:100]])
    assert naive < 0.8


@pytest.mark.parametrize(("guides", "cuts", "spread"), [(5, 4, 0.0), (5, 4, 0.15), (3, 5, 0.15)])
def test_the_interval_of_guides_that_were_cut_holds_the_truth(guides: int, cuts: int, spread: float) -> None:
    """Guides cut to several lengths, each with a start and, with ``spread``, a loss of its own."""
    rng, draws = np.random.default_rng(13), 150
    lengths, names = np.tile(np.linspace(10.0, 40.0, cuts), guides), np.repeat(np.arange(guides), cuts)
    kept = 0
    for _ in range(draws):
        loss = 1.5 + rng.normal(0.0, spread, guides)[names]
        level = -loss * lengths / 10.0 + rng.normal(0.0, 0.4, guides)[names] + rng.normal(0.0, 0.1, len(lengths))
        kept += holds(cut_back(lengths, level, [str(name) for name in names], keep_all=True), 1.5)
    assert 0.95 - 4.0 * math.sqrt(0.95 * 0.05 / draws) < kept / draws <= 1.0  # REML may only be wide where spread is 0


def test_a_guide_that_is_cut_does_not_mix_its_start_into_the_loss() -> None:
    """Guides of very different coupling, each cut to three lengths: only the lines within them count."""
    lengths = np.tile([10.0, 20.0, 30.0], 3)
    noise = np.array([0.01, -0.02, 0.01] * 3) * np.repeat([1.0, -1.0, 1.0], 3)
    level = np.repeat([0.0, -7.0, -3.0], 3) - 1.2 * lengths / 10.0 + noise
    found = cut_back(lengths, level, [name for name in "abc" for _ in range(3)])
    assert found.loss_dB_per_cm == pytest.approx(1.2, abs=1e-3)
    assert found.u_loss_dB_per_cm < 0.02
    assert found.sd_guide_dB == pytest.approx(np.std([0.0, -7.0, -3.0], ddof=1), rel=0.02)


def test_a_bad_piece_is_named_and_both_results_are_reported() -> None:
    rng = np.random.default_rng(17)
    lengths, level, guides = table(rng)
    level[4 * 13 : 4 * 14] -= 4.0
    found = cut_back(lengths, level, guides)
    assert [bad.piece.guide for bad in found.outliers] == ["13"]
    assert found.outliers[0].deviation_dB == pytest.approx(-4.0, abs=1.0)
    assert holds(found, 1.5)
    assert found.with_outliers is not None
    assert found.with_outliers.loss_dB_per_cm > found.interval95_loss_dB_per_cm[1]
    told = found.warnings
    assert "guide 13 (50 mm) is set aside" in told[0]
    assert f"{found.with_outliers.loss_dB_per_cm:.3g} dB/cm" in told[1]
    kept = cut_back(lengths, level, guides, keep_all=True)
    assert kept.outliers == ()
    assert kept.loss_dB_per_cm == found.with_outliers.loss_dB_per_cm


def two_ways(rng: np.random.Generator, flat: float, upright: float) -> GuideLoss:
    one, other = table(rng, flat, readings=1), table(rng, upright, readings=1)
    ways = ["flat"] * 15 + ["upright"] * 15
    return cut_back(np.concatenate([one[0], other[0]]), np.concatenate([one[1], other[1]]), one[2] + other[2], ways)


def test_orientations_that_differ_are_distinguished() -> None:
    found = two_ways(np.random.default_rng(19), 1.3, 2.1)
    assert [line.orientation for line in found.by_orientation] == ["flat", "upright"]
    for line, loss in zip(found.by_orientation, (1.3, 2.1), strict=True):
        assert line.interval95_loss_dB_per_cm[0] < loss < line.interval95_loss_dB_per_cm[1]
        assert line.pieces == 15
    assert found.p_orientation is not None
    assert found.p_orientation < 1e-4
    assert any("use the value for your orientation" in told for told in found.warnings)


def test_orientations_that_do_not_differ_are_found_to_at_the_rate_of_the_test() -> None:
    rng, draws = np.random.default_rng(23), 300
    found = [two_ways(rng, 1.5, 1.5) for _ in range(draws)]
    alarms = np.mean([one.p_orientation is not None and one.p_orientation < 0.05 for one in found])
    assert abs(alarms - 0.05) < 3.5 * math.sqrt(0.05 * 0.95 / draws)
    quiet = next(one for one in found if one.p_orientation is not None and one.p_orientation > 0.05)
    assert any("does not prove that there is none" in told for told in quiet.warnings)


def test_an_orientation_of_one_length_has_no_loss_and_that_is_said() -> None:
    lengths, level, guides = table(np.random.default_rng(27), readings=1)
    one = cut_back(lengths, level, guides, ["flat"] * 15)
    assert [line.orientation for line in one.by_orientation] == ["flat"]
    assert one.by_orientation[0].loss_dB_per_cm == pytest.approx(one.loss_dB_per_cm)
    assert one.p_orientation is None
    both = cut_back(lengths, level, guides, ["upright"] * 3 + ["flat"] * 12)
    assert [line.orientation for line in both.by_orientation] == ["flat"]
    assert any("separate loss: upright" in told for told in both.warnings)


def test_guides_of_one_name_in_two_orientations_are_two() -> None:
    lengths = np.tile([10.0, 20.0, 30.0], 4)
    ways = ["flat"] * 6 + ["upright"] * 6
    rng = np.random.default_rng(29)
    level = -lengths / 10.0 + rng.normal(0.0, 0.1, 12)
    found = cut_back(lengths, level, ["1", "2", "3"] * 4, ways)
    assert found.guides == 6
    assert found.pieces == 6  # the same guide at the same length is one piece


def test_a_background_that_was_not_taken_off_bends_the_line() -> None:
    rng = np.random.default_rng(31)
    lengths = np.repeat([10.0, 30.0, 50.0, 70.0, 90.0], 3)
    power = 10.0 ** (-0.15 * lengths / 10.0 + rng.normal(0.0, 0.005, 15)) + 0.05
    found = cut_back(lengths, levels_dB(power, "mW"), GUIDES)
    assert found.p_curved is not None
    assert found.p_curved < 0.01
    assert any("flattens with length" in told and "dark reading" in told for told in found.warnings)
    mended = cut_back(lengths, levels_dB(power, "mW", 0.05), GUIDES)
    assert holds(mended, 1.5)
    assert not any("flattens" in told for told in mended.warnings)


@pytest.mark.parametrize(
    ("lengths", "guides", "ways", "told"),
    [
        ([20.0, 20.0, 20.0], ["a", "b", "c"], None, "20 mm'; a single length determines no slope"),
        ([10.0, 20.0], ["a", "b"], None, "pieces = 2; 2 parameters are fitted"),
        ([10.0, 20.0, 10.0, 20.0], ["a", "b", "a", "b"], None, "readings of a guide count once"),
        ([10.0, 20.0, 30.0], None, ["x", "y", "z"], "one in each orientation"),
        ([10.0, -20.0, 30.0], None, None, r"length = '-20 \(reading 2\)'; must be from 0.001 to 1e.06 mm"),
    ],
)
def test_what_gives_no_loss_is_refused(
    lengths: list[float], guides: list[str] | None, ways: list[str] | None, told: str
) -> None:
    with pytest.raises(DataError, match=told):
        cut_back(lengths, -0.1 * np.abs(lengths), guides, ways)


def test_a_level_that_is_no_number_is_refused() -> None:
    with pytest.raises(DataError, match="level"):
        cut_back([10.0, 20.0, 30.0], [0.0, math.nan, -2.0])


@pytest.mark.parametrize(
    ("lengths", "loss", "scatter", "told"),
    [
        ([10.0, 10.0, 20.0, 20.0], 1.0, 0.05, "two lengths"),
        ([10.0, 10.5, 11.0, 11.5, 12.0], 1.0, 0.5, "not resolved"),
        ([10.0, 20.0, 30.0, 40.0, 50.0], -2.0, 0.1, "longer guides are brighter"),
        ([10.0, 12.0, 14.0, 16.0, 20.0], 1.2, 0.2, "within a factor"),
        ([10.0, 20.0, 30.0], 1.0, 0.02, "1.0 degrees of freedom"),
    ],
)
def test_what_is_badly_known_is_said(lengths: list[float], loss: float, scatter: float, told: str) -> None:
    off = scatter * np.resize([1.0, -0.6, -0.8, 0.5, -0.1], len(lengths))
    found = cut_back(lengths, off - loss * np.array(lengths) / 10.0, [str(k) for k in range(len(lengths))])
    assert any(told in sentence for sentence in found.warnings), found.warnings


def test_without_guides_readings_of_a_length_are_one_guide() -> None:
    lengths, level, _ = table(np.random.default_rng(37))
    found = cut_back(lengths, level)
    assert found.pieces == found.lengths == 5
    assert found.sd_reading_dB is not None
    assert found.sd_reading_dB > 0.2  # what guides differ by is in it
