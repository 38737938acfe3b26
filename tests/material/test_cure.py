"""The working curve: exact points, coverage under several laws of scatter, bad and thin discs, what it is asked for."""

import math

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.cure.cautions import cautions
from solen.material.cure.curve import Scatter, WorkingCurve, working_curve

DP, EC = 120.0, 8.0
DOSES = np.repeat(np.geomspace(12.0, 120.0, 8), 3)


def line(dose: FloatArray) -> FloatArray:
    return np.asarray(DP * np.log(dose / EC))


def law(name: str, depth: FloatArray) -> FloatArray:
    """Standard deviation of discs of a thickness in µm."""
    if name == "5 % of thickness":
        return 0.05 * depth
    if name == "5 µm":
        return np.full(len(depth), 5.0)
    return 8.0 * np.sqrt(150.0 / np.maximum(depth, 20.0))  # thin and soft: the worse the thinner


def holds(found: WorkingCurve) -> tuple[bool, bool]:
    low, high = found.interval95_Dp_um
    ends = found.interval95_Ec_mJ_per_cm2
    return low <= DP <= high, ends is None or ends[0] <= EC <= ends[1]


def coverage(name: str, scatter: Scatter, draws: int, seed: int, dose: FloatArray = DOSES) -> FloatArray:
    """Share of draws whose 95 % intervals hold Dp, and Ec."""
    rng, depth = np.random.default_rng(seed), line(dose)
    sd = law(name, depth)
    thick = [np.maximum(depth + sd * rng.normal(size=len(depth)), 1.0) for _ in range(draws)]
    found = [working_curve(dose, one, scatter=scatter) for one in thick]
    return np.asarray(np.mean([holds(one) for one in found], axis=0))


def test_exact_points_give_their_curve() -> None:
    found = working_curve(DOSES, line(DOSES))
    assert found.Dp_um == pytest.approx(DP, rel=1e-12)
    assert found.Ec_mJ_per_cm2 == pytest.approx(EC, rel=1e-12)
    assert found.left_out == ()
    assert found.interval95_Dp_um == pytest.approx((DP, DP), rel=1e-6)
    assert found.depth_um([EC, 39.0]) == pytest.approx([0.0, DP * math.log(39.0 / EC)], abs=1e-9)
    assert found.dose_mJ_per_cm2(200.0) == pytest.approx(EC * math.exp(200.0 / DP), rel=1e-12)


@pytest.mark.parametrize("name", ["5 % of thickness", "5 µm"])
def test_intervals_hold_the_truth(name: str) -> None:
    """Without knowing the law of scatter; 400 tables, so 3.5 standard deviations of the count are 3.8 %."""
    share = coverage(name, "auto", 400, 41)
    assert np.all(np.abs(share - 0.95) < 3.5 * math.sqrt(0.95 * 0.05 / 400)), share


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["5 % of thickness", "5 µm"])
@pytest.mark.parametrize("known", [True, False])
def test_intervals_hold_the_truth_in_95_of_100(name: str, known: bool) -> None:
    """2,000 tables of 24 discs each, the law of scatter stated or found: 95 ± 2 %."""
    scatter: Scatter = "auto" if not known else "constant" if name == "5 µm" else "proportional"
    share = coverage(name, scatter, 2000, 43)
    assert np.all(np.abs(share - 0.95) <= 0.02), share


@pytest.mark.evidence
def test_intervals_hold_where_thin_discs_are_the_worst() -> None:
    """A law that is none of those tried: intervals from the residuals hold in 92 of 100, those of a wrong law not."""
    assert np.all(np.abs(coverage("thin", "auto", 2000, 47) - 0.95) <= 0.04)
    assert np.all(coverage("thin", "proportional", 500, 47) < 0.85)


def test_a_law_that_is_wrong_does_not_hold() -> None:
    """Discs that scatter by 5 µm, weighted as if by 5 %: thin discs decide Ec, and its interval is far too narrow."""
    assert coverage("5 µm", "proportional", 100, 53)[1] < 0.85


def test_weights_do_not_favour_discs_that_came_out_thin() -> None:
    """Weights by measured thickness would make Dp 0.5 % too small and Ec too large; the mean of 400 tables is not."""
    rng, depth = np.random.default_rng(59), line(DOSES)
    found = [
        working_curve(DOSES, depth * (1.0 + 0.05 * rng.normal(size=24)), scatter="proportional") for _ in range(400)
    ]
    dp = np.array([one.Dp_um for one in found])
    assert dp.mean() == pytest.approx(DP, abs=3.5 * dp.std() / 20.0)


def test_scatter_is_found() -> None:
    rng = np.random.default_rng(61)
    dose = np.repeat(np.geomspace(10.0, 200.0, 12), 12)
    depth = line(dose)
    for power, sd in ((1.0, 0.05 * depth), (0.0, np.full(144, 5.0))):
        found = working_curve(dose, depth + sd * rng.normal(size=144))
        assert found.scatter_exponent == power
        assert found.sd_thickness_um == pytest.approx(np.mean(depth) * 0.05 if power else 5.0, rel=0.25)
        assert found.disc_sigma_um(300.0) == pytest.approx(15.0 if power else 5.0, rel=0.25)


def test_covariances_are_those_of_a_change_of_the_points() -> None:
    """With scatter stated as constant: propagated by finite differences from each disc's thickness."""
    rng = np.random.default_rng(67)
    thick = line(DOSES) + 5.0 * rng.normal(size=24)

    def both(values: FloatArray) -> FloatArray:
        found = working_curve(DOSES, values, scatter="constant", keep_all=True)
        return np.array([found.Dp_um, found.ln_Ec])

    found = working_curve(DOSES, thick, scatter="constant", keep_all=True)
    assert not found.by_dose
    slopes = np.array([(both(thick + 1e-4 * np.eye(24)[k]) - both(thick)) / 1e-4 for k in range(24)])
    expected = found.fit.sigma**2 * slopes.T @ slopes
    assert found.covariance_ln == pytest.approx(expected, rel=1e-4)
    scale = np.array([1.0, found.Ec_mJ_per_cm2])
    assert found.covariance == pytest.approx(expected * np.outer(scale, scale), rel=1e-4)
    assert found.u_ln_Ec == pytest.approx(math.sqrt(expected[1, 1]), rel=1e-4)
    assert found.u_Dp_um == pytest.approx(math.sqrt(expected[0, 0]), rel=1e-4)


def test_an_interval_of_dose_is_all_doses_at_which_the_curve_may_be_that_deep() -> None:
    """Fieller's ends are where the band of the curve meets the depth (constant scatter: one freedom everywhere)."""
    rng = np.random.default_rng(71)
    found = working_curve(DOSES, line(DOSES) + 5.0 * rng.normal(size=24), scatter="constant")
    for depth in (0.0, 100.0):
        ends = found.dose_interval95(depth)
        assert ends is not None
        for end, side in zip(ends, (1.0, -1.0), strict=True):
            edge = found.depth_um(end) + side * found.half_width_um(end)
            assert float(edge) == pytest.approx(depth, abs=1e-6)


def test_a_slope_that_may_be_nothing_leaves_no_interval_of_dose() -> None:
    found = working_curve([10.0, 10.0, 12.0, 12.0], [50.0, 60.0, 55.0, 66.0])
    assert found.interval95_Ec_mJ_per_cm2 is None
    assert found.interval95_Dp_um[0] < 0.0
    assert any("too uncertain" in told for told in cautions(found))


def test_the_band_of_discs_holds_one_more_disc() -> None:
    rng, draws = np.random.default_rng(73), 400
    depth, at = line(DOSES), 39.0
    truth = float(line(np.array([at]))[0])
    kept = 0
    for _ in range(draws):
        found = working_curve(DOSES, depth + 5.0 * rng.normal(size=24), scatter="constant")
        half = float(found.half_width_um(at, of_one_disc=True))
        kept += abs(truth + 5.0 * rng.normal() - float(found.depth_um(at))) <= half
    assert abs(kept / draws - 0.95) < 3.5 * math.sqrt(0.95 * 0.05 / draws)


def test_bad_discs_are_listed_and_do_not_move_the_curve() -> None:
    rng = np.random.default_rng(79)
    thick = line(DOSES) * (1.0 + 0.05 * rng.normal(size=24))
    thick[10] *= 0.4  # torn
    thick[20] *= 10.0  # a slip of the comma
    found = working_curve(DOSES, thick)
    assert {one.disc.row for one in found.left_out} == {11, 21}
    assert all(one.t is not None and abs(one.t) > 4.0 for one in found.left_out)
    assert all(holds(found))
    assert "row 11" in cautions(found)[0]
    assert abs(working_curve(DOSES, thick, keep_all=True).Dp_um - DP) > 30.0


def test_thin_doses_are_left_out_whole() -> None:
    """A disc is not judged by its own thickness: that would keep those of a thin dose that came out thick."""
    thick = line(DOSES)
    thick[0] += 30.0
    found = working_curve(DOSES, thick, min_thickness_um=60.0)
    assert [one.disc.row for one in found.left_out] == [1, 2, 3]
    assert "below 60 µm" in found.left_out[0].reason
    assert found.Dp_um == pytest.approx(DP)


def test_what_did_not_set_and_what_was_not_measured_is_left_out_and_said() -> None:
    dose = np.concatenate([DOSES, [4.0, 30.0, 50.0]])
    thick = np.concatenate([line(DOSES), [0.0, 0.0, math.nan]])
    found = working_curve(dose, thick)
    assert [(one.disc.row, one.reason) for one in found.left_out] == [
        (25, "nothing set"),
        (26, "nothing set"),
        (27, "no thickness"),
    ]
    assert any(
        "no disc set at 30 mJ/cm², although the line predicts a thickness of 159 µm" in told for told in cautions(found)
    )


def test_doses_that_are_off_together_count_once() -> None:
    """Means of doses scatter by 10 µm, discs about them by 1 µm: each dose is a point, and the bend is looked for."""
    rng = np.random.default_rng(83)
    off = np.repeat(rng.normal(0.0, 10.0, 8), 3)
    found = working_curve(DOSES, line(DOSES) + off + rng.normal(0.0, 1.0, 24))
    assert found.by_dose
    assert found.lack_of_fit is not None
    assert found.lack_of_fit.p < 1e-6
    assert found.fit.error_df == 6
    assert any("no clear curvature" in told for told in cautions(found))
    assert found.left_out == ()  # a whole dose that is off is not a bad disc
    oxygen = working_curve(DOSES, np.sqrt(line(DOSES)) * 15.0 + rng.normal(0.0, 1.0, 24))
    assert any("curve downwards" in told for told in cautions(oxygen))
    colours = working_curve(DOSES, line(DOSES) ** 2 / 300.0 + rng.normal(0.0, 1.0, 24))
    assert any("curve upwards" in told for told in cautions(colours))


def test_the_test_of_fit_alarms_at_its_rate() -> None:
    rng, draws = np.random.default_rng(89), 400
    alarms = np.mean(
        [
            working_curve(DOSES, line(DOSES) + 5.0 * rng.normal(size=24), scatter="constant").by_dose
            for _ in range(draws)
        ]
    )
    assert abs(alarms - 0.05) < 3.5 * math.sqrt(0.05 * 0.95 / draws)


@pytest.mark.parametrize(
    ("dose", "thick", "told"),
    [
        ([10.0, 20.0, 0.0], [1.0, 2.0, 3.0], r"dose = '0 \(row 3\)'; must be from 1e-06"),
        ([10.0, 20.0, 30.0], [1.0, -2.0, 3.0], r"thickness = '-2 \(row 2\)'; must be 0 to 1e"),
        ([10.0, 10.0, 10.0], [1.0, 2.0, 3.0], "3 discs at 1 doses"),
        ([10.0, 20.0, 30.0], [0.0, 20.0, 30.0], r"2 discs at 2 doses \(1 omitted\)"),
        ([10.0, 20.0, 30.0, 40.0], [40.0, 30.0, 20.0, 10.0], "thickness must increase with the dose"),
    ],
)
def test_what_gives_no_curve_is_refused(dose: list[float], thick: list[float], told: str) -> None:
    with pytest.raises(DataError, match=told):
        working_curve(dose, thick)


@pytest.mark.parametrize(
    ("dose", "thick", "told"),
    [
        ([10.0, 10.0, 40.0, 40.0], [27.0, 26.0, 193.0, 194.0], "two doses"),
        ([10.0, 20.0, 40.0, 80.0], [27.0, 109.0, 194.0, 276.0], "no dose was repeated"),
        ([10.0, 20.0, 40.0], [27.0, 110.0, 193.0], "the fit has 1 degrees of freedom"),
        ([80.0, 80.0, 90.0, 90.0, 120.0, 120.0], [276.0, 277.0, 290.0, 291.0, 325.0, 324.0], "an extrapolation"),
        ([12.0, 12.0, 20.0, 20.0, 40.0, 40.0, 80.0], [7.0, 9.0, 39.0, 41.0, 123.0, 125.0, 254.0], "a disc set at 12"),
    ],
)
def test_what_is_badly_known_is_said(dose: list[float], thick: list[float], told: str) -> None:
    found = working_curve(dose, thick)
    assert any(told in sentence for sentence in cautions(found)), cautions(found)
