"""A long guide whose answer is known in closed form, by every way of choosing rays and of following light.

A slab of index 1.44, 100 mm long and 5 mm wide, with a point source 1 mm before the middle of one end, 120 degrees
wide. What enters is guided without loss: of s and p each, (1 − R)/(1 + R) leaves the far end, with R of the first
interface. On a black receiver as wide as the slab and 0.1 mm behind it, 0.914264 arrives; the rest passes beside it.
"""

from typing import Literal

import pytest

from solen.trace import Limits, Mode, trace
from solen.trace.result import Detected
from tests.agreement.scenes_support import guide, guided_share

Sampling = Literal["fan", "sobol"]
LENGTH_MM = 100.0
FAR_END, RECEIVED = 0.925572, 0.914264


def found(
    rays: int, gap_mm: float | None, mode: Mode, sampling: Sampling, least: float = 1e-6
) -> tuple[Detected, float]:
    """The receiver's reading, and how far it may be off: four standard errors and what was cut off."""
    result = trace(guide(LENGTH_MM, gap_mm, rays), mode, Limits(min_weight=least), sampling=sampling, seed=1)
    assert result.undefined == 0
    assert result.ledger.total == pytest.approx(1.0, abs=1e-9)
    reading = result.detectors["screen"]
    return reading, 4.0 * reading.u_power + result.ledger.truncated + 1e-6


def test_the_closed_form_is_the_known_number() -> None:
    assert guided_share() == pytest.approx(FAR_END, abs=5e-7)


@pytest.mark.parametrize("sampling", ["fan", "sobol"])
@pytest.mark.parametrize(("mode", "u"), [("power", 3e-4), ("roulette", 6e-3)])
def test_what_leaves_the_far_end_is_that_of_the_closed_form(mode: Mode, u: float, sampling: Sampling) -> None:
    reading, off = found(4096, None, mode, sampling)
    assert reading.power == pytest.approx(FAR_END, abs=off)
    assert reading.u_power < u


@pytest.mark.parametrize("sampling", ["fan", "sobol"])
@pytest.mark.parametrize(("mode", "u"), [("power", 1.5e-3), ("roulette", 5e-3)])
def test_what_a_receiver_behind_it_gets_is_the_known_number(mode: Mode, u: float, sampling: Sampling) -> None:
    reading, off = found(8192, 0.1, mode, sampling)
    assert reading.power == pytest.approx(RECEIVED, abs=off)
    assert reading.u_power < u


@pytest.mark.evidence
@pytest.mark.parametrize(("gap_mm", "asked"), [(None, FAR_END), (0.1, RECEIVED)])
def test_a_million_rays_give_the_known_numbers_whichever_way_they_are_chosen(
    gap_mm: float | None, asked: float
) -> None:
    for mode, rays in (("power", 2**18), ("roulette", 2**20)):
        for sampling in ("fan", "sobol"):
            reading, off = found(rays, gap_mm, mode, sampling)  # type: ignore[arg-type]
            print(
                f"\n  slab, receiver {gap_mm} mm behind it, {mode}, {sampling}: {reading.power:.6f}, asked {asked}, "
                f"standard error {reading.u_power:.1e}"
            )
            assert reading.power == pytest.approx(asked, abs=off)
            assert off < (2e-4 if mode == "power" else 2e-3)
