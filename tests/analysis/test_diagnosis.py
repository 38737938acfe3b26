"""Diagnosis recovers what made a recording, within its intervals, and says what it cannot tell."""

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
    KNOWN,
    Lit,
    Rough,
    exact,
    model,
    response,
    sensor,
    table,
    truth,
)
from tests.analysis.simulated_support import made

DESIGN_TEXT = 'schema = 1\nname = "one"\n[material]\nindex = 1.44\n[emitter]\nwidth_mm = 0.2\n'
DESIGN = loads(DESIGN_TEXT)
GAINS = {"gain right": 8.0, "gain left": 7.0, "offset right": 5.0, "offset left": 4.8}
TRUTHS = (
    {OFFSET: 0.02, SPREAD: 0.2**2, **GAINS},
    {OFFSET: -0.06, SPREAD: 0.1**2, **GAINS},
    {OFFSET: 0.0, SPREAD: 0.3**2, **GAINS},
)


def fitted_places(of: Model) -> list[int]:
    """All but the loss, which nothing tells from the gains."""
    return [place for place, one in enumerate(of.parameters) if one.name != LOSS]


def test_a_table_gives_the_integral_over_any_chip() -> None:
    one = table()
    for offset, width in ((0.0, 0.2), (0.05, 0.1), (-0.08, 0.31), (0.03, 0.02)):
        assert one.chip(ANGLES, offset, width) == pytest.approx(exact(ANGLES, offset, width), abs=2e-6)
    point = 0.25 * (1.0 - np.tanh((0.01 + 0.03 * ANGLES) / (0.04 * (1 + 0.15 * (ANGLES / 3) ** 2 + 0.02 * ANGLES))))
    assert one.chip(ANGLES, 0.01, 0.0)[:, 0] == pytest.approx(point, abs=2e-4)  # a point is 4 µm wide


def test_a_traced_table_is_the_response_of_the_design() -> None:
    found = Table.of(Sensor.of(DESIGN), angles_deg(-0.6, 0.6))
    for offset, width, angle in ((0.0, 0.2, 0.3), (0.03, 0.2, -0.45), (-0.05, 0.1, 0.2)):
        values = {"emitter.offset_mm": offset, "emitter.width_mm": width}
        traced = Sensor.of(with_values(DESIGN, values)).integrate(angle, tolerance=1e-5).detectors
        shares = found.chip(np.array([angle]), offset, width)[0]
        # what a table is stated to be off by: 1e-4 of the swing of about 1/2
        assert shares == pytest.approx([traced["right"].power, traced["left"].power], abs=1e-4)
    assert found.chip(np.zeros(1), 0.03, 0.2)[0, 1] > found.chip(np.zeros(1), 0.03, 0.2)[0, 0]  # right lights left


def test_scattered_light_has_no_table() -> None:
    rough = loads(DESIGN_TEXT + '[[wall]]\nface = "stem-left"\nscatter = "lambertian"\n')
    with pytest.raises(DesignError, match="scatter"):
        Table.of(Sensor.of(rough), angles_deg(-0.5, 0.5))


@pytest.mark.parametrize("values", TRUTHS)
def test_without_noise_every_number_comes_back(values: dict[str, float]) -> None:
    one = model(response())
    true = truth(one, **values)
    curves = one.volts(true)
    found = fit(one, Cycles(ANGLES, np.repeat(curves[None], 5, axis=0)), fitted_places(one))
    for name, value in values.items():
        assert found.value(name) == pytest.approx(value, abs=1e-6 * one.parameters[one.indices[name]].scale + 1e-7)
    assert abs(found.value(INDEX)) < 1e-7
    assert abs(found.value(ZERO)) < 1e-6
    assert found.residual_V == pytest.approx(np.zeros_like(curves), abs=1e-7)


def test_a_design_of_a_point_finds_its_chip() -> None:
    of = model(response(width_mm=0.0))
    true = truth(of, **TRUTHS[0])
    found = fit(of, Cycles(ANGLES, np.repeat(of.volts(true)[None], 3, axis=0)), fitted_places(of))
    assert found.value(SPREAD) == pytest.approx(0.04, abs=1e-6)
    assert found.value(OFFSET) == pytest.approx(0.02, abs=1e-6)


def test_the_bend_of_the_load_line_is_undone() -> None:
    load_lines = LoadLines(5.0, 0.15, 0.1, (0.02, 0.02))
    one = replace(model(response()), load_lines=load_lines)
    true = truth(one, **{OFFSET: 0.02, "gain right": 9.6, "gain left": 9.4})
    shares = exact(ANGLES, 0.02, 0.2) * np.array([9.6, 9.4])
    dark = load_line(np.array(0.02), 1e3, 5.0, 0.15, 0.1).volts
    down = dark - load_line(shares + 0.02, 1e3, 5.0, 0.15, 0.1).volts
    at = replace(one, angle_deg=ANGLES)
    assert at.volts(true)[[0, -1]] == pytest.approx(-down[[0, -1]], abs=1e-4)  # the ends are no means over a cell
    cycles = Cycles(ANGLES, np.repeat(one.volts(true)[None], 3, axis=0))
    assert fit(one, cycles, fitted_places(one)).value("gain right") == pytest.approx(9.6, abs=1e-5)
    straight = fit(replace(one, load_lines=None), cycles, fitted_places(one))
    assert straight.misfit.significant  # the bend shows


def coverage(values: dict[str, float], draws: int, rough: Rough, seed: int, count: int = 5) -> dict[str, FloatArray]:
    """How often intervals of 68 and 95 % hold the truth, what differs between prints drawn as well."""
    of = response()
    one, draw = model(of), np.random.default_rng(seed)
    names = (OFFSET, SPREAD, "gain right", "gain left")
    hits = {name: np.zeros(2) for name in names}
    for _ in range(draws):
        own = {ZERO: KNOWN["angle.zero_deg"] * draw.standard_normal(), INDEX: KNOWN[INDEX] * draw.standard_normal()}
        true = truth(one, **values, **own)
        found = fit(one, rough.cycles(one.volts(true), count, draw), fitted_places(one), true)
        for name in names:
            off = abs(found.value(name) - true[one.indices[name]])
            hits[name] += [off <= found.half_width(name, level) for level in (0.6827, 0.95)]
    return {name: each / draws for name, each in hits.items()}


def check_nominal(found: dict[str, FloatArray], draws: int) -> None:
    for name, (narrow, wide) in found.items():
        for share, nominal in ((narrow, 0.6827), (wide, 0.95)):
            spread = math.sqrt(nominal * (1.0 - nominal) / draws)
            # three standard deviations of the count to each side, and 2 % for what the table itself is let be off by
            assert nominal - 3.0 * spread <= share <= nominal + 3.0 * spread + 0.02, (name, nominal, share)


def test_intervals_hold_at_their_rate() -> None:
    check_nominal(coverage(TRUTHS[0], 100, Rough(), 1), 100)


@pytest.mark.evidence
@pytest.mark.parametrize("place", range(len(TRUTHS)))
@pytest.mark.parametrize("rough", [Rough(), Rough(white=5e-3, level=0.0, wave=0.0, drift=0.0, gain=0.0)])
def test_intervals_hold_at_their_rate_over_many_draws(place: int, rough: Rough) -> None:
    found = coverage(TRUTHS[place], 1000, rough, 10 + place)
    print({name: each.round(3).tolist() for name, each in found.items()})
    check_nominal(found, 1000)


def test_a_misfit_is_reported_and_widens_the_intervals() -> None:
    one, draw = model(response()), np.random.default_rng(3)
    true = truth(one, **TRUTHS[0])
    curves, places = one.volts(true), fitted_places(one)
    plain = fit(one, Rough().cycles(curves, 5, draw), places)
    waves = np.cos(np.pi * np.arange(12)[:, None] * np.linspace(0.0, 1.0, ANGLES.size))
    missed = fit(one, Rough().cycles(curves + 0.01 * (draw.standard_normal((2, 12)) @ waves).T, 5, draw), places)
    assert missed.misfit.significant
    assert missed.misfit.share > 3.0 * plain.misfit.share
    for name in (OFFSET, SPREAD, "gain right"):
        assert missed.u(name) > 2.0 * plain.u(name)
        assert abs(missed.value(name) - true[one.indices[name]]) < 4.0 * missed.u(name)


def test_one_cycle_takes_its_noise_for_white() -> None:
    one, draw = model(response()), np.random.default_rng(4)
    true = truth(one, **TRUTHS[0])
    found = fit(one, Rough(level=0, wave=0, drift=0, gain=0).cycles(one.volts(true), 1, draw), fitted_places(one))
    assert 0.0 < found.u(OFFSET) < 0.01
    assert abs(found.value(OFFSET) - 0.02) < 4.0 * found.u(OFFSET)
    assert math.isnan(found.misfit.chance)
    assert found.half_width(OFFSET) == pytest.approx(float(t.ppf(0.975, found.freedom[0])) * found.u(OFFSET))


def test_a_recording_is_said_in_words() -> None:
    found = diagnosed(sensor(Lit(noise_V=2e-3, offset_mm=-0.05)), response(), KNOWN)
    said = words(found)
    assert re.fullmatch(r"emitter 0\.0[45]\d+ ± 0\.00\d+ mm to the left", said[0])
    assert any(line.startswith("chip 0.2") and line.endswith("mm wide") for line in said)
    told = " ".join(said)
    assert "the loss in the material and the gains cannot be determined separately" in told
    assert set(found.undetermined[LOSS]) >= {"gain right", "gain left"}
    assert found.estimates["loss_per_mm"].value is None
    assert found.estimates["gain_ratio"].value == pytest.approx(8.0 / 7.0, rel=5e-3)
    assert any(line.startswith("moving the emitter by") and "to the right" in line for line in advice(found))
    assert any(line.startswith("dividing the right receiver's load resistance by 1.1") for line in advice(found))
    assert any("cutback" in line for line in advice(found))


def test_a_point_gets_an_upper_limit() -> None:
    found = diagnosed(sensor(Lit(noise_V=5e-3, width_mm=1e-3)), response(), KNOWN)
    chip = found.estimates["chip_width_mm"]
    assert chip.low == 0.0
    assert chip.u_value is None
    assert chip.high is not None
    assert 0.0 < chip.high < 0.06
    assert any(line.startswith("chip at most 0.0") for line in words(found))


def test_a_flat_response_tells_neither_decentre_nor_chip() -> None:
    base = table()
    shape = base.total_mm[:, :, -1:] * np.linspace(0.0, 1.0, base.position_mm.size)  # every place gives the same
    still = replace(base, total_mm=shape * np.array([1.0, 1.0])[:, None, None], edge=np.zeros(1))
    tilt = 1.0 - 0.02 * base.angle_deg
    still = replace(still, total_mm=still.total_mm * np.stack([tilt, tilt[::-1]])[:, :, None])
    flat = Response(still, {}, replace(still, total_mm=-0.3 * still.total_mm), 0.2, 0.0)
    one = model(flat)
    curves = one.volts(truth(one, **GAINS))
    bare = sensor(Lit(noise_V=1e-3))
    ways = np.repeat(np.repeat(curves[:, ::-1][None, None], 5, axis=0), 2, axis=1)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(ways.shape)
    passes = replace(bare.passes, angle_deg=ANGLES, volts=ways + noise, clipped=np.zeros(ways.shape, bool))
    found = diagnosed(replace(bare, passes=passes), flat, KNOWN)
    assert {OFFSET, SPREAD} <= set(found.undetermined)
    said = " ".join(words(found))
    assert "the emitter's decentre cannot be determined" in said
    assert "the chip's width cannot be determined" in said
    assert any("with the lens" in line for line in advice(found))


def test_one_receiver_is_enough_where_its_side_is_known() -> None:
    signals = made(Lit(noise_V=2e-3))
    alone = replace(signals, receivers=("right",), volts=signals.volts[:, 1:])
    found = diagnosed(sensor_response([alone], AnalysisOptions()), response(), KNOWN)
    assert found.sides == ("right",)
    one = found.estimates["emitter_offset_mm"]
    assert one.low is not None
    assert one.high is not None
    assert one.low < 0.02 < one.high
    assert "gain_ratio" not in found.estimates


def test_receivers_without_a_side_are_refused() -> None:
    nameless = replace(made(Lit()), receivers=("ai0", "ai1"))
    with pytest.raises(DataError, match="do not distinguish right from left"):
        diagnosed(sensor_response([nameless], AnalysisOptions()), response(), KNOWN)
    twice = replace(made(Lit()), receivers=("right_1", "right_2"))
    with pytest.raises(DataError, match="both recognised as the right receiver"):
        diagnosed(sensor_response([twice], AnalysisOptions()), response(), KNOWN)


def test_clipped_angles_are_left_out_and_reported() -> None:
    clear, cut = Lit(noise_V=2e-3), Lit(noise_V=2e-3, rails_V=(1.6, 4.4))
    found = diagnosed(sensor_response([made(cut)], AnalysisOptions(rails=(1.6, 4.4))), response(), KNOWN)
    assert 0.05 < found.omitted["right"] < 0.9
    one = found.estimates["emitter_offset_mm"]
    assert one.low is not None
    assert one.high is not None
    assert one.low < clear.offset_mm < one.high


def test_too_few_angles_are_refused() -> None:
    with pytest.raises(DataError, match="at least 12"):
        diagnosed(sensor_response([made(Lit())], AnalysisOptions(step_deg=0.6)), response(), KNOWN)


def test_a_turned_angle_is_refused() -> None:
    signals = made(Lit(noise_V=1e-3))
    with pytest.raises(DataError, match="--flip-angle"):
        diagnosed(
            sensor_response([replace(signals, angle_deg=-signals.angle_deg)], AnalysisOptions()), response(), KNOWN
        )
    rising = replace(signals, volts=-signals.volts)
    with pytest.raises(DataError, match="--brighter higher"):
        diagnosed(sensor_response([rising], AnalysisOptions()), response(), KNOWN)
    found = diagnosed(sensor_response([rising], AnalysisOptions()), response(), KNOWN, rising=True)
    assert found.estimates["gain_right_V"].value == pytest.approx(8.0, rel=0.02)


@pytest.mark.evidence
def test_intervals_hold_where_the_model_is_off() -> None:
    """Waves of the kind that the misfit is taken for, drawn anew each time, do not spoil the intervals."""
    one, draw = model(response()), np.random.default_rng(5)
    hits, draws = dict.fromkeys((OFFSET, SPREAD, "gain right", "gain left"), 0), 500
    waves = np.cos(np.pi * np.arange(12)[:, None] * np.linspace(0.0, 1.0, ANGLES.size))
    for _ in range(draws):
        true = truth(one, **TRUTHS[0])
        curves = one.volts(true) + 0.01 * (draw.standard_normal((2, 12)) @ waves).T
        found = fit(one, Rough().cycles(curves, 5, draw), fitted_places(one), true)
        for name in hits:
            hits[name] += abs(found.value(name) - true[one.indices[name]]) <= found.half_width(name)
    print({name: count / draws for name, count in hits.items()})
    for count in hits.values():
        assert 0.90 <= count / draws <= 0.99  # how large a misfit is rests on few waves
