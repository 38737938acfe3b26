"""Determination of a network's motions by its readings, compared with fits to noisy readings."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solen.readout import volts
from solen.sensor import Sensor
from solen.sensor.network import NetworkSensitivities, network_sensitivities
from solen.sensor.network.motions import Determination, determined, undetermined_sentences
from solen.sensor.network.readings import readings_of
from solen.sensor.network.signals import Signals, circuits_of
from solen.sensor.network.suggestions import suggestions
from solen.sensor.network.volts import network_volts
from solen.sensor.readings import readings_from
from solen.spec import Design, loads, template, with_values
from tests.geometry.network_support import MOTIONS, READINGS, three_guides, y_network


def estimates(
    design: Design, sensitivities: NetworkSensitivities, draws: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Estimates (draws, motions) from all noisy voltages, and from the readings, with the motions at 0.

    They are least-squares fits, weighted by the scatter of the draws.
    """
    assert sensitivities.signals is not None
    drawn_V, received, slope_V = (
        drawn(design, sensitivities.signals, draws, seed),
        sensitivities.signals.received[0],
        sensitivities.signals.slope_V[0],
    )
    powers = received + (drawn_V - (sensitivities.signals.voltage_V[0] - sensitivities.signals.off_V)) / slope_V
    readings = readings_of(design.network, powers, np.zeros_like(powers))[0]
    jacobian_V = (sensitivities.slope * slope_V).reshape(len(sensitivities.keys), -1).T
    rows = ((drawn_V.reshape(draws, -1), jacobian_V), (readings, sensitivities.reading_slope.T))
    first, second = (fitted_motions(values, jacobian) for values, jacobian in rows)
    return first, second


def drawn(design: Design, signals: Signals, draws: int, seed: int) -> np.ndarray:
    """Noisy readings (draws, emitters, receivers) in the first state: on, minus the mean of the off readings around it.

    The samples with an emitter on and with all off are drawn and quantised.
    """
    rng = np.random.default_rng(seed)
    circuits = circuits_of(design)
    pairs = zip(circuits, signals.received[0], strict=True)
    on = [volts(np.tile(row, (draws, 1)), circuit, rng=rng) for circuit, row in pairs]
    error = [volts(np.zeros_like(on[0]), circuits[0], rng=rng) for _ in range(len(on) + 1)]
    return np.stack([circuit - 0.5 * (error[i] + error[i + 1]) for i, circuit in enumerate(on)], axis=1)


def fitted_motions(values: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Motions (draws, M) by generalised least squares of values (draws, N)."""
    weight = np.linalg.pinv(np.cov(values, rowvar=False))
    solved = np.linalg.solve(jacobian.T @ weight @ jacobian, jacobian.T @ weight)
    return np.asarray((values - values.mean(axis=0)) @ solved.T)


def check_scatter(design: Design, draws: int) -> None:
    sensitivities = network_sensitivities(design, tolerance=1e-3)
    for determination, fits in zip(
        (sensitivities.by_voltages, sensitivities.by_readings), estimates(design, sensitivities, draws, 7), strict=True
    ):
        assert determination is not None
        relative_error = np.std(fits, axis=0) / determination.sd_deg - 1.0
        print(f"{design.name}: sd of {draws} fits over the stated one less 1: {np.round(relative_error, 4).tolist()}")
        assert np.abs(relative_error).max() < 4.0 / math.sqrt(2.0 * draws) + 0.01
        correlation = np.corrcoef(fits, rowvar=False)[0, 1]
        variance = np.diag(determination.covariance_deg2)
        assert correlation == pytest.approx(
            determination.covariance_deg2[0, 1] / math.sqrt(variance[0] * variance[1]), abs=0.1
        )


def test_estimates_scatter_by_the_computed_sd() -> None:
    check_scatter(three_guides(motion=MOTIONS, reading=READINGS), 3000)


RATIOS = {
    "hand-860": ["(index.palm-right - index.palm-left) / index.thumb", "ring.palm-left / ring.thumb"],
    "robot-860": ["head.back-right / head.back-left", "tail.front-right / tail.front-left"],
}


@pytest.mark.evidence
@pytest.mark.parametrize("name", RATIOS)
@pytest.mark.parametrize("circuit", [{}, {"readout.samples": 16, "readout.emitter_current_ma": 0.5}])
def test_estimates_of_template_networks_scatter_by_the_computed_sd(name: str, circuit: dict[str, Any]) -> None:
    reading = [{"name": text, "value": text} for text in RATIOS[name]]
    values = {"trace.dimension": "2d", "network.reading": reading} | circuit
    check_scatter(with_values(loads(template(name)), values), 20000)


def determination_of(slope: list[list[float]], u: float = 1e-3, noise: float = 0.1) -> Determination:
    jacobian = np.array(slope)
    names = ["index", "ring", "thumb"][: jacobian.shape[1]]
    return determined(names, jacobian, np.full(jacobian.shape, u), noise**2 * np.eye(len(jacobian)))


def test_sentences_name_the_determined_combination_of_equivalent_motions() -> None:
    equivalent = determination_of([[1.0, 1.0], [2.0, 2.0]])
    assert equivalent.rank == 1
    assert np.isinf(equivalent.sd_deg).all()
    (text,) = undetermined_sentences(equivalent)  # the sum s changes the readings by s·(1, 2), so that its sd is 0.1/√5
    assert "index and ring have the same effects on the readings: only their sum" in text
    assert "± 0.045°" in text
    assert "only their difference" in next(undetermined_sentences(determination_of([[1.0, -1.0], [2.0, -2.0]])))
    assert "only ring + 0.5 index can be measured, to ± 0.022°" in next(
        undetermined_sentences(determination_of([[1.0, 2.0], [2.0, 4.0]]))
    )


def test_independent_motion_is_determined_among_undetermined_ones() -> None:
    determination = determination_of([[1.0, 1.0, 0.0], [0.0, 0.0, 4.0], [1.0, 1.0, 0.0]])
    assert np.isinf(determination.sd_deg).tolist() == [True, True, False]
    assert determination.sd_deg[2] == pytest.approx(0.1 / 4.0)
    assert determination.worst_sd_deg == math.inf
    assert "thumb changes the readings by no more" in next(
        undetermined_sentences(determination_of([[1.0, 0.0, 0.0], [0.0, 4.0, 0.0]]))
    )
    assert "only 1 combination of the 3 motions" in next(undetermined_sentences(determination_of([[1.0, 2.0, 3.0]])))


def test_improvement_must_exceed_its_uncertainty() -> None:
    def determination_with(*slopes: float) -> Determination:
        jacobian = np.diag(slopes)
        return determined(["a", "b"], jacobian, 0.05 * jacobian, np.eye(2) * 0.01)

    current = determination_with(1.0, 2.0)
    assert determination_with(1.2, 2.0).improves_on(current)
    assert not determination_with(1.05, 2.0).improves_on(current), "within its uncertainty"
    assert not determination_with(1.0, 4.0).improves_on(current), "the worst is unchanged"
    assert not current.improves_on(current)
    assert current.improves_on(determination_with(0.0, 2.0))
    assert not determination_with(0.0, 9.0).improves_on(determination_with(0.0, 2.0))


def test_uncertainty_of_the_sd_covers_errors_of_slopes() -> None:
    rng = np.random.default_rng(5)
    true, u = rng.normal(size=(6, 3)), np.abs(rng.normal(size=(6, 3))) * 0.03
    noise = np.diag(rng.uniform(0.5, 2.0, 6)) + 0.2
    names = ["a", "b", "c"]
    exact = determined(names, true, u, noise)
    ratios = []
    for _ in range(300):
        disturbed = determined(names, true + u * rng.normal(size=u.shape), u, noise)
        ratios.append((disturbed.sd_deg - exact.sd_deg) / disturbed.u_sd_deg)
    assert 0.8 < np.sqrt(np.mean(np.square(ratios))) < 1.2


def test_two_motions_require_more_than_one_power() -> None:
    design = three_guides(motion=MOTIONS)
    by_all = network_sensitivities(design, tolerance=1e-3)
    assert by_all.by_voltages is not None
    assert by_all.by_voltages.all_distinguished
    network = design.network.model_copy(
        update={"emitters": design.network.emitters[1:], "receivers": design.network.receivers[1:]}
    )
    by_one = network_sensitivities(design.model_copy(update={"network": network}), tolerance=1e-3)
    assert by_one.by_voltages is not None
    assert by_one.by_voltages.rank == 1
    assert by_one.by_voltages.combinations[1].singular_per_deg == 0.0
    assert any("cannot be measured" in text for text in by_one.warnings)


STRIP = """
schema = 1
name = "strip"
material = { index = 1.44 }
emitter = { width_mm = 0.2 }
body = { kind = "network" }
network.nodes = [{ name = "base" }, { name = "middle" }, { name = "fork" }, { name = "right" }, { name = "left" }]
network.guides = [
    { name = "near", nodes = ["base", "middle"], width_mm = 3.0, direction_deg = 0.0, length_mm = 10 },
    { name = "far", nodes = ["middle", "fork"], width_mm = 3.0, direction_deg = 0.0, length_mm = 2.2 },
    { name = "r", nodes = ["fork", "right"], width_mm = 1.7, flush = "right", length_mm = 2.2, direction_deg = -8.0 },
    { name = "l", nodes = ["fork", "left"], width_mm = 1.7, flush = "left", direction_deg = 8.0, length_mm = 2.2 },
]
network.motion = [
    { name = "near", kind = "bend", part = "near", at_deg = 2.0, from_deg = -6.0, to_deg = 6.0, steps = 4 },
    { name = "far", kind = "bend", part = "far", at_deg = 1.0, from_deg = -6.0, to_deg = 6.0, steps = 4 },
]

[[network.lenses]]
name = "base"
node = "base"

[[network.emitters]]
name = "base"
lens = "base"

[[network.receivers]]
name = "right"
node = "right"
"""
"""Two bending guides, lit at one end and with one receiver at the other, which determines one combination."""


def check_suggestions(text: str, tolerance: float) -> None:
    """The best suggested part, added to the design file, gives the predicted standard deviations."""
    design = with_values(loads(text), {"trace.dimension": "2d"})
    before = network_sensitivities(design, tolerance=tolerance).by_voltages
    suggested = suggestions(design, tolerance)
    best = suggested[0]
    added = with_values(loads(f"{text}\n{best.tables}\n"), {"trace.dimension": "2d"})
    after = network_sensitivities(added, tolerance=tolerance).by_voltages
    assert before is not None
    assert after is not None
    print(f"{design.name}: {before.worst_sd_deg:.3g}°, with {best.part} at {best.place} {after.worst_sd_deg:.3g}°")
    assert best.rank == after.rank >= before.rank
    assert after.sd_deg.tolist() == best.by_voltages.sd_deg.tolist()
    assert after.worst_sd_deg == best.worst_sd_deg < before.worst_sd_deg
    assert [(-suggestion.rank, suggestion.worst_sd_deg) for suggestion in suggested] == sorted(
        (-suggestion.rank, suggestion.worst_sd_deg) for suggestion in suggested
    )


def test_suggested_part_resolves_an_undetermined_combination() -> None:
    check_suggestions(STRIP, 6e-3)


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["hand-860", "strip-860"])
def test_suggested_part_gives_the_predicted_sd(name: str) -> None:
    check_suggestions(template(name), 5e-4)


def test_resolution_agrees_with_the_scatter_of_noisy_voltages() -> None:
    design = with_values(three_guides(motion=MOTIONS[:1]), {"network.motion[0].steps": 2})
    lean = network_volts(design, tolerance=1e-3).by_motion["lean"]
    middle = replace(lean.signals, **{key: getattr(lean.signals, key)[1:2] for key in ("received", "voltage_V")})
    drawn_V = drawn(design, middle, 3000, 11)
    slope = lean.slope_V_per_deg[1]
    assert slope == pytest.approx(np.diff(lean.signals.voltage_V[::2], axis=0)[0] / 16.0)
    assert np.std(drawn_V, axis=0) == pytest.approx(lean.signals.sd_V[1], rel=0.06)
    each = [fitted_motions(drawn_V[:, i], slope[i][:, None]) for i in range(2)]
    expected = (*lean.resolution_deg[1], lean.resolution_of_all_deg[1])
    for sd, angles in zip(
        expected, (*each, fitted_motions(drawn_V.reshape(3000, -1), slope.ravel()[:, None])), strict=True
    ):
        assert np.std(angles) == pytest.approx(sd, rel=0.06)


def test_voltages_of_the_y_as_a_network_are_those_of_the_y() -> None:
    design = Design(name="y", material={"index": 1.44}, emitter={"width_mm": 0.2})
    network = network_volts(y_network(design), tolerance=1e-3)
    rest, sensor = network.at_rest, Sensor.of(design)
    response = sensor.power([0.0], tolerance=1e-4)
    sides = replace(response, right=rest.received[:, 0, 0], left=rest.received[:, 0, 1])  # the same powers
    readings = readings_from(sensor, sides)
    assert rest.voltage_V[:, 0].tolist() == readings.voltage_V.tolist()
    assert rest.sd_V[:, 0].tolist() == readings.sd_V.tolist()
    assert rest.received[0, 0] == pytest.approx([response.right[0], response.left[0]], abs=3e-3)
    assert network.by_motion == {}


def test_motion_without_light_has_no_resolution() -> None:
    dark = with_values(
        three_guides(motion=MOTIONS[:1]), {"material.absorption_per_mm": 40.0, "network.motion[0].steps": 2}
    )
    lean = network_volts(dark, tolerance=1e-3).by_motion["lean"]
    assert np.isnan(lean.resolution_of_all_deg).all()
