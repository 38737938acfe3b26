"""A long guide whose answer is known in closed form, by every way of choosing rays and of following light.

A slab of index 1.44, 100 mm long and 5 mm wide, with a point source 1 mm before the middle of one end, 120 degrees
wide. What enters is guided without loss: of s and p each, (1 − R)/(1 + R) leaves the far end, with R of the first
interface. On a black receiver as wide as the slab and 0.1 mm behind it, 0.914264 arrives; the rest passes beside it.
"""

import math
from typing import Literal

import pytest
from scipy.integrate import quad

from solen.curve import Segment
from solen.scene import Fan, Interface, Scene
from solen.trace import Limits, Mode, trace
from solen.trace.result import Detected
from tests.agreement.scenes_support import AIR, glass

Sampling = Literal["fan", "sobol"]
LENGTH_MM = 100.0
FAR_END, RECEIVED = 0.925572, 0.914264


def guide(rays: int, gap_mm: float | None) -> Scene:
    """The slab with its receiver, or with a screen right behind it that receives all that leaves."""
    corners = [(-2.5, 0.0), (2.5, 0.0), (2.5, LENGTH_MM), (-2.5, LENGTH_MM)]
    ends = zip(corners, [*corners[1:], corners[0]], strict=True)
    faces = [Interface(f"face{i}", Segment(a, b), "glass", "air") for i, (a, b) in enumerate(ends)]
    half_mm, z_mm = (2.5, LENGTH_MM + gap_mm) if gap_mm else (1e5, LENGTH_MM + 1e-3)
    eye = Interface("eye", Segment((half_mm, z_mm), (-half_mm, z_mm)), "air", "air", "receiver", "eye")
    return Scene((AIR, glass(1.44)), (*faces, eye), (Fan((0.0, -1.0), 0.0, 120.0, rays),))


def closed_form() -> float:
    """½ Σ (1 − R)/(1 + R) over s and p, averaged over the fan by quadrature."""

    def passed(angle: float) -> float:
        cos_in, cos_out = math.cos(angle), math.sqrt(1.0 - (math.sin(angle) / 1.44) ** 2)
        s = ((cos_in - 1.44 * cos_out) / (cos_in + 1.44 * cos_out)) ** 2
        p = ((1.44 * cos_in - cos_out) / (1.44 * cos_in + cos_out)) ** 2
        return 0.5 * ((1 - s) / (1 + s) + (1 - p) / (1 + p))

    return float(quad(passed, 0.0, math.radians(60.0))[0]) / math.radians(60.0)


def found(
    rays: int, gap_mm: float | None, mode: Mode, sampling: Sampling, least: float = 1e-6
) -> tuple[Detected, float]:
    """The receiver's reading, and how far it may be off: four standard errors and what was cut off."""
    result = trace(guide(rays, gap_mm), mode, Limits(min_weight=least), sampling=sampling, seed=1)
    assert result.undefined == 0
    assert result.ledger.total == pytest.approx(1.0, abs=1e-9)
    reading = result.detectors["eye"]
    return reading, 4.0 * reading.u + result.ledger.truncated + 1e-6


def test_the_closed_form_is_the_known_number() -> None:
    assert closed_form() == pytest.approx(FAR_END, abs=5e-7)


@pytest.mark.parametrize("sampling", ["fan", "sobol"])
@pytest.mark.parametrize(("mode", "u"), [("power", 3e-4), ("roulette", 6e-3)])
def test_what_leaves_the_far_end_is_that_of_the_closed_form(mode: Mode, u: float, sampling: Sampling) -> None:
    reading, off = found(4096, None, mode, sampling)
    assert reading.power == pytest.approx(FAR_END, abs=off)
    assert reading.u < u


@pytest.mark.parametrize("sampling", ["fan", "sobol"])
@pytest.mark.parametrize(("mode", "u"), [("power", 1.5e-3), ("roulette", 5e-3)])
def test_what_a_receiver_behind_it_gets_is_the_known_number(mode: Mode, u: float, sampling: Sampling) -> None:
    reading, off = found(8192, 0.1, mode, sampling)
    assert reading.power == pytest.approx(RECEIVED, abs=off)
    assert reading.u < u


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
                f"standard error {reading.u:.1e}"
            )
            assert reading.power == pytest.approx(asked, abs=off)
            assert off < (2e-4 if mode == "power" else 2e-3)
