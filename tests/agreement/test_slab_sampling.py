"""A long guide with a closed-form solution, for all sampling methods and modes.

The guide is a slab of index 1.44, 100 mm long and 5 mm wide, with a point source of 120 degrees 1 mm in front of the
middle of one end. Light that enters is guided without loss: the fraction (1 − R)/(1 + R) of s and of p leaves the far
end, where R is the reflectance of the first interface. A receiver as wide as the slab and 0.1 mm behind it detects
0.914264 of the light; the rest passes beside it.
"""

from typing import Literal

import pytest

from solen.trace import Limits, Mode, trace
from solen.trace.result import Detected
from tests.agreement.scenes_support import guide, guided_fraction

Sampling = Literal["fan", "sobol"]
LENGTH_MM = 100.0
FAR_END, RECEIVED = 0.925572, 0.914264


def reading_of(rays: int, gap_mm: float | None, mode: Mode, sampling: Sampling) -> tuple[Detected, float]:
    """Return the reading of the receiver and its maximum error: four standard errors and the truncated light."""
    result = trace(guide(LENGTH_MM, gap_mm, rays), mode, Limits(min_weight=1e-6), sampling=sampling, seed=1)
    assert result.undefined == 0
    assert result.ledger.total == pytest.approx(1.0, abs=1e-9)
    reading = result.detectors["screen"]
    return reading, 4.0 * reading.u_power + result.ledger.truncated + 1e-6


def test_closed_form_has_the_known_value() -> None:
    assert guided_fraction() == pytest.approx(FAR_END, abs=5e-7)


@pytest.mark.parametrize("sampling", ["fan", "sobol"])
@pytest.mark.parametrize(("mode", "u"), [("power", 3e-4), ("roulette", 6e-3)])
def test_light_from_the_far_end(mode: Mode, u: float, sampling: Sampling) -> None:
    reading, error = reading_of(4096, None, mode, sampling)
    assert reading.power == pytest.approx(FAR_END, abs=error)
    assert reading.u_power < u


@pytest.mark.parametrize("sampling", ["fan", "sobol"])
@pytest.mark.parametrize(("mode", "u"), [("power", 1.5e-3), ("roulette", 5e-3)])
def test_light_on_a_receiver_behind_a_gap(mode: Mode, u: float, sampling: Sampling) -> None:
    reading, error = reading_of(8192, 0.1, mode, sampling)
    assert reading.power == pytest.approx(RECEIVED, abs=error)
    assert reading.u_power < u


@pytest.mark.evidence
@pytest.mark.parametrize(("gap_mm", "expected"), [(None, FAR_END), (0.1, RECEIVED)])
def test_a_million_rays(gap_mm: float | None, expected: float) -> None:
    for mode, rays in (("power", 2**18), ("roulette", 2**20)):
        for sampling in ("fan", "sobol"):
            reading, error = reading_of(rays, gap_mm, mode, sampling)  # type: ignore[arg-type]
            print(
                f"\n  slab, receiver {gap_mm} mm behind it, {mode}, {sampling}: {reading.power:.6f}, "
                f"expected {expected}, standard error {reading.u_power:.1e}"
            )
            assert reading.power == pytest.approx(expected, abs=error)
            assert error < (2e-4 if mode == "power" else 2e-3)
