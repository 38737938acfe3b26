"""The shipped networks tell their motions apart, and one with too few readings does not."""

import time
from typing import Any

import numpy as np
import pytest

from solen.sensor.network import network_response, network_study
from solen.sensor.network.slopes import network_sensitivities
from solen.spec import loads, template, with_values

PLANE: dict[str, Any] = {"trace.dimension": "2d"}


@pytest.mark.evidence
@pytest.mark.parametrize(("name", "combinations"), [("hand-860", 2), ("robot-860", 2), ("strip-860", 3)])
def test_a_shipped_network_tells_its_motions(name: str, combinations: int) -> None:
    for values in ({}, PLANE):
        found = network_sensitivities(with_values(loads(template(name)), values)).by_voltages
        assert found is not None
        print(name, values, [(one.singular_per_deg, one.u_singular_per_deg) for one in found.combinations])
        assert found.rank == combinations
        assert found.all_distinguished


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("name", "reading", "by", "other"),
    [
        ("hand-860", "index finger", "index-bends", "ring-bends"),
        ("hand-860", "ring finger", "ring-bends", "index-bends"),
        ("robot-860", "neck", "neck-bends", "trunk-bends"),
        ("robot-860", "trunk", "trunk-bends", "neck-bends"),
    ],
)
def test_a_shipped_reading_follows_its_motion(name: str, reading: str, by: str, other: str) -> None:
    study = network_study(with_values(loads(template(name)), PLANE), tolerance=1e-3)
    place = study.at_rest.readings.index(reading)
    own, beside = (float(np.ptp(study.sweeps[motion].reading[:, place])) for motion in (by, other))
    print(name, reading, own, beside)
    assert own > 3.0 * beside


@pytest.mark.evidence
def test_a_strip_lit_from_one_end_with_one_receiver_tells_one_bend() -> None:
    strip = with_values(loads(template("strip-860")), PLANE)
    ends = strip.network.model_dump(exclude_defaults=True)
    one = {"lenses": ends["lenses"][:1], "emitters": ends["emitters"][:1], "receivers": ends["receivers"][:1]}
    few = network_sensitivities(with_values(strip, {"network": ends | one}), tolerance=1e-3).by_voltages
    both = network_sensitivities(strip).by_voltages
    assert few is not None
    assert both is not None
    assert (few.rank, both.rank) == (1, 3)


@pytest.mark.evidence
def test_the_hand_in_625_states_of_two_bends() -> None:
    hand = with_values(loads(template("hand-860")), PLANE)
    angles = np.linspace(-12.0, 12.0, 25).tolist()
    states = [{"index-bends": index, "ring-bends": ring} for index in angles for ring in angles]
    network_response(hand, states[:1], tolerance=1e-3)  # compiles
    before = time.process_time()
    found = network_response(hand, states, tolerance=1e-3)
    print(
        f"625 states, 3 emitters, 6 receivers: {time.process_time() - before:.0f} s of CPU, u {found.u_power.max():.1e}"
    )
    assert found.power.shape == (625, 3, 6)
    assert found.u_power.max() <= 1e-3
