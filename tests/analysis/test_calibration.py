"""Calibration and decoding: against the long way, on truths, and whether the bands hold what they say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from solen.analysis import AnalysisOptions, Signals, sensor_response
from solen.analysis.calibration import (
    Calibration,
    Decoder,
    Tracker,
    calibrated,
    leave_one_cycle_out,
    leave_one_sensor_out,
    pooled,
    training_of,
)
from solen.analysis.calibration.calibrate import default_path
from solen.analysis.calibration.posterior import posterior
from solen.arrays import FloatArray
from solen.errors import DataError
from tests.analysis.calibration_support import SHORT, trained
from tests.analysis.made_support import Truth, made

NOISY = Truth(noise_V=0.02, protocol=SHORT)


def known(left: FloatArray, right: FloatArray, angle: FloatArray, sd_V: float) -> Calibration:
    """A calibration whose curves and noise are given, known without error."""
    curve = np.column_stack([left, right])
    noise = np.tile(sd_V**2 * np.eye(2), (angle.size, 1, 1))
    none = np.zeros_like(noise)
    endless = np.full(angle.size, 1e9)
    rails = np.full((2, 2), np.nan)
    return Calibration(angle, np.array([curve, curve]), noise, none, none, endless, 10**6, 1, (10**6, 0), rails)


ANGLE = np.linspace(-3.0, 3.0, 61)


def test_straight_curves_have_the_answer_of_a_textbook() -> None:
    # V = ±a θ with noise s in both: θ is normal about (V_right − V_left)/2a with standard deviation s/(a √2)
    one = Decoder(known(-0.5 * ANGLE, 0.5 * ANGLE, ANGLE, 0.01))
    volts = np.array([[-0.41, 0.43], [0.6, -0.62]])
    found = one.decode(volts)
    middle, sd = (volts[:, 1] - volts[:, 0]) / 1.0, 0.01 / (0.5 * np.sqrt(2.0))
    assert found.angle_deg == pytest.approx(middle, abs=1e-5)
    for level, share in enumerate((0.68, 0.95)):
        half = norm.ppf(0.5 + share / 2.0) * sd
        assert found.high_deg[:, level] - middle == pytest.approx(half, rel=0.02)
        assert middle - found.low_deg[:, level] == pytest.approx(half, rel=0.02)
    assert found.distance == pytest.approx((volts.sum(axis=1) ** 2) / (2.0 * 0.01**2), rel=1e-6)
    assert not found.outside.any()
    assert not found.ambiguous.any()
    assert found.right == pytest.approx([0.0, 1.0], abs=1e-9)
    assert one.noise_deg(np.array([0.3])) == pytest.approx(sd, rel=1e-6)


@pytest.mark.parametrize(
    ("truth", "shape"),
    [(NOISY, ""), (replace(NOISY, noise_V=0.2, hysteresis_V=0.1), ""), (replace(NOISY, noise_V=0.05), "fold")],
)
def test_it_agrees_with_the_long_way(truth: Truth, shape: str) -> None:
    training = trained(truth, shape=shape)
    one = calibrated(training)
    fine = np.linspace(one.angle_deg[0], one.angle_deg[-1], 1501)
    width = fine[1] - fine[0]
    decoder = Decoder(one)
    for volts in training.samples.volts[7::400]:
        found = decoder.decode(volts[None])
        told = posterior(one, volts, fine)
        inside = sum(
            told[(fine >= low) & (fine <= high)].sum()
            for low, high in [(found.low_deg[0, 1], found.high_deg[0, 1]), *found.other_deg.tolist()]
        )
        # the covariance is constant within a piece here and not there; with two stretches each has its own 95 %
        assert 0.93 < inside < 0.985
        assert told[fine < 0.0].sum() == pytest.approx(found.right[0], abs=0.03)
        if not found.other.size:
            assert fine[np.searchsorted(np.cumsum(told), 0.5)] == pytest.approx(
                found.angle_deg[0], abs=2 * width + 0.01
            )


def test_two_angles_that_explain_a_reading_stay_two() -> None:
    # the right receiver turns back at 1.5°, and beyond 0.5° the left one says nothing
    one = Decoder(known(np.clip(ANGLE, -3.0, 0.5), -np.abs(ANGLE - 1.5), ANGLE, 0.01))
    both, single = one.decode(np.array([[0.5, -0.4]])), one.decode(np.array([[-1.0, -2.5]]))
    assert both.ambiguous.all()
    ends = sorted([*both.low_deg[:, 1].tolist(), *both.other_deg[:, 0].tolist()])
    assert ends == pytest.approx([1.1 - 0.0196, 1.9 - 0.0196], abs=0.002)
    assert both.probability[0] == pytest.approx(0.5, abs=0.01)
    assert both.probability[0] + both.other_probability.sum() == pytest.approx(1.0, abs=1e-6)
    assert both.holds(np.array([1.1]), 1).all()
    assert both.holds(np.array([1.9]), 1).all()
    assert not both.holds(np.array([1.5]), 1).any()
    assert not single.ambiguous.any()
    assert single.angle_deg[0] == pytest.approx(-1.0, abs=1e-3)


def test_where_both_receivers_say_nothing_the_band_says_so() -> None:
    flat = np.clip(ANGLE, -1.0, 1.0)
    found = Decoder(known(-flat, flat, ANGLE, 0.01)).decode(np.array([[-1.0, 1.0]]))
    assert found.low_deg[0, 1] < 1.15
    assert found.high_deg[0, 1] == 3.0
    assert found.at_end.all()


def test_readings_off_the_curve_are_outside() -> None:
    one = Decoder(known(-0.5 * ANGLE, 0.5 * ANGLE, ANGLE, 0.01))
    found = one.decode(np.array([[0.0, 0.0], [0.1, 0.1], [-2.0, 2.0]]))  # on it, beside it, beyond its end
    assert found.outside.tolist() == [False, True, True]
    # by chance alone, one in a thousand may be called so where the angle is known; the angle takes one dimension
    rng = np.random.default_rng(3)
    angle = rng.uniform(-2.5, 2.5, 20_000)
    drawn = one.decode(np.column_stack([-0.5 * angle, 0.5 * angle]) + 0.01 * rng.standard_normal((angle.size, 2)))
    assert drawn.outside.mean() < 1e-3
    assert drawn.holds(angle, 0).mean() == pytest.approx(0.68, abs=0.012)  # 3.6 standard deviations of the share
    assert drawn.holds(angle, 1).mean() == pytest.approx(0.95, abs=0.006)


def test_a_clipped_receiver_says_only_that_it_is_beyond() -> None:
    one = Decoder(known(-0.5 * ANGLE, np.clip(0.5 * ANGLE, -2.0, 0.5), ANGLE, 0.01))
    marks = np.array([[0, 1], [0, 0]], dtype=np.int8)
    found = one.decode(np.array([[-1.0, 0.5], [-1.0, 0.5]]), marks)
    assert found.clipped.tolist() == [True, False]
    assert found.angle_deg[0] == pytest.approx(2.0, abs=1e-3)  # by the left one, that of a single receiver's noise
    assert found.high_deg[0, 1] - found.low_deg[0, 1] == pytest.approx(2 * 1.96 * 0.02, rel=0.03)
    # the left one clipped instead: the right alone, and two-sided doubt where it has saturated
    other = one.decode(np.array([[-1.5, 0.2]]), np.array([[-1, 0]], dtype=np.int8))
    assert other.outside.all() or other.low_deg[0, 1] < other.angle_deg[0]
    nothing = one.decode(np.array([[1.5, 0.5]]), np.array([[1, 1]], dtype=np.int8))
    assert np.isfinite(nothing.angle_deg).all()


def test_a_gain_that_may_have_changed_widens_only_what_it_touches() -> None:
    calibration = known(2.0 - 0.3 * ANGLE, 2.0 + 0.3 * ANGLE, ANGLE, 0.005)
    volts = np.array([[2.0, 2.0], [1.4, 2.6]]) * 1.03  # an emitter that is 3 % brighter
    plain, allowed = Decoder(calibration).decode(volts), Decoder(calibration, gain_percent=5.0).decode(volts)
    assert plain.outside.all()
    assert not allowed.outside.any()
    assert allowed.angle_deg == pytest.approx([0.0, 2.0], abs=0.02)
    assert (allowed.high_deg - allowed.low_deg)[1, 1] > (allowed.high_deg - allowed.low_deg)[0, 1]


def test_the_same_with_one_reading_or_many_or_scattered_clips() -> None:
    training = trained(NOISY)
    decoder = Decoder(calibrated(training))
    volts = training.samples.volts[:1100]  # more than are worked on at once
    marks = np.zeros(volts.shape, dtype=np.int8)
    marks[5::50, 0] = -1
    many = decoder.decode(volts, marks)
    for row in (0, 5, 511, 512, 1055, 1099):
        one = decoder.decode(volts[row : row + 1], marks[row : row + 1])
        assert one.angle_deg[0] == pytest.approx(many.angle_deg[row], abs=1e-9)
        assert one.high_deg[0] == pytest.approx(many.high_deg[row], abs=1e-9)
        assert bool(one.clipped[0]) == bool(marks[row].any())
    assert decoder.decode(volts[:0]).angle_deg.size == 0


def test_curves_and_parts_of_the_covariance_are_those_of_the_truth() -> None:
    truth = replace(NOISY, noise_V=0.01, hysteresis_V=0.04, protocol=replace(SHORT, cycles=30))
    one = calibrated(trained(truth, cycle_V=0.03))
    inner = np.abs(one.angle_deg) < 2.5
    response = truth.response_V(one.angle_deg)
    assert one.curves_V.mean(axis=0)[inner] == pytest.approx(response[inner], abs=4 * 0.03 / np.sqrt(29))
    assert (one.curves_V[0] - one.curves_V[1])[inner].mean() == pytest.approx(0.04, abs=0.002)
    assert np.sqrt(one.noise[inner, 0, 0]).mean() == pytest.approx(0.01, rel=0.1)
    # 29 cycles know a standard deviation to 13 %
    assert np.sqrt(one.repeat[inner, 1, 1]).mean() == pytest.approx(0.03 * np.sqrt(1 + 1 / 29), rel=0.4)
    assert not one.between.any()


def coverage(truth: Truth, recordings: int, cycle_V: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Mean share of readings within the bands, of cycles left out of many recordings, and its standard error."""
    shares = []
    for seed in range(recordings):
        check = leave_one_cycle_out(trained(truth, seed=seed, cycle_V=cycle_V))
        assert check is not None
        moving = np.abs(check.true_deg) < 2.9  # where a hold stands at the end of the range, a band cannot miss it
        low, high = check.low_deg[moving], check.high_deg[moving]
        true = check.true_deg[moving, None]
        shares.append(((low <= true) & (true <= high)).mean(axis=0))
    return np.mean(shares, axis=0), np.std(shares, axis=0) / np.sqrt(recordings)


def test_bands_hold_what_they_say() -> None:
    # noise of one law; 12 recordings of 5 cycles with some 1000 readings each: ± 3 % at 68, ± 2 % at 95
    share, _ = coverage(NOISY, 12)
    assert share == pytest.approx([0.68, 0.95], abs=0.03)


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("what", "truth", "cycle_V", "least", "most"),
    [
        ("noise", NOISY, 0.0, (0.665, 0.94), (0.71, 0.965)),
        # bands of half the range often end where it ends, and then hold more
        ("much noise", replace(NOISY, noise_V=0.1), 0.0, (0.65, 0.935), (0.76, 0.98)),
        ("noise and cycles", replace(NOISY, noise_V=0.01), 0.01, (0.64, 0.925), (0.76, 0.98)),
        ("cycles", replace(NOISY, noise_V=0.003), 0.01, (0.62, 0.90), (0.80, 0.99)),
        ("hysteresis", replace(NOISY, hysteresis_V=0.04), 0.0, (0.665, 0.94), (0.90, 0.99)),
    ],
)
def test_bands_hold_what_they_say_at_length(
    what: str, truth: Truth, cycle_V: float, least: tuple[float, float], most: tuple[float, float]
) -> None:
    """Laws of noise, of cycles that differ, and both; four cycles are few to know how cycles differ."""
    share, error = coverage(truth, 100, cycle_V)
    print(f"{what}: {share.round(3)} ± {error.round(3)}")
    assert (share >= least).all()
    assert (share <= most).all()


def test_another_print_costs_what_prints_differ() -> None:
    prints = [
        trained(replace(NOISY, offset_V=2.0 + 0.1 * shift, swing_V=1.0 + 0.05 * shift), seed=n, label=f"S{n}")
        for n, shift in enumerate((-1.0, 0.0, 1.0, 0.5))
    ]
    ones = [calibrated(one) for one in prints]
    own, other = leave_one_cycle_out(prints[0]), leave_one_sensor_out(prints, ones)
    assert own is not None
    assert other is not None
    assert [part.name for part in other.parts] == ["S0", "S1", "S2", "S3"]
    assert other.total.rms_deg > 1.5 * own.total.rms_deg
    assert other.total.within_95 > 0.9  # and the band knows it
    together = pooled(ones)
    assert together.prints == 4
    assert together.cycles == 20
    assert np.sqrt(together.between[:, 0, 0]).mean() == pytest.approx(0.085 * np.sqrt(1.25), rel=0.3)
    assert leave_one_sensor_out(prints[:2], ones[:2]) is None


def test_what_cannot_be_calibrated_is_refused_in_one_line() -> None:
    few = replace(SHORT, cycles=2)
    with pytest.raises(DataError, match=r"has 1 usable cycle.*at least 2"):
        trained(replace(NOISY, protocol=few))
    signals = made(NOISY)
    alone = Signals("S1", ("left", "top"), signals.time_s, signals.angle_deg, signals.volts)
    with pytest.raises(DataError, match="no pair of a left and a right receiver: left, top"):
        training_of(sensor_response([alone], AnalysisOptions()))
    with pytest.raises(DataError, match="at least two prints"):
        pooled([calibrated(trained(NOISY))])
    assert leave_one_cycle_out(trained(replace(NOISY, protocol=replace(SHORT, cycles=3)))) is None


def test_clipped_cycles_give_rails_and_decode_on() -> None:
    truth = replace(NOISY, rails_V=(1.3, 5.0))
    training = trained(truth)
    assert training.rails_V[:, 0] == pytest.approx([1.3, 1.3], abs=1e-9)
    assert np.isnan(training.rails_V[:, 1]).all()
    true = np.array([2.0, -2.0])
    volts = np.clip(truth.response_V(true), 1.3, 5.0)
    marks = np.where(volts <= training.rails_V[:, 0], -1, 0).astype(np.int8)
    assert marks.tolist() == [[-1, 0], [0, -1]]
    assert Decoder(calibrated(training)).decode(volts, marks).angle_deg == pytest.approx(true, abs=0.2)


def test_a_stream_that_rises_is_reported_whole_or_in_pieces() -> None:
    time = np.arange(0.0, 1.0, 0.005)
    angle = np.where(time < 0.5, 15.0 * time, 7.5 - 15.0 * (time - 0.5))
    noise = np.full(time.size, 0.02)
    shown = angle + 0.02 * np.random.default_rng(1).standard_normal(time.size)
    whole = Tracker().of(time, shown, noise)
    words = whole.words()
    assert words[0] == ""
    assert set(words[10:99]) == {"rising"}
    assert set(words[112:]) == {"falling"}
    assert whole.slope_deg_per_s[50] == pytest.approx(15.0, abs=4 * 0.02 / np.sqrt(11 * 0.05**2 / 12))
    pieces, tracker = [], Tracker()
    for begin in range(0, time.size, 7):
        part = slice(begin, begin + 7)
        pieces.append(tracker.of(time[part], shown[part], noise[part]).rises)
    assert np.concatenate(pieces) == pytest.approx(whole.rises, abs=1e-9)
    still = Tracker().of(time, 0.02 * np.random.default_rng(2).standard_normal(time.size), noise)
    assert np.mean([word == "" for word in still.words()]) > 0.88


@pytest.mark.parametrize("sensor", ["U_L/V,U_R/V", "../../a", "con", "a."])
def test_a_sensor_whose_name_is_no_file_s_is_refused_in_a_line(sensor: str) -> None:
    with pytest.raises(DataError, match=r"^sensor = .*; name the file with the option --out$"):
        default_path([Path("run.csv"), Path("again.csv")], sensor)
