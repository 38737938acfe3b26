"""What readings of a network determine of its motions, against noisy readings drawn and fitted."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solen.readout import volts
from solen.sensor import Sensor
from solen.sensor.network import NetworkSensitivities, network_sensitivities
from solen.sensor.network.motions import Determination, determined, in_words
from solen.sensor.network.places import suggestions
from solen.sensor.network.readings import readings_of
from solen.sensor.network.signals import Signals, circuits_of
from solen.sensor.network.volts import network_volts
from solen.sensor.readings import readings_from
from solen.spec import Design, loads, template, with_values
from tests.geometry.network_support import READINGS, WAYS, three_guides, y_network


def estimates(design: Design, found: NetworkSensitivities, draws: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Estimates (draws, motions) from all voltages, and from the readings, of noisy voltages with the motions at 0.

    Motions follow by least squares, weighted by the scatter of the draws themselves.
    """
    assert found.signals is not None
    seen, received, slope_V = (
        drawn(design, found.signals, draws, seed),
        found.signals.received[0],
        found.signals.slope_V[0],
    )
    powers = received + (seen - (found.signals.voltage_V[0] - found.signals.off_V)) / slope_V
    readings = readings_of(design.network, powers, np.zeros_like(powers))[0]
    jacobian_V = (found.slope * slope_V).reshape(len(found.keys), -1).T
    rows = ((seen.reshape(draws, -1), jacobian_V), (readings, found.reading_slope.T))
    first, second = (fitted(values, jacobian) for values, jacobian in rows)
    return first, second


def drawn(design: Design, signals: Signals, draws: int, seed: int) -> np.ndarray:
    """Noisy readings (draws, emitters, receivers) in the first state of signals: on less the off readings around it.

    Every emitter's turn is a sample with it on and one with all off, drawn and quantised.
    """
    rng = np.random.default_rng(seed)
    circuits = circuits_of(design)
    every = zip(circuits, signals.received[0], strict=True)
    on = [volts(np.tile(row, (draws, 1)), one, rng=rng) for one, row in every]
    off = [volts(np.zeros_like(on[0]), circuits[0], rng=rng) for _ in range(len(on) + 1)]
    return np.stack([one - 0.5 * (off[i] + off[i + 1]) for i, one in enumerate(on)], axis=1)


def fitted(values: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Motions (draws, M) by generalised least squares of values (draws, N)."""
    weight = np.linalg.pinv(np.cov(values, rowvar=False))
    solved = np.linalg.solve(jacobian.T @ weight @ jacobian, jacobian.T @ weight)
    return np.asarray((values - values.mean(axis=0)) @ solved.T)


def check_scatter(design: Design, draws: int) -> None:
    found = network_sensitivities(design, tolerance=1e-3)
    for stated, fits in zip((found.by_voltages, found.by_readings), estimates(design, found, draws, 7), strict=True):
        assert stated is not None
        off = np.std(fits, axis=0) / stated.sd_deg - 1.0
        print(f"{design.name}: sd of {draws} fits over the stated one less 1: {np.round(off, 4).tolist()}")
        assert np.abs(off).max() < 4.0 / math.sqrt(2.0 * draws) + 0.01
        correlation = np.corrcoef(fits, rowvar=False)[0, 1]
        variance = np.diag(stated.covariance_deg2)
        assert correlation == pytest.approx(
            stated.covariance_deg2[0, 1] / math.sqrt(variance[0] * variance[1]), abs=0.1
        )


def test_noisy_readings_give_the_motions_to_the_stated_sd() -> None:
    check_scatter(three_guides(motion=WAYS, reading=READINGS), 3000)


RATIOS = {
    "hand-860": ["(index.palm-right - index.palm-left) / index.thumb", "ring.palm-left / ring.thumb"],
    "robot-860": ["head.back-right / head.back-left", "tail.front-right / tail.front-left"],
}


@pytest.mark.evidence
@pytest.mark.parametrize("name", RATIOS)
@pytest.mark.parametrize("circuit", [{}, {"readout.samples": 16, "readout.emitter_current_ma": 0.5}])
def test_shipped_networks_give_their_motions_to_the_stated_sd(name: str, circuit: dict[str, Any]) -> None:
    reading = [{"name": text, "value": text} for text in RATIOS[name]]
    values = {"trace.dimension": "2d", "network.reading": reading} | circuit
    check_scatter(with_values(loads(template(name)), values), 20000)


def of(slope: list[list[float]], u: float = 1e-3, noise: float = 0.1) -> Determination:
    jacobian = np.array(slope)
    names = ["index", "ring", "thumb"][: jacobian.shape[1]]
    return determined(names, jacobian, np.full(jacobian.shape, u), noise**2 * np.eye(len(jacobian)))


def test_motions_that_change_readings_alike_are_named_with_what_is_left() -> None:
    alike = of([[1.0, 1.0], [2.0, 2.0]])
    assert alike.rank == 1
    assert np.isinf(alike.sd_deg).all()
    (text,) = in_words(alike)  # the sum s changes the readings by s·(1, 2): sd 0.1/√5
    assert "index and ring change the readings in the same way: only their sum" in text
    assert "± 0.045°" in text
    assert "only their difference" in next(in_words(of([[1.0, -1.0], [2.0, -2.0]])))
    assert "only ring + 0.5 index can be measured, to ± 0.022°" in next(in_words(of([[1.0, 2.0], [2.0, 4.0]])))


def test_a_motion_apart_from_those_not_distinguished_keeps_its_sd() -> None:
    found = of([[1.0, 1.0, 0.0], [0.0, 0.0, 4.0], [1.0, 1.0, 0.0]])
    assert np.isinf(found.sd_deg).tolist() == [True, True, False]
    assert found.sd_deg[2] == pytest.approx(0.1 / 4.0)
    assert found.worst_sd_deg == math.inf
    assert "thumb changes the readings by no more" in next(in_words(of([[1.0, 0.0, 0.0], [0.0, 4.0, 0.0]])))
    assert "only 1 combination can" in next(in_words(of([[1.0, 2.0, 3.0]])))


def test_an_improvement_is_more_than_its_uncertainty() -> None:
    def seen(*slopes: float) -> Determination:
        jacobian = np.diag(slopes)
        return determined(["a", "b"], jacobian, 0.05 * jacobian, np.eye(2) * 0.01)

    now = seen(1.0, 2.0)
    assert seen(1.2, 2.0).improves_on(now)
    assert not seen(1.05, 2.0).improves_on(now), "within its uncertainty"
    assert not seen(1.0, 4.0).improves_on(now), "the worst is as before"
    assert not now.improves_on(now)
    assert now.improves_on(seen(0.0, 2.0))
    assert not seen(0.0, 9.0).improves_on(seen(0.0, 2.0))


def test_the_uncertainty_of_an_sd_covers_slopes_that_are_off() -> None:
    rng = np.random.default_rng(5)
    true, u = rng.normal(size=(6, 3)), np.abs(rng.normal(size=(6, 3))) * 0.03
    noise = np.diag(rng.uniform(0.5, 2.0, 6)) + 0.2
    names = ["a", "b", "c"]
    exact = determined(names, true, u, noise)
    away = []
    for _ in range(300):
        one = determined(names, true + u * rng.normal(size=u.shape), u, noise)
        away.append((one.sd_deg - exact.sd_deg) / one.u_sd_deg)
    assert 0.8 < np.sqrt(np.mean(np.square(away))) < 1.2


def test_one_power_does_not_distinguish_two_motions_and_more_do() -> None:
    two = three_guides(motion=WAYS)
    several = network_sensitivities(two, tolerance=1e-3)
    assert several.by_voltages is not None
    assert several.by_voltages.all_distinguished
    network = two.network.model_copy(
        update={"emitters": two.network.emitters[1:], "receivers": two.network.receivers[1:]}
    )
    one = network_sensitivities(two.model_copy(update={"network": network}), tolerance=1e-3)
    assert one.by_voltages is not None
    assert one.by_voltages.rank == 1
    assert one.by_voltages.combinations[1].singular_per_deg == 0.0
    assert any("cannot be measured" in text for text in one.warnings)


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
"""Two lengths that bend, lit at one end, with one receiver at the other: one combination is seen."""


def check_suggestions(text: str, tolerance: float) -> None:
    """The best suggested receiver, added to the design file, gives the standard deviations that were predicted."""
    design = with_values(loads(text), {"trace.dimension": "2d"})
    before = network_sensitivities(design, tolerance=tolerance).by_voltages
    tried = suggestions(design, tolerance)
    best = tried[0]
    added = with_values(loads(f"{text}\n{best.tables}\n"), {"trace.dimension": "2d"})
    after = network_sensitivities(added, tolerance=tolerance).by_voltages
    assert before is not None
    assert after is not None
    print(f"{design.name}: {before.worst_sd_deg:.3g}°, with {best.part} at {best.place} {after.worst_sd_deg:.3g}°")
    assert best.rank == after.rank >= before.rank
    assert after.sd_deg.tolist() == best.by_voltages.sd_deg.tolist()
    assert after.worst_sd_deg == best.worst_sd_deg < before.worst_sd_deg
    assert [(-one.rank, one.worst_sd_deg) for one in tried] == sorted((-one.rank, one.worst_sd_deg) for one in tried)


def test_the_suggested_part_lifts_a_singular_arrangement_as_predicted() -> None:
    check_suggestions(STRIP, 2e-3)


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["hand-860", "strip-860"])
def test_the_suggested_part_gives_the_predicted_sd(name: str) -> None:
    check_suggestions(template(name), 5e-4)


def test_volts_of_a_network_resolve_a_motion_to_what_noisy_readings_scatter_by() -> None:
    design = with_values(three_guides(motion=WAYS[:1]), {"network.motion[0].steps": 2})
    lean = network_volts(design, tolerance=1e-3).by_motion["lean"]
    middle = replace(lean.signals, **{key: getattr(lean.signals, key)[1:2] for key in ("received", "voltage_V")})
    seen = drawn(design, middle, 3000, 11)
    slope = lean.slope_V_per_deg[1]
    assert slope == pytest.approx(np.diff(lean.signals.voltage_V[::2], axis=0)[0] / 16.0)
    assert np.std(seen, axis=0) == pytest.approx(lean.signals.sd_V[1], rel=0.06)
    each = [fitted(seen[:, i], slope[i][:, None]) for i in range(2)]
    stated = (*lean.resolution_deg[1], lean.resolution_of_all_deg[1])
    for sd, angles in zip(stated, (*each, fitted(seen.reshape(3000, -1), slope.ravel()[:, None])), strict=True):
        assert np.std(angles) == pytest.approx(sd, rel=0.06)


def test_volts_of_the_y_as_a_network_are_those_of_the_y() -> None:
    design = Design(name="y", material={"index": 1.44}, emitter={"width_mm": 0.2})
    network = network_volts(y_network(design), tolerance=1e-3)
    rest, own = network.at_rest, Sensor.of(design)
    response = own.power([0.0], tolerance=1e-4)
    sides = replace(response, right=rest.received[:, 0, 0], left=rest.received[:, 0, 1])  # the same light
    found = readings_from(own, sides)
    assert rest.voltage_V[:, 0].tolist() == found.voltage_V.tolist()
    assert rest.sd_V[:, 0].tolist() == found.sd_V.tolist()
    assert rest.received[0, 0] == pytest.approx([response.right[0], response.left[0]], abs=3e-3)
    assert network.by_motion == {}


def test_a_motion_that_nothing_shows_has_no_resolution() -> None:
    dark = with_values(
        three_guides(motion=WAYS[:1]), {"material.absorption_per_mm": 40.0, "network.motion[0].steps": 2}
    )
    lean = network_volts(dark, tolerance=1e-3).by_motion["lean"]
    assert np.isnan(lean.resolution_of_all_deg).all()
