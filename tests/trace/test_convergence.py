"""Convergence of all methods to the closed form."""

import dataclasses
import math

import numpy as np
import pytest

from solen.curve import Segment
from solen.errors import DesignError
from solen.scene import Beam, Chip, Fan, Interface, Rays, Region, Scene, Source
from solen.trace import Limits, Mode, convergence, integrate
from solen.trace.convergence import MIN_RAYS, REFERENCE_TOLERANCE

CONE_DEG = 60.0
FRACTIONS = {
    "left": math.degrees(math.atan(0.3)) / CONE_DEG,
    "right": math.degrees(math.atan(0.2)) / CONE_DEG,
}
"""Fractions on two receivers 1 mm in front of a point, from the axis to −0.3 mm and to 0.2 mm."""
MAX_RAYS = 2**12
EXTENSION = 1e-10
"""Error because curves extend 1e-11 mm beyond their ends."""


def scene(*sources: Source) -> Scene:
    ends = {"left": (0.0, -0.3), "right": (0.2, 0.0)}
    faces = tuple(
        Interface(name, Segment((a, 1.0), (b, 1.0)), "air", "air", "receiver", name) for name, (a, b) in ends.items()
    )
    return Scene((Region("air", 1.0),), faces, sources)


FAN = Fan((0.0, 0.0), 0.0, CONE_DEG, 7)


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
def test_all_methods_converge_to_the_closed_form(mode: Mode) -> None:
    result = convergence(scene(FAN), mode, max_rays=MAX_RAYS)
    assert result.mode == mode
    assert (result.reference.method, result.reference.u_power <= REFERENCE_TOLERANCE) == ("adaptive", True)
    for name, fraction in FRACTIONS.items():
        assert result.reference.detectors[name].power == pytest.approx(fraction, abs=EXTENSION)
    assert [series.method for series in result.series] == ["fan", "sobol", "adaptive"]
    fan, sobol, adaptive = result.series
    powers_of_two = [2**k for k in range(int(math.log2(MIN_RAYS)), int(math.log2(MAX_RAYS)) + 1)]
    assert list(fan.rays) == list(sobol.rays) == powers_of_two
    assert (fan.error <= 1.0 / fan.rays + REFERENCE_TOLERANCE).all()  # half a ray at each of two jumps
    assert (sobol.error <= 4.0 / sobol.rays**0.5).all()
    assert sobol.error[-1] < 2e-3
    assert (adaptive.error <= adaptive.u_power + REFERENCE_TOLERANCE).all()
    assert adaptive.error[-1] < 1e-9
    assert np.isfinite(np.concatenate([fan.u_power, sobol.u_power, adaptive.u_power])).all()


@pytest.mark.parametrize("sources", [1, 2, 3, 5])
def test_ray_counts_increase(sources: int) -> None:
    """Samples round the number of rays of each source up to a multiple of sixteen."""
    for series in convergence(scene(*[FAN] * sources), "count", max_rays=256).series:
        assert (np.diff(series.rays) > 0).all(), series.method


def test_error_is_the_largest_of_all_receivers() -> None:
    result = convergence(scene(FAN), "count", max_rays=16)
    (error,) = result.series[0].error
    angles = CONE_DEG * ((np.arange(16) + 0.5) / 16 - 0.5)
    x = -np.tan(np.radians(angles))
    counted = {"left": float(np.mean((x > -0.3) & (x < 0.0))), "right": float(np.mean((x > 0.0) & (x < 0.2)))}
    assert error == pytest.approx(
        max(abs(counted[name] - fraction) for name, fraction in FRACTIONS.items()), abs=EXTENSION
    )


def test_reference_is_a_denser_fan_if_the_scene_cannot_be_integrated() -> None:
    """A beam has no angle over which to integrate."""
    result = convergence(scene(Beam((0.4, 0.0), (-0.6, 0.0), 0.0, 5)), max_rays=MAX_RAYS)
    assert (result.reference.method, result.reference.rays) == ("fan", 4 * MAX_RAYS)
    assert [series.method for series in result.series] == ["fan", "sobol"]
    for name, fraction in (("left", 0.3), ("right", 0.2)):
        assert result.reference.detectors[name].power == pytest.approx(fraction, abs=1e-3)


@pytest.mark.parametrize(
    "sources", [(Chip((0.0, 0.0), 0.01, 0.0, CONE_DEG, 5),), (FAN, dataclasses.replace(FAN, power=2.0))], ids=str
)
def test_chips_and_several_sources_are_integrated(sources: tuple[Source, ...]) -> None:
    result = convergence(scene(*sources), max_rays=MAX_RAYS)
    assert (result.reference.method, result.reference.u_power <= REFERENCE_TOLERANCE) == ("adaptive", True)
    assert [series.method for series in result.series] == ["fan", "sobol", "adaptive"]
    for name, fraction in FRACTIONS.items():  # that of a chip of 0.01 mm is almost the same
        assert result.reference.detectors[name].power == pytest.approx(fraction, abs=1e-3)


def test_refuses_scene_without_receiver() -> None:
    wall = Interface("wall", Segment((1.0, 1.0), (-1.0, 1.0)), "air", "air", "absorbing")
    with pytest.raises(DesignError, match="receiver"):
        convergence(dataclasses.replace(scene(FAN), interfaces=(wall,)))


def test_integral_of_truncated_light_does_not_reach_its_tolerance() -> None:
    """Most light is truncated at one of the first two faces."""
    block = [(-1.0, 0.2), (1.0, 0.2), (1.0, 0.6), (-1.0, 0.6)]
    sides = tuple(
        Interface(f"side {i}", Segment(a, b), "glass", "air")
        for i, (a, b) in enumerate(zip(block, [*block[1:], block[0]], strict=True))
    )
    air = scene(FAN)
    glass = dataclasses.replace(air, regions=(*air.regions, Region("glass", 1.5)), interfaces=(*sides, *air.interfaces))
    assert convergence(glass, "count", max_rays=16).reference.method == "adaptive"
    truncated = convergence(glass, "count", limits=Limits(max_hits=2), max_rays=16)
    assert truncated.reference.ledger.truncated > 0.5
    assert integrate(glass, "count", 1e-3, Limits(max_hits=2)).u_power > 0.5


@pytest.mark.parametrize(
    ("sources", "max_rays", "message"),
    [
        ((Rays(((0.0, 0.0),), ((0.0, 1.0),)),), 16, "a list of rays"),
        ((FAN,), 15, "max_rays = 15"),
        ((FAN,), 0, "max_rays = 0"),
    ],
)
def test_refuses_lists_of_rays_and_few_rays(sources: tuple[Source, ...], max_rays: int, message: str) -> None:
    with pytest.raises(DesignError, match=message):
        convergence(scene(*sources), max_rays=max_rays)


def test_refuses_unknown_mode() -> None:
    with pytest.raises(DesignError, match="must be one of count, power, roulette"):
        convergence(scene(FAN), "bogus")  # type: ignore[arg-type]


def test_result_depends_on_seed() -> None:
    beam = Beam((-0.5, 0.0), (0.5, 0.0), 0.0, 3)
    first, repeated, other = (convergence(scene(beam), max_rays=64, seed=seed).series[1] for seed in (1, 1, 2))
    assert (first.error == repeated.error).all()
    assert (first.error != other.error).any()
