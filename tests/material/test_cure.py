"""Working curve: exact points, coverage under several scatter laws, outliers and thin discs, warnings and refusals."""

import math

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.cure.cautions import cautions
from solen.material.cure.working_curve_fit import Scatter, WorkingCurve, working_curve

DP, EC = 120.0, 8.0
DOSES = np.repeat(np.geomspace(12.0, 120.0, 8), 3)


def depth_of(dose: FloatArray) -> FloatArray:
    """Return the true cure depth."""
    return np.asarray(DP * np.log(dose / EC))


def scatter_um(name: str, depth: FloatArray) -> FloatArray:
    """Return the standard deviation of the thickness of discs."""
    if name == "5 % of thickness":
        return 0.05 * depth
    if name == "5 µm":
        return np.full(len(depth), 5.0)
    return 8.0 * np.sqrt(150.0 / np.maximum(depth, 20.0))  # thin discs are soft and scatter more


def covers(curve: WorkingCurve) -> tuple[bool, bool]:
    """Return whether the intervals cover the true Dp and Ec."""
    low, high = curve.interval95_Dp_um
    ends = curve.interval95_Ec_mJ_per_cm2
    return low <= DP <= high, ends is None or ends[0] <= EC <= ends[1]


def coverage(name: str, scatter: Scatter, draws: int, seed: int, dose: FloatArray = DOSES) -> FloatArray:
    """Return the fractions of draws whose 95 % intervals cover Dp and Ec."""
    rng, depth = np.random.default_rng(seed), depth_of(dose)
    sd = scatter_um(name, depth)
    thicknesses = [np.maximum(depth + sd * rng.normal(size=len(depth)), 1.0) for _ in range(draws)]
    curves = [working_curve(dose, thickness, scatter=scatter) for thickness in thicknesses]
    return np.asarray(np.mean([covers(curve) for curve in curves], axis=0))


def test_exact_points_yield_their_curve() -> None:
    curve = working_curve(DOSES, depth_of(DOSES))
    assert curve.Dp_um == pytest.approx(DP, rel=1e-12)
    assert curve.Ec_mJ_per_cm2 == pytest.approx(EC, rel=1e-12)
    assert curve.left_out == ()
    assert curve.interval95_Dp_um == pytest.approx((DP, DP), rel=1e-6)
    assert curve.depth_um([EC, 39.0]) == pytest.approx([0.0, DP * math.log(39.0 / EC)], abs=1e-9)
    assert curve.dose_mJ_per_cm2(200.0) == pytest.approx(EC * math.exp(200.0 / DP), rel=1e-12)


@pytest.mark.parametrize("name", ["5 % of thickness", "5 µm"])
def test_intervals_cover_the_truth(name: str) -> None:
    """Without knowing the scatter law; for 200 tables, 3.5 standard deviations of the coverage are 5.4 %."""
    covered = coverage(name, "auto", 200, 41)
    assert np.all(np.abs(covered - 0.95) < 3.5 * math.sqrt(0.95 * 0.05 / 200)), covered


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["5 % of thickness", "5 µm"])
@pytest.mark.parametrize("known", [True, False])
def test_intervals_cover_the_truth_in_95_of_100(name: str, known: bool) -> None:
    """2,000 tables of 24 discs each, the scatter law specified or estimated: 95 ± 2 %."""
    scatter: Scatter = "auto" if not known else "constant" if name == "5 µm" else "proportional"
    covered = coverage(name, scatter, 2000, 43)
    assert np.all(np.abs(covered - 0.95) <= 0.02), covered


@pytest.mark.evidence
def test_intervals_cover_the_truth_if_thin_discs_scatter_most() -> None:
    """A law other than those fitted: intervals from the residuals cover in 92 of 100, those of a wrong law do not."""
    assert np.all(np.abs(coverage("thin", "auto", 2000, 47) - 0.95) <= 0.04)
    assert np.all(coverage("thin", "proportional", 500, 47) < 0.85)


def test_intervals_of_a_wrong_scatter_law_are_too_narrow() -> None:
    """Discs that scatter by 5 µm, weighted as for 5 %: thin discs determine Ec, and its interval is far too narrow."""
    assert coverage("5 µm", "proportional", 100, 53)[1] < 0.85


def test_weights_do_not_depend_on_the_measured_thickness() -> None:
    """Weights from the measured thickness would bias Dp by −0.5 %; the mean of 400 tables is unbiased."""
    rng, depth = np.random.default_rng(59), depth_of(DOSES)
    curves = [
        working_curve(DOSES, depth * (1.0 + 0.05 * rng.normal(size=24)), scatter="proportional") for _ in range(400)
    ]
    dp = np.array([curve.Dp_um for curve in curves])
    assert dp.mean() == pytest.approx(DP, abs=3.5 * dp.std() / 20.0)


def test_the_scatter_law_is_estimated() -> None:
    rng = np.random.default_rng(61)
    dose = np.repeat(np.geomspace(10.0, 200.0, 12), 12)
    depth = depth_of(dose)
    for power, sd in ((1.0, 0.05 * depth), (0.0, np.full(144, 5.0))):
        curve = working_curve(dose, depth + sd * rng.normal(size=144))
        assert curve.scatter_exponent == power
        assert curve.sd_thickness_um == pytest.approx(np.mean(depth) * 0.05 if power else 5.0, rel=0.25)
        assert curve.disc_sigma_um(300.0) == pytest.approx(15.0 if power else 5.0, rel=0.25)


def test_covariances_agree_with_finite_differences() -> None:
    """With constant scatter, propagated numerically from the thickness of each disc."""
    rng = np.random.default_rng(67)
    thick = depth_of(DOSES) + 5.0 * rng.normal(size=24)

    def parameters(values: FloatArray) -> FloatArray:
        varied = working_curve(DOSES, values, scatter="constant", keep_all=True)
        return np.array([varied.Dp_um, varied.ln_Ec])

    curve = working_curve(DOSES, thick, scatter="constant", keep_all=True)
    assert not curve.by_dose
    slopes = np.array([(parameters(thick + 1e-4 * np.eye(24)[k]) - parameters(thick)) / 1e-4 for k in range(24)])
    expected = curve.fit.sigma**2 * slopes.T @ slopes
    assert curve.covariance_ln == pytest.approx(expected, rel=1e-4)
    scale = np.array([1.0, curve.Ec_mJ_per_cm2])
    assert curve.covariance == pytest.approx(expected * np.outer(scale, scale), rel=1e-4)
    assert curve.u_ln_Ec == pytest.approx(math.sqrt(expected[1, 1]), rel=1e-4)
    assert curve.u_Dp_um == pytest.approx(math.sqrt(expected[0, 0]), rel=1e-4)


def test_the_interval_of_a_dose_ends_where_the_band_of_the_curve_reaches_the_depth() -> None:
    """Fieller's limits; with constant scatter, the degrees of freedom are the same everywhere."""
    rng = np.random.default_rng(71)
    curve = working_curve(DOSES, depth_of(DOSES) + 5.0 * rng.normal(size=24), scatter="constant")
    for depth in (0.0, 100.0):
        ends = curve.dose_interval95(depth)
        assert ends is not None
        for end, side in zip(ends, (1.0, -1.0), strict=True):
            edge = curve.depth_um(end) + side * curve.half_width_um(end)
            assert float(edge) == pytest.approx(depth, abs=1e-6)


def test_a_slope_compatible_with_zero_yields_no_interval_of_dose() -> None:
    curve = working_curve([10.0, 10.0, 12.0, 12.0], [50.0, 60.0, 55.0, 66.0])
    assert curve.interval95_Ec_mJ_per_cm2 is None
    assert curve.interval95_Dp_um[0] < 0.0
    assert any("too uncertain" in line for line in cautions(curve))


def test_the_band_of_discs_covers_a_further_disc() -> None:
    rng, draws = np.random.default_rng(73), 400
    depth, dose = depth_of(DOSES), 39.0
    truth = float(depth_of(np.array([dose]))[0])
    covered = 0
    for _ in range(draws):
        curve = working_curve(DOSES, depth + 5.0 * rng.normal(size=24), scatter="constant")
        half = float(curve.half_width_um(dose, of_one_disc=True))
        covered += abs(truth + 5.0 * rng.normal() - float(curve.depth_um(dose))) <= half
    assert abs(covered / draws - 0.95) < 3.5 * math.sqrt(0.95 * 0.05 / draws)


def test_outliers_are_listed_and_do_not_affect_the_curve() -> None:
    rng = np.random.default_rng(79)
    thick = depth_of(DOSES) * (1.0 + 0.05 * rng.normal(size=24))
    thick[10] *= 0.4  # torn
    thick[20] *= 10.0  # a misplaced decimal point
    curve = working_curve(DOSES, thick)
    assert {omitted.disc.row for omitted in curve.left_out} == {11, 21}
    assert all(omitted.t is not None and abs(omitted.t) > 4.0 for omitted in curve.left_out)
    assert all(covers(curve))
    assert "row 11" in cautions(curve)[0]
    assert abs(working_curve(DOSES, thick, keep_all=True).Dp_um - DP) > 30.0


def test_all_discs_of_a_thin_dose_are_omitted() -> None:
    """Omitting single discs by their measured thickness would keep the thickest discs of a dose, a bias."""
    thick = depth_of(DOSES)
    thick[0] += 30.0
    curve = working_curve(DOSES, thick, min_thickness_um=60.0)
    assert [omitted.disc.row for omitted in curve.left_out] == [1, 2, 3]
    assert "below 60 µm" in curve.left_out[0].reason
    assert curve.Dp_um == pytest.approx(DP)


def test_discs_that_did_not_cure_or_were_not_measured_are_omitted_and_reported() -> None:
    dose = np.concatenate([DOSES, [4.0, 30.0, 50.0]])
    thick = np.concatenate([depth_of(DOSES), [0.0, 0.0, math.nan]])
    curve = working_curve(dose, thick)
    assert [(omitted.disc.row, omitted.reason) for omitted in curve.left_out] == [
        (25, "nothing cured"),
        (26, "nothing cured"),
        (27, "no thickness"),
    ]
    assert any("30 mJ/cm²" in line and "159 µm" in line for line in cautions(curve))


def test_with_lack_of_fit_each_dose_is_one_point() -> None:
    """Means of doses scatter by 10 µm, discs about them by 1 µm; the direction of a curvature is reported."""
    rng = np.random.default_rng(83)
    offsets = np.repeat(rng.normal(0.0, 10.0, 8), 3)
    curve = working_curve(DOSES, depth_of(DOSES) + offsets + rng.normal(0.0, 1.0, 24))
    assert curve.by_dose
    assert curve.lack_of_fit is not None
    assert curve.lack_of_fit.p < 1e-6
    assert curve.fit.error_df == 6
    assert any("no clear curvature" in line for line in cautions(curve))
    assert curve.left_out == ()  # a dose that deviates as a whole contains no outlier
    oxygen = working_curve(DOSES, np.sqrt(depth_of(DOSES)) * 15.0 + rng.normal(0.0, 1.0, 24))
    assert any("curve downwards" in line for line in cautions(oxygen))
    spectral = working_curve(DOSES, depth_of(DOSES) ** 2 / 300.0 + rng.normal(0.0, 1.0, 24))
    assert any("curve upwards" in line for line in cautions(spectral))


def test_the_false_alarm_rate_of_the_lack_of_fit_test_is_nominal() -> None:
    rng, draws = np.random.default_rng(89), 400
    alarms = np.mean(
        [
            working_curve(DOSES, depth_of(DOSES) + 5.0 * rng.normal(size=24), scatter="constant").by_dose
            for _ in range(draws)
        ]
    )
    assert abs(alarms - 0.05) < 3.5 * math.sqrt(0.05 * 0.95 / draws)


@pytest.mark.parametrize(
    ("dose", "thick", "line"),
    [
        ([10.0, 20.0, 0.0], [1.0, 2.0, 3.0], r"dose = '0 \(row 3\)'; must be from 1e-06"),
        ([10.0, 20.0, 30.0], [1.0, -2.0, 3.0], r"thickness = '-2 \(row 2\)'; must be from 0 to 1e"),
        ([10.0, 10.0, 10.0], [1.0, 2.0, 3.0], r"3 discs at 2 doses \(discs: 3, doses: 1\)"),
        ([10.0, 20.0, 30.0], [0.0, 20.0, 30.0], r"\(discs: 2, doses: 2; 1 discs omitted\)"),
        ([10.0, 20.0, 30.0, 40.0], [40.0, 30.0, 20.0, 10.0], "thickness must increase with the dose"),
    ],
)
def test_refuses_discs_that_determine_no_curve(dose: list[float], thick: list[float], line: str) -> None:
    with pytest.raises(DataError, match=line):
        working_curve(dose, thick)


@pytest.mark.parametrize(
    ("dose", "thick", "line"),
    [
        ([10.0, 10.0, 40.0, 40.0], [27.0, 26.0, 193.0, 194.0], "two doses"),
        ([10.0, 20.0, 40.0, 80.0], [27.0, 109.0, 194.0, 276.0], "no dose was repeated"),
        ([10.0, 20.0, 40.0], [27.0, 110.0, 193.0], "the fit has 1 degrees of freedom"),
        ([80.0, 80.0, 90.0, 90.0, 120.0, 120.0], [276.0, 277.0, 290.0, 291.0, 325.0, 324.0], "extrapolat"),
        ([12.0, 12.0, 20.0, 20.0, 40.0, 40.0, 80.0], [7.0, 9.0, 39.0, 41.0, 123.0, 125.0, 254.0], "12 mJ"),
    ],
)
def test_warns_of_poorly_determined_results(dose: list[float], thick: list[float], line: str) -> None:
    warnings = cautions(working_curve(dose, thick))
    assert any(line in warning for warning in warnings), warnings
