"""Diagnosis in space recovers the true parameters of recordings simulated with an independent tracer."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, SensorResponse, sensor_response
from solen.analysis.diagnosis import Diagnosis, Response, diagnosed
from solen.analysis.diagnosis.design_response import INDEX
from solen.analysis.diagnosis.light_by_position import light_by_position
from solen.sensor import Sensor
from solen.spec import loads, template, with_values
from tests.analysis.simulated_support import simulated
from tests.analysis.space_support import CHIPS, DESIGN, LitInSpace, fractions, traced
from tests.analysis.space_tracer_support import powers

PRIORS = {"angle.zero_deg": 0.1, INDEX: 0.003}
SEEDS = 200


def recorded(truth: LitInSpace) -> SensorResponse:
    return sensor_response([simulated(truth)], AnalysisOptions())


def test_strips_agree_with_the_independent_tracer() -> None:
    """At 1°; the errors of both are about 1e-4, for a swing of 0.3."""
    reach_mm = 0.2
    wide = Sensor.of(with_values(DESIGN, {"emitter.width_mm": 2.0 * reach_mm}))
    integral = light_by_position(wide, 1.0, reach_mm)
    for number, chip in enumerate(CHIPS):
        ends = chip.offset_mm + 0.5 * chip.width_mm * np.array([-1.0, 1.0])
        low, high = integral.integral_to(ends)
        assert (high - low) / chip.width_mm == pytest.approx(fractions(number, np.ones(1))[0], abs=2.0e-4)


@pytest.mark.parametrize(
    ("shape", "reach_mm", "chips"),
    [
        ("line-focus", 0.05, ((0.01, 0.08),)),
        pytest.param("layered", 0.2, ((0.0, 0.2), (0.03, 0.24), (-0.05, 0.1)), marks=pytest.mark.evidence),
    ],
)
def test_strips_agree_with_integrals_for_lenses_for_skew_rays(
    shape: str, reach_mm: float, chips: tuple[tuple[float, float], ...]
) -> None:
    """Their light is integrated with scrambled nets, which have a standard error."""
    lens = with_values(loads(template()), {"lens.shape": shape})
    integral = light_by_position(Sensor.of(with_values(lens, {"emitter.width_mm": 2.0 * reach_mm})), -1.0, reach_mm)
    for offset_mm, width_mm in chips:
        low, high = integral.integral_to(offset_mm + 0.5 * width_mm * np.array([-1.0, 1.0]))
        chip = Sensor.of(with_values(lens, {"emitter.offset_mm": offset_mm, "emitter.width_mm": width_mm}))
        direct = chip.integrate(-1.0, tolerance=6e-4).detectors
        assert (high - low) / width_mm == pytest.approx([direct[side].power for side in ("right", "left")], abs=1.5e-3)


@pytest.mark.evidence
@pytest.mark.parametrize("chip", range(len(CHIPS)))
def test_independent_tracer_reproduces_the_stored_fractions(chip: int) -> None:
    angles, columns = traced(chip)
    for row in (3, 27, 40):
        expected = pytest.approx(columns[row], abs=4e-4)
        assert powers(Sensor.of(DESIGN), CHIPS[chip], float(angles[row]), 18, 99) == expected


@cache
def response(dimension: str) -> Response:
    sensor = Sensor.of(with_values(DESIGN, {"trace.dimension": dimension}))
    return Response.of(sensor, -3.5, 3.5, {INDEX: PRIORS[INDEX]})


@pytest.mark.evidence
def test_table_agrees_with_the_independent_tracer() -> None:
    for number, chip in enumerate(CHIPS):
        angles, columns = traced(number)
        errors = response("extruded").fractions(angles, chip.offset_mm, chip.width_mm**2) - columns
        print(number, errors.std(), np.abs(errors).max())
        assert errors.std() < 8e-5
        assert np.abs(errors).max() < 2.5e-4


@pytest.mark.evidence
@pytest.mark.parametrize("change", [-0.003, 0.003])
def test_table_agrees_with_integrals_for_another_index(change: float) -> None:
    """The fractions change by up to 2e-3."""
    chip, base = CHIPS[0], Sensor.of(DESIGN)
    values = {"emitter.offset_mm": chip.offset_mm, "material.index": 1.44 + change}
    sensor = replace(Sensor.of(with_values(DESIGN, values)), cut=base.cut)
    angles = np.array([-2.4, -0.85, 0.0, 0.4, 0.75, 2.3])
    rows = response("extruded").fractions(angles, chip.offset_mm, chip.width_mm**2, {INDEX: change})
    for angle, row in zip(angles.tolist(), rows, strict=True):
        direct = sensor.integrate(angle, tolerance=3e-5).detectors
        assert row == pytest.approx([direct[side].power for side in ("right", "left")], abs=1.2e-4)


def covered(diagnosis: Diagnosis, chip: int) -> dict[str, bool]:
    """Return which intervals contain the true values, after a check of the errors."""
    true = {
        "emitter_offset_mm": CHIPS[chip].offset_mm,
        "chip_width_mm": CHIPS[chip].width_mm,
        "gain_right_V": 8.0,
        "gain_left_V": 7.0,
    }
    contained = {}
    for name, value in true.items():
        estimate = diagnosis.estimates[name]
        assert estimate.value is not None
        assert estimate.low is not None
        assert estimate.high is not None
        contained[name] = estimate.low <= value <= estimate.high
        limit = {"emitter_offset_mm": 5e-3, "chip_width_mm": 0.1 * CHIPS[chip].width_mm}.get(name, 0.05 * value)
        assert abs(estimate.value - value) < limit, name
    return contained


@pytest.mark.evidence
def test_intervals_have_their_coverage_in_space() -> None:
    """The zero angles of the recordings are drawn from the prior distribution."""
    rows: list[dict[str, bool]] = []
    for chip in range(len(CHIPS)):
        rng, misfits = np.random.default_rng(chip), 0
        for seed in range(SEEDS):
            zero = 0.1 * float(np.clip(rng.standard_normal(), -3.0, 3.0))
            truth = LitInSpace(chip=chip, zero_deg=zero, seed=seed)
            diagnosis = diagnosed(recorded(truth), response("extruded"), PRIORS)
            rows.append(covered(diagnosis, chip))
            right, left = (diagnosis.estimates[f"gain_{side}_V"] for side in ("right", "left"))
            assert right.low is not None
            assert left.high is not None
            assert right.low > left.high
            misfits += diagnosis.fitted.misfit.significant
        print(chip, coverage(rows[-SEEDS:]), "misfit", misfits / SEEDS)
        assert min(coverage(rows[-SEEDS:]).values()) >= 0.90
    print("all chips", coverage(rows))
    assert max(coverage(rows).values()) <= 0.99


def coverage(rows: list[dict[str, bool]]) -> dict[str, float]:
    """Return the fraction of the recordings whose intervals contain the true values."""
    return {name: sum(row[name] for row in rows) / len(rows) for name in rows[0]}


@pytest.mark.evidence
def test_plane_model_reports_a_misfit() -> None:
    diagnosis = diagnosed(recorded(LitInSpace()), response("2d"), PRIORS)
    estimates = {name: (estimate.value, estimate.low, estimate.high) for name, estimate in diagnosis.estimates.items()}
    print(diagnosis.fitted.misfit, estimates)
    assert diagnosis.fitted.misfit.significant
    assert diagnosis.fitted.misfit.share > 0.01
