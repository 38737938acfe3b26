"""Diagnosis recovers the true parameters of simulated recordings within its intervals, or reports them undetermined."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t

from solen.analysis import AnalysisOptions, sensor_response
from solen.analysis.diagnosis import Cycles, LoadLines, Response, Table, advice, diagnosed, fit, words
from solen.analysis.diagnosis.curve_model import LOSS, OFFSET, SPREAD, ZERO, Model
from solen.analysis.diagnosis.design_response import INDEX
from solen.analysis.diagnosis.response_table import angles_deg
from solen.arrays import FloatArray
from solen.errors import DataError, DesignError
from solen.readout.transistor import load_line
from solen.sensor import Sensor
from solen.spec import loads, with_values
from tests.analysis.diagnosis_support import (
    ANGLES,
    PRIORS,
    Disturbances,
    LitSensor,
    exact_fractions,
    model,
    parameter_vector,
    recorded_response,
    response,
    table,
)
from tests.analysis.simulated_support import simulated

DESIGN_TEXT = 'schema = 1\nname = "one"\n[material]\nindex = 1.44\n[emitter]\nwidth_mm = 0.2\n'
DESIGN = loads(DESIGN_TEXT)
GAINS = {"gain right": 8.0, "gain left": 7.0, "offset right": 5.0, "offset left": 4.8}
TRUTHS = (
    {OFFSET: 0.02, SPREAD: 0.2**2, **GAINS},
    {OFFSET: -0.06, SPREAD: 0.1**2, **GAINS},
    {OFFSET: 0.0, SPREAD: 0.3**2, **GAINS},
)


def fitted_indices(of: Model) -> list[int]:
    """Return the indices of all parameters but the loss, which cannot be determined separately from the gains."""
    return [index for index, parameter in enumerate(of.parameters) if parameter.name != LOSS]


def test_table_gives_the_fractions_of_any_chip() -> None:
    exact_table = table()
    for offset, width in ((0.0, 0.2), (0.05, 0.1), (-0.08, 0.31), (0.03, 0.02)):
        expected = exact_fractions(ANGLES, offset, width)
        assert exact_table.chip(ANGLES, offset, width) == pytest.approx(expected, abs=2e-6)
    point = 0.25 * (1.0 - np.tanh((0.01 + 0.03 * ANGLES) / (0.04 * (1 + 0.15 * (ANGLES / 3) ** 2 + 0.02 * ANGLES))))
    assert exact_table.chip(ANGLES, 0.01, 0.0)[:, 0] == pytest.approx(
        point, abs=2e-4
    )  # the table treats it as 4 µm wide


def test_traced_table_agrees_with_integrals_of_the_design() -> None:
    traced = Table.of(Sensor.of(DESIGN), angles_deg(-0.6, 0.6))
    for offset, width, angle in ((0.0, 0.2, 0.3), (0.03, 0.2, -0.45), (-0.05, 0.1, 0.2)):
        values = {"emitter.offset_mm": offset, "emitter.width_mm": width}
        detectors = Sensor.of(with_values(DESIGN, values)).integrate(angle, tolerance=1e-5).detectors
        fractions = traced.chip(np.array([angle]), offset, width)[0]
        # the documented error of a table is 1e-4 of the swing, which is about 1/2
        assert fractions == pytest.approx([detectors["right"].power, detectors["left"].power], abs=1e-4)
    right, left = traced.chip(np.zeros(1), 0.03, 0.2)[0]
    assert left > right  # an emitter to the right of the axis illuminates the left receiver


def test_refuses_a_design_with_scattering() -> None:
    scattering = loads(DESIGN_TEXT + '[[wall]]\nface = "stem-left"\nscatter = "lambertian"\n')
    with pytest.raises(DesignError, match="scatter"):
        Table.of(Sensor.of(scattering), angles_deg(-0.5, 0.5))


@pytest.mark.parametrize("values", TRUTHS)
def test_recovers_parameters_without_noise(values: dict[str, float]) -> None:
    exact_model = model(response())
    curves = exact_model.volts(parameter_vector(exact_model, **values))
    cycles = Cycles(ANGLES, np.repeat(curves[None], 5, axis=0))
    fitted = fit(exact_model, cycles, fitted_indices(exact_model))
    for name, value in values.items():
        scale = exact_model.parameters[exact_model.indices[name]].scale
        assert fitted.value(name) == pytest.approx(value, abs=1e-6 * scale + 1e-7)
    assert abs(fitted.value(INDEX)) < 1e-7
    assert abs(fitted.value(ZERO)) < 1e-6
    assert fitted.residual_V == pytest.approx(np.zeros_like(curves), abs=1e-7)


def test_determines_the_chip_width_if_the_design_has_a_point() -> None:
    point = model(response(width_mm=0.0))
    volts = point.volts(parameter_vector(point, **TRUTHS[0]))
    fitted = fit(point, Cycles(ANGLES, np.repeat(volts[None], 3, axis=0)), fitted_indices(point))
    assert fitted.value(SPREAD) == pytest.approx(0.04, abs=1e-6)
    assert fitted.value(OFFSET) == pytest.approx(0.02, abs=1e-6)


def test_model_includes_the_load_lines() -> None:
    load_lines = LoadLines(5.0, 0.15, 0.1, (0.02, 0.02))
    saturating = replace(model(response()), load_lines=load_lines)
    true = parameter_vector(saturating, **{OFFSET: 0.02, "gain right": 9.6, "gain left": 9.4})
    light = exact_fractions(ANGLES, 0.02, 0.2) * np.array([9.6, 9.4])
    dark_V = load_line(np.array(0.02), 1e3, 5.0, 0.15, 0.1).volts
    drop_V = dark_V - load_line(light + 0.02, 1e3, 5.0, 0.15, 0.1).volts
    volts = saturating.volts(true)
    assert volts[[0, -1]] == pytest.approx(-drop_V[[0, -1]], abs=1e-4)  # values at the ends are not averaged
    cycles = Cycles(ANGLES, np.repeat(volts[None], 3, axis=0))
    assert fit(saturating, cycles, fitted_indices(saturating)).value("gain right") == pytest.approx(9.6, abs=1e-5)
    linear = fit(replace(saturating, load_lines=None), cycles, fitted_indices(saturating))
    assert linear.misfit.significant


def coverage(
    values: dict[str, float], draws: int, disturbances: Disturbances, seed: int, count: int = 5
) -> dict[str, FloatArray]:
    """Return the fractions of 68 % and 95 % intervals that contain the true values; zero angle and index are drawn."""
    exact_model, rng = model(response()), np.random.default_rng(seed)
    names = (OFFSET, SPREAD, "gain right", "gain left")
    hits = {name: np.zeros(2) for name in names}
    for _ in range(draws):
        drawn = {ZERO: PRIORS["angle.zero_deg"] * rng.standard_normal(), INDEX: PRIORS[INDEX] * rng.standard_normal()}
        true = parameter_vector(exact_model, **values, **drawn)
        cycles = disturbances.cycles(exact_model.volts(true), count, rng)
        fitted = fit(exact_model, cycles, fitted_indices(exact_model), true)
        for name in names:
            error = abs(fitted.value(name) - true[exact_model.indices[name]])
            hits[name] += [error <= fitted.half_width(name, level) for level in (0.6827, 0.95)]
    return {name: count / draws for name, count in hits.items()}


def check_nominal(fractions: dict[str, FloatArray], draws: int) -> None:
    """Check that intervals have their coverage, to three standard deviations and 2 % for the error of the table."""
    for name, (narrow, wide) in fractions.items():
        for fraction, nominal in ((narrow, 0.6827), (wide, 0.95)):
            sd = math.sqrt(nominal * (1.0 - nominal) / draws)
            assert nominal - 3.0 * sd <= fraction <= nominal + 3.0 * sd + 0.02, (name, nominal, fraction)


def test_intervals_have_their_coverage() -> None:
    check_nominal(coverage(TRUTHS[0], 60, Disturbances(), 1), 60)


@pytest.mark.evidence
@pytest.mark.parametrize("index", range(len(TRUTHS)))
@pytest.mark.parametrize(
    "disturbances", [Disturbances(), Disturbances(white=5e-3, level=0.0, wave=0.0, drift=0.0, gain=0.0)]
)
def test_intervals_have_their_coverage_over_many_draws(index: int, disturbances: Disturbances) -> None:
    fractions = coverage(TRUTHS[index], 1000, disturbances, 10 + index)
    print({name: fraction.round(3).tolist() for name, fraction in fractions.items()})
    check_nominal(fractions, 1000)


def test_misfit_is_reported_and_widens_the_intervals() -> None:
    exact_model, rng = model(response()), np.random.default_rng(3)
    true = parameter_vector(exact_model, **TRUTHS[0])
    curves, indices = exact_model.volts(true), fitted_indices(exact_model)
    matching = fit(exact_model, Disturbances().cycles(curves, 5, rng), indices)
    waves = np.cos(np.pi * np.arange(12)[:, None] * np.linspace(0.0, 1.0, ANGLES.size))
    wavy = curves + 0.01 * (rng.standard_normal((2, 12)) @ waves).T
    deviating = fit(exact_model, Disturbances().cycles(wavy, 5, rng), indices)
    assert deviating.misfit.significant
    assert deviating.misfit.share > 3.0 * matching.misfit.share
    for name in (OFFSET, SPREAD, "gain right"):
        assert deviating.u(name) > 2.0 * matching.u(name)
        assert abs(deviating.value(name) - true[exact_model.indices[name]]) < 4.0 * deviating.u(name)


def test_noise_of_a_single_cycle_is_assumed_to_be_white() -> None:
    exact_model, rng = model(response()), np.random.default_rng(4)
    true = parameter_vector(exact_model, **TRUTHS[0])
    cycle = Disturbances(level=0, wave=0, drift=0, gain=0).cycles(exact_model.volts(true), 1, rng)
    fitted = fit(exact_model, cycle, fitted_indices(exact_model))
    assert 0.0 < fitted.u(OFFSET) < 0.01
    assert abs(fitted.value(OFFSET) - 0.02) < 4.0 * fitted.u(OFFSET)
    assert math.isnan(fitted.misfit.chance)
    assert fitted.half_width(OFFSET) == pytest.approx(float(t.ppf(0.975, fitted.freedom[0])) * fitted.u(OFFSET))


def test_summary_reports_estimates_and_advice() -> None:
    diagnosis = diagnosed(recorded_response(LitSensor(noise_V=2e-3, offset_mm=-0.05)), response(), PRIORS)
    lines = words(diagnosis)
    assert re.fullmatch(r"emitter 0\.0[45]\d+ ± 0\.00\d+ mm to the left", lines[0])
    assert any(line.startswith("chip 0.2") and line.endswith("mm wide") for line in lines)
    assert any("the loss in the material and the gains cannot be determined separately" in line for line in lines)
    assert set(diagnosis.undetermined[LOSS]) >= {"gain right", "gain left"}
    assert diagnosis.estimates["loss_per_mm"].value is None
    assert diagnosis.estimates["gain_ratio"].value == pytest.approx(8.0 / 7.0, rel=5e-3)
    assert any(line.startswith("moving the emitter by") and "to the right" in line for line in advice(diagnosis))
    assert any(line.startswith("dividing the right receiver's load resistance by 1.1") for line in advice(diagnosis))
    assert any("cutback" in line for line in advice(diagnosis))


def test_chip_width_of_a_point_has_an_upper_limit() -> None:
    diagnosis = diagnosed(recorded_response(LitSensor(noise_V=5e-3, width_mm=1e-3)), response(), PRIORS)
    chip = diagnosis.estimates["chip_width_mm"]
    assert chip.low == 0.0
    assert chip.u_value is None
    assert chip.high is not None
    assert 0.0 < chip.high < 0.06
    assert any(line.startswith("chip at most 0.0") for line in words(diagnosis))


def test_decentre_and_chip_are_undetermined_if_the_response_is_independent_of_the_position() -> None:
    base = table()
    tilt = 1.0 - 0.02 * base.angle_deg
    uniform = base.total_mm[:, :, -1:] * np.linspace(0.0, 1.0, base.position_mm.size)
    flat_table = replace(base, total_mm=uniform * np.stack([tilt, tilt[::-1]])[:, :, None], edge=np.zeros(1))
    flat = Response(flat_table, {}, replace(flat_table, total_mm=-0.3 * flat_table.total_mm), 0.2, 0.0)
    flat_model = model(flat)
    curves = flat_model.volts(parameter_vector(flat_model, **GAINS))
    sensor = recorded_response(LitSensor(noise_V=1e-3))
    volts = np.repeat(np.repeat(curves[:, ::-1][None, None], 5, axis=0), 2, axis=1)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(volts.shape)
    passes = replace(sensor.passes, angle_deg=ANGLES, volts=volts + noise, clipped=np.zeros(volts.shape, bool))
    diagnosis = diagnosed(replace(sensor, passes=passes), flat, PRIORS)
    assert {OFFSET, SPREAD} <= set(diagnosis.undetermined)
    summary = " ".join(words(diagnosis))
    assert "the emitter's decentre cannot be determined" in summary
    assert "the chip's width cannot be determined" in summary
    assert any("with the lens" in line for line in advice(diagnosis))


def test_diagnoses_a_single_receiver() -> None:
    signals = simulated(LitSensor(noise_V=2e-3))
    signals_of_right = replace(signals, receivers=("right",), volts=signals.volts[:, 1:])
    diagnosis = diagnosed(sensor_response([signals_of_right], AnalysisOptions()), response(), PRIORS)
    assert diagnosis.sides == ("right",)
    decentre = diagnosis.estimates["emitter_offset_mm"]
    assert decentre.low is not None
    assert decentre.high is not None
    assert decentre.low < 0.02 < decentre.high
    assert "gain_ratio" not in diagnosis.estimates


def test_refuses_receivers_whose_sides_are_not_recognised() -> None:
    nameless = replace(simulated(LitSensor()), receivers=("ai0", "ai1"))
    with pytest.raises(DataError, match="do not distinguish right from left"):
        diagnosed(sensor_response([nameless], AnalysisOptions()), response(), PRIORS)
    twice = replace(simulated(LitSensor()), receivers=("right_1", "right_2"))
    with pytest.raises(DataError, match="both recognised as the right receiver"):
        diagnosed(sensor_response([twice], AnalysisOptions()), response(), PRIORS)


def test_omits_clipped_angles() -> None:
    clipped = LitSensor(noise_V=2e-3, rails_V=(1.6, 4.4))
    diagnosis = diagnosed(sensor_response([simulated(clipped)], AnalysisOptions(rails=(1.6, 4.4))), response(), PRIORS)
    assert 0.05 < diagnosis.omitted["right"] < 0.9
    decentre = diagnosis.estimates["emitter_offset_mm"]
    assert decentre.low is not None
    assert decentre.high is not None
    assert decentre.low < clipped.offset_mm < decentre.high


def test_refuses_too_few_angles() -> None:
    with pytest.raises(DataError, match="at least 12"):
        diagnosed(sensor_response([simulated(LitSensor())], AnalysisOptions(step_deg=0.6)), response(), PRIORS)


def test_refuses_inverted_angles_and_voltages() -> None:
    signals = simulated(LitSensor(noise_V=1e-3))
    with pytest.raises(DataError, match="--flip-angle"):
        diagnosed(
            sensor_response([replace(signals, angle_deg=-signals.angle_deg)], AnalysisOptions()), response(), PRIORS
        )
    rising = replace(signals, volts=-signals.volts)
    with pytest.raises(DataError, match="--brighter higher"):
        diagnosed(sensor_response([rising], AnalysisOptions()), response(), PRIORS)
    diagnosis = diagnosed(sensor_response([rising], AnalysisOptions()), response(), PRIORS, rising=True)
    assert diagnosis.estimates["gain_right_V"].value == pytest.approx(8.0, rel=0.02)


@pytest.mark.evidence
def test_intervals_have_their_coverage_despite_a_misfit() -> None:
    """The deviations are random waves, as assumed in the estimate of the misfit, whose size follows from few waves."""
    exact_model, rng = model(response()), np.random.default_rng(5)
    hits, draws = dict.fromkeys((OFFSET, SPREAD, "gain right", "gain left"), 0), 500
    waves = np.cos(np.pi * np.arange(12)[:, None] * np.linspace(0.0, 1.0, ANGLES.size))
    for _ in range(draws):
        true = parameter_vector(exact_model, **TRUTHS[0])
        curves = exact_model.volts(true) + 0.01 * (rng.standard_normal((2, 12)) @ waves).T
        fitted = fit(exact_model, Disturbances().cycles(curves, 5, rng), fitted_indices(exact_model), true)
        for name in hits:
            hits[name] += abs(fitted.value(name) - true[exact_model.indices[name]]) <= fitted.half_width(name)
    print({name: count / draws for name, count in hits.items()})
    for count in hits.values():
        assert 0.90 <= count / draws <= 0.99
