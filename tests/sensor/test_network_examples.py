"""The template networks distinguish their motions, and a network with too few readings does not."""

from typing import Any

import numpy as np
import pytest

from solen.sensor.network import network_response, network_study
from solen.sensor.network.slopes import network_sensitivities
from solen.spec import loads, template, with_values

PLANE: dict[str, Any] = {"trace.dimension": "2d"}


@pytest.mark.evidence
@pytest.mark.parametrize(("name", "combinations"), [("hand-860", 2), ("robot-860", 2), ("strip-860", 3)])
def test_template_network_distinguishes_its_motions(name: str, combinations: int) -> None:
    for values in ({}, PLANE):
        determination = network_sensitivities(with_values(loads(template(name)), values)).by_voltages
        assert determination is not None
        print(
            name,
            values,
            [
                (combination.singular_per_deg, combination.u_singular_per_deg)
                for combination in determination.combinations
            ],
        )
        assert determination.rank == combinations
        assert determination.all_distinguished


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("name", "reading", "motion", "other_motion"),
    [
        ("hand-860", "index finger", "index-bends", "ring-bends"),
        ("hand-860", "ring finger", "ring-bends", "index-bends"),
        ("robot-860", "neck", "neck-bends", "trunk-bends"),
        ("robot-860", "trunk", "trunk-bends", "neck-bends"),
    ],
)
def test_reading_of_a_template_follows_its_motion(name: str, reading: str, motion: str, other_motion: str) -> None:
    study = network_study(with_values(loads(template(name)), PLANE), tolerance=1e-3)
    index = study.at_rest.readings.index(reading)
    own_span, other_span = (float(np.ptp(study.sweeps[motion].reading[:, index])) for motion in (motion, other_motion))
    print(name, reading, own_span, other_span)
    assert own_span > 3.0 * other_span


@pytest.mark.evidence
def test_strip_with_one_emitter_and_receiver_distinguishes_one_bend() -> None:
    strip = with_values(loads(template("strip-860")), PLANE)
    network = strip.network.model_dump(exclude_defaults=True)
    parts = {
        "lenses": network["lenses"][:1],
        "emitters": network["emitters"][:1],
        "receivers": network["receivers"][:1],
    }
    by_one = network_sensitivities(with_values(strip, {"network": network | parts}), tolerance=1e-3).by_voltages
    by_all = network_sensitivities(strip).by_voltages
    assert by_one is not None
    assert by_all is not None
    assert (by_one.rank, by_all.rank) == (1, 3)


@pytest.mark.evidence
def test_hand_in_625_states_of_two_bends() -> None:
    hand = with_values(loads(template("hand-860")), PLANE)
    angles = np.linspace(-12.0, 12.0, 25).tolist()
    states = [{"index-bends": index, "ring-bends": ring} for index in angles for ring in angles]
    response = network_response(hand, states, tolerance=1e-3)
    print(f"625 states, 3 emitters, 6 receivers: u {response.u_power.max():.1e}")
    assert response.power.shape == (625, 3, 6)
    assert response.u_power.max() <= 1e-3
