"""Calibration and decoding: closed forms, a direct computation, simulated recordings, and the coverage of the bands."""

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
from tests.analysis.calibration_support import SHORT, training
from tests.analysis.simulated_support import Truth, simulated

NOISY = Truth(noise_V=0.02, protocol=SHORT)


def exact_calibration(left: FloatArray, right: FloatArray, sd_V: float) -> Calibration:
    """Return a calibration with given curves at `ANGLE` and given noise, both without uncertainty."""
    curve = np.column_stack([left, right])
    noise = np.tile(sd_V**2 * np.eye(2), (ANGLE.size, 1, 1))
    zero = np.zeros_like(noise)
    freedom = np.full(ANGLE.size, 1e9)
    rails = np.full((2, 2), np.nan)
    return Calibration(ANGLE, np.array([curve, curve]), noise, zero, zero, freedom, 10**6, 1, (10**6, 0), rails)


ANGLE = np.linspace(-3.0, 3.0, 61)


def test_straight_curves_give_a_normal_distribution() -> None:
    # V = ±a θ with noise s in both: θ is normal about (V_right − V_left)/2a with standard deviation s/(a √2)
    decoder = Decoder(exact_calibration(-0.5 * ANGLE, 0.5 * ANGLE, 0.01))
    volts = np.array([[-0.41, 0.43], [0.6, -0.62]])
    decoded = decoder.decode(volts)
    mean, sd = (volts[:, 1] - volts[:, 0]) / 1.0, 0.01 / (0.5 * np.sqrt(2.0))
    assert decoded.angle_deg == pytest.approx(mean, abs=1e-5)
    for level, probability in enumerate((0.68, 0.95)):
        half = norm.ppf(0.5 + probability / 2.0) * sd
        assert decoded.high_deg[:, level] - mean == pytest.approx(half, rel=0.02)
        assert mean - decoded.low_deg[:, level] == pytest.approx(half, rel=0.02)
    assert decoded.distance == pytest.approx((volts.sum(axis=1) ** 2) / (2.0 * 0.01**2), rel=1e-6)
    assert not decoded.outside.any()
    assert not decoded.ambiguous.any()
    assert decoded.right == pytest.approx([0.0, 1.0], abs=1e-9)
    assert decoder.noise_deg(np.array([0.3])) == pytest.approx(sd, rel=1e-6)


@pytest.mark.parametrize(
    ("truth", "shape"),
    [(NOISY, ""), (replace(NOISY, noise_V=0.2, hysteresis_V=0.1), ""), (replace(NOISY, noise_V=0.05), "fold")],
)
def test_decoder_agrees_with_the_posterior_on_a_fine_grid(truth: Truth, shape: str) -> None:
    data = training(truth, shape=shape)
    calibration = calibrated(data)
    fine = np.linspace(calibration.angle_deg[0], calibration.angle_deg[-1], 1501)
    width = fine[1] - fine[0]
    decoder = Decoder(calibration)
    for volts in data.samples.volts[7::400]:
        decoded = decoder.decode(volts[None])
        probability = posterior(calibration, volts, fine)
        inside = sum(
            probability[(fine >= low) & (fine <= high)].sum()
            for low, high in [(decoded.low_deg[0, 1], decoded.high_deg[0, 1]), *decoded.other_deg.tolist()]
        )
        # only the decoder assumes a constant covariance within a segment; each of two separate bands contains 95 %
        assert 0.93 < inside < 0.985
        assert probability[fine < 0.0].sum() == pytest.approx(decoded.right[0], abs=0.03)
        if not decoded.other.size:
            median = fine[np.searchsorted(np.cumsum(probability), 0.5)]
            assert median == pytest.approx(decoded.angle_deg[0], abs=2 * width + 0.01)


def test_reports_both_angles_that_match_a_reading() -> None:
    # the right voltage has a maximum at 1.5°, and the left voltage is constant above 0.5°
    decoder = Decoder(exact_calibration(np.clip(ANGLE, -3.0, 0.5), -np.abs(ANGLE - 1.5), 0.01))
    both, single = decoder.decode(np.array([[0.5, -0.4]])), decoder.decode(np.array([[-1.0, -2.5]]))
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


def test_band_covers_the_range_in_which_both_receivers_are_saturated() -> None:
    saturated = np.clip(ANGLE, -1.0, 1.0)
    decoded = Decoder(exact_calibration(-saturated, saturated, 0.01)).decode(np.array([[-1.0, 1.0]]))
    assert decoded.low_deg[0, 1] < 1.15
    assert decoded.high_deg[0, 1] == 3.0
    assert decoded.at_end.all()


def test_flags_readings_outside_the_curve() -> None:
    decoder = Decoder(exact_calibration(-0.5 * ANGLE, 0.5 * ANGLE, 0.01))
    decoded = decoder.decode(np.array([[0.0, 0.0], [0.1, 0.1], [-2.0, 2.0]]))  # on the curve, beside it, past its end
    assert decoded.outside.tolist() == [False, True, True]
    # at most one reading in a thousand is flagged by chance; the best angle removes one degree of freedom
    rng = np.random.default_rng(3)
    angle = rng.uniform(-2.5, 2.5, 20_000)
    decoded = decoder.decode(np.column_stack([-0.5 * angle, 0.5 * angle]) + 0.01 * rng.standard_normal((angle.size, 2)))
    assert decoded.outside.mean() < 1e-3
    assert decoded.holds(angle, 0).mean() == pytest.approx(0.68, abs=0.012)  # 3.6 standard deviations
    assert decoded.holds(angle, 1).mean() == pytest.approx(0.95, abs=0.006)


def test_clipped_receiver_only_bounds_the_angle() -> None:
    decoder = Decoder(exact_calibration(-0.5 * ANGLE, np.clip(0.5 * ANGLE, -2.0, 0.5), 0.01))
    marks = np.array([[0, 1], [0, 0]], dtype=np.int8)
    decoded = decoder.decode(np.array([[-1.0, 0.5], [-1.0, 0.5]]), marks)
    assert decoded.clipped.tolist() == [True, False]
    assert decoded.angle_deg[0] == pytest.approx(2.0, abs=1e-3)  # from the left receiver alone
    assert decoded.high_deg[0, 1] - decoded.low_deg[0, 1] == pytest.approx(2 * 1.96 * 0.02, rel=0.03)
    left_clipped = decoder.decode(np.array([[-1.5, 0.2]]), np.array([[-1, 0]], dtype=np.int8))
    assert left_clipped.outside.all() or left_clipped.low_deg[0, 1] < left_clipped.angle_deg[0]
    both_clipped = decoder.decode(np.array([[1.5, 0.5]]), np.array([[1, 1]], dtype=np.int8))
    assert np.isfinite(both_clipped.angle_deg).all()


def test_uncertain_gain_widens_the_band_of_affected_angles() -> None:
    calibration = exact_calibration(2.0 - 0.3 * ANGLE, 2.0 + 0.3 * ANGLE, 0.005)
    volts = np.array([[2.0, 2.0], [1.4, 2.6]]) * 1.03  # an emitter that is 3 % brighter
    plain, allowed = Decoder(calibration).decode(volts), Decoder(calibration, gain_percent=5.0).decode(volts)
    assert plain.outside.all()
    assert not allowed.outside.any()
    assert allowed.angle_deg == pytest.approx([0.0, 2.0], abs=0.02)
    assert (allowed.high_deg - allowed.low_deg)[1, 1] > (allowed.high_deg - allowed.low_deg)[0, 1]


def test_decodes_readings_in_blocks_with_the_same_result() -> None:
    data = training(NOISY)
    decoder = Decoder(calibrated(data))
    volts = data.samples.volts[:1100]  # more than one block
    marks = np.zeros(volts.shape, dtype=np.int8)
    marks[5::50, 0] = -1
    decoded = decoder.decode(volts, marks)
    for row in (0, 5, 511, 512, 1055, 1099):
        single = decoder.decode(volts[row : row + 1], marks[row : row + 1])
        assert single.angle_deg[0] == pytest.approx(decoded.angle_deg[row], abs=1e-9)
        assert single.high_deg[0] == pytest.approx(decoded.high_deg[row], abs=1e-9)
        assert bool(single.clipped[0]) == bool(marks[row].any())
    assert decoder.decode(volts[:0]).angle_deg.size == 0


def test_calibration_recovers_true_curves_and_covariances() -> None:
    truth = replace(NOISY, noise_V=0.01, hysteresis_V=0.04, protocol=replace(SHORT, cycles=30))
    calibration = calibrated(training(truth, cycle_V=0.03))
    inner = np.abs(calibration.angle_deg) < 2.5
    response = truth.response_V(calibration.angle_deg)
    assert calibration.curves_V.mean(axis=0)[inner] == pytest.approx(response[inner], abs=4 * 0.03 / np.sqrt(29))
    assert (calibration.curves_V[0] - calibration.curves_V[1])[inner].mean() == pytest.approx(0.04, abs=0.002)
    assert np.sqrt(calibration.noise[inner, 0, 0]).mean() == pytest.approx(0.01, rel=0.1)
    # the relative standard error of a standard deviation from 29 cycles is 13 %
    assert np.sqrt(calibration.repeat[inner, 1, 1]).mean() == pytest.approx(0.03 * np.sqrt(1 + 1 / 29), rel=0.4)
    assert not calibration.between.any()


def coverage(truth: Truth, recordings: int, cycle_V: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Return the fraction of readings of held-out cycles within the bands, and its standard error."""
    fractions = []
    for seed in range(recordings):
        check = leave_one_cycle_out(training(truth, seed=seed, cycle_V=cycle_V))
        assert check is not None
        moving = np.abs(check.true_deg) < 2.9  # bands of holds at an end of the range always contain the angle
        low, high = check.low_deg[moving], check.high_deg[moving]
        true = check.true_deg[moving, None]
        fractions.append(((low <= true) & (true <= high)).mean(axis=0))
    return np.mean(fractions, axis=0), np.std(fractions, axis=0) / np.sqrt(recordings)


def test_bands_have_their_coverage() -> None:
    # 12 recordings of 5 cycles with about 1000 readings each: ± 3 % at 68 %, ± 2 % at 95 %
    fraction, _ = coverage(NOISY, 12)
    assert fraction == pytest.approx([0.68, 0.95], abs=0.03)


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("name", "truth", "cycle_V", "lowest", "highest"),
    [
        ("noise", NOISY, 0.0, (0.665, 0.94), (0.71, 0.965)),
        # wide bands often reach an end of the range, and then contain more
        ("large noise", replace(NOISY, noise_V=0.1), 0.0, (0.65, 0.935), (0.76, 0.98)),
        ("noise and cycles", replace(NOISY, noise_V=0.01), 0.01, (0.64, 0.925), (0.76, 0.98)),
        ("cycles", replace(NOISY, noise_V=0.003), 0.01, (0.62, 0.90), (0.80, 0.99)),
        ("hysteresis", replace(NOISY, hysteresis_V=0.04), 0.0, (0.665, 0.94), (0.90, 0.99)),
    ],
)
def test_bands_have_their_coverage_over_many_recordings(
    name: str, truth: Truth, cycle_V: float, lowest: tuple[float, float], highest: tuple[float, float]
) -> None:
    """Four cycles give only a rough estimate of the scatter between cycles."""
    fraction, error = coverage(truth, 100, cycle_V)
    print(f"{name}: {fraction.round(3)} ± {error.round(3)}")
    assert (fraction >= lowest).all()
    assert (fraction <= highest).all()


def test_pooled_calibration_includes_the_scatter_of_prints() -> None:
    prints = [
        training(replace(NOISY, offset_V=2.0 + 0.1 * shift, swing_V=1.0 + 0.05 * shift), seed=n, label=f"S{n}")
        for n, shift in enumerate((-1.0, 0.0, 1.0, 0.5))
    ]
    calibrations = [calibrated(data) for data in prints]
    cycles, sensors = leave_one_cycle_out(prints[0]), leave_one_sensor_out(prints, calibrations)
    assert cycles is not None
    assert sensors is not None
    assert [part.name for part in sensors.parts] == ["S0", "S1", "S2", "S3"]
    assert sensors.total.rms_deg > 1.5 * cycles.total.rms_deg
    assert sensors.total.within_95 > 0.9
    pool = pooled(calibrations)
    assert pool.prints == 4
    assert pool.cycles == 20
    assert np.sqrt(pool.between[:, 0, 0]).mean() == pytest.approx(0.085 * np.sqrt(1.25), rel=0.3)
    assert leave_one_sensor_out(prints[:2], calibrations[:2]) is None


def test_refuses_too_few_cycles_receivers_and_prints() -> None:
    with pytest.raises(DataError, match=r"has 1 usable cycle.*at least 2"):
        training(replace(NOISY, protocol=replace(SHORT, cycles=2)))
    signals = simulated(NOISY)
    without_right = Signals("S1", ("left", "top"), signals.time_s, signals.angle_deg, signals.volts)
    with pytest.raises(DataError, match="no pair of a left and a right receiver: left, top"):
        training_of(sensor_response([without_right], AnalysisOptions()))
    with pytest.raises(DataError, match="at least two prints"):
        pooled([calibrated(training(NOISY))])
    assert leave_one_cycle_out(training(replace(NOISY, protocol=replace(SHORT, cycles=3)))) is None


def test_determines_rails_and_decodes_clipped_readings() -> None:
    truth = replace(NOISY, rails_V=(1.3, 5.0))
    data = training(truth)
    assert data.rails_V[:, 0] == pytest.approx([1.3, 1.3], abs=1e-9)
    assert np.isnan(data.rails_V[:, 1]).all()
    true = np.array([2.0, -2.0])
    volts = np.clip(truth.response_V(true), 1.3, 5.0)
    marks = np.where(volts <= data.rails_V[:, 0], -1, 0).astype(np.int8)
    assert marks.tolist() == [[-1, 0], [0, -1]]
    assert Decoder(calibrated(data)).decode(volts, marks).angle_deg == pytest.approx(true, abs=0.2)


def test_headings_are_independent_of_the_pieces_of_a_stream() -> None:
    time = np.arange(0.0, 1.0, 0.005)
    angle = np.where(time < 0.5, 15.0 * time, 7.5 - 15.0 * (time - 0.5))
    noise = np.full(time.size, 0.02)
    measured = angle + 0.02 * np.random.default_rng(1).standard_normal(time.size)
    headings = Tracker().of(time, measured, noise)
    labels = headings.labels()
    assert labels[0] == ""
    assert set(labels[10:99]) == {"rising"}
    assert set(labels[112:]) == {"falling"}
    assert headings.slope_deg_per_s[50] == pytest.approx(15.0, abs=4 * 0.02 / np.sqrt(11 * 0.05**2 / 12))
    rises, tracker = [], Tracker()
    for start in range(0, time.size, 7):
        piece = slice(start, start + 7)
        rises.append(tracker.of(time[piece], measured[piece], noise[piece]).rises)
    assert np.concatenate(rises) == pytest.approx(headings.rises, abs=1e-9)
    stationary = Tracker().of(time, 0.02 * np.random.default_rng(2).standard_normal(time.size), noise)
    assert np.mean([label == "" for label in stationary.labels()]) > 0.88


@pytest.mark.parametrize("sensor", ["U_L/V,U_R/V", "../../a", "con", "a."])
def test_refuses_a_sensor_name_that_is_no_file_name(sensor: str) -> None:
    with pytest.raises(DataError, match=r"^sensor = .*; name the file with the option --out$"):
        default_path([Path("run.csv"), Path("again.csv")], sensor)
