"""Error against rays: the reference is the closed form, and every way to choose rays comes to it."""

import dataclasses
import math

import numpy as np
import pytest

from solen.curve import Segment
from solen.errors import DesignError
from solen.scene import Beam, Chip, Fan, Interface, Rays, Region, Scene, Source
from solen.trace import Limits, Mode, convergence, integrate
from solen.trace.convergence import MIN_RAYS, TIGHT

CONE_DEG = 60.0
SHARES = {
    "left": math.degrees(math.atan(0.3)) / CONE_DEG,
    "right": math.degrees(math.atan(0.2)) / CONE_DEG,
}
"""What two receivers see, 1 mm before a point source: from the axis to −0.3 mm, and to 0.2 mm."""
MOST = 2**12
REACH = 1e-10
"""Curves reach 1e-11 mm beyond their ends, which is seen from 1 mm away."""


def scene(*sources: Source) -> Scene:
    ends = {"left": (0.0, -0.3), "right": (0.2, 0.0)}
    faces = tuple(
        Interface(name, Segment((a, 1.0), (b, 1.0)), "air", "air", "receiver", name) for name, (a, b) in ends.items()
    )
    return Scene((Region("air", 1.0),), faces, sources)


FAN = Fan((0.0, 0.0), 0.0, CONE_DEG, 7)


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
def test_every_way_comes_to_the_closed_form(mode: Mode) -> None:
    found = convergence(scene(FAN), mode, most_rays=MOST)
    assert found.mode == mode
    assert (found.reference.method, found.reference.u_power <= TIGHT) == ("adaptive", True)
    for name, share in SHARES.items():
        assert found.reference.detectors[name].power == pytest.approx(share, abs=REACH)
    assert [series.method for series in found.series] == ["fan", "sobol", "adaptive"]
    fan, sobol, adaptive = found.series
    powers_of_two = [2**k for k in range(int(math.log2(MIN_RAYS)), int(math.log2(MOST)) + 1)]
    assert list(fan.rays) == list(sobol.rays) == powers_of_two
    assert (fan.error <= 1.0 / fan.rays + TIGHT).all()  # one ray at each of two jumps, at most half of it lost
    assert (sobol.error <= 4.0 / sobol.rays**0.5).all()
    assert sobol.error[-1] < 2e-3
    assert (adaptive.error <= adaptive.u_power + TIGHT).all()
    assert adaptive.error[-1] < 1e-9
    assert np.isfinite(np.concatenate([fan.u_power, sobol.u_power, adaptive.u_power])).all()


@pytest.mark.parametrize("many", [1, 2, 3, 5])
def test_no_number_of_rays_comes_twice(many: int) -> None:
    """Samples round the rays of each source up to sixteen."""
    for series in convergence(scene(*[FAN] * many), "count", most_rays=256).series:
        assert (np.diff(series.rays) > 0).all(), series.method


def test_errors_are_the_largest_of_any_receiver() -> None:
    found = convergence(scene(FAN), "count", most_rays=16)
    (error,) = found.series[0].error
    angles = CONE_DEG * ((np.arange(16) + 0.5) / 16 - 0.5)
    x = -np.tan(np.radians(angles))
    counted = {"left": float(np.mean((x > -0.3) & (x < 0.0))), "right": float(np.mean((x > 0.0) & (x < 0.2)))}
    assert error == pytest.approx(max(abs(counted[name] - share) for name, share in SHARES.items()), abs=REACH)


def test_what_cannot_be_integrated_is_held_to_a_denser_fan() -> None:
    """A beam has no angle to integrate over."""
    found = convergence(scene(Beam((0.4, 0.0), (-0.6, 0.0), 0.0, 5)), most_rays=MOST)
    assert (found.reference.method, found.reference.rays) == ("fan", 4 * MOST)
    assert [series.method for series in found.series] == ["fan", "sobol"]
    for name, share in (("left", 0.3), ("right", 0.2)):
        assert found.reference.detectors[name].power == pytest.approx(share, abs=1e-3)


@pytest.mark.parametrize(
    "sources", [(Chip((0.0, 0.0), 0.01, 0.0, CONE_DEG, 5),), (FAN, dataclasses.replace(FAN, power=2.0))], ids=str
)
def test_chips_and_several_sources_are_integrated(sources: tuple[Source, ...]) -> None:
    found = convergence(scene(*sources), most_rays=MOST)
    assert (found.reference.method, found.reference.u_power <= TIGHT) == ("adaptive", True)
    assert [series.method for series in found.series] == ["fan", "sobol", "adaptive"]
    for name, share in SHARES.items():  # a chip of 0.01 mm sees hardly another picture
        assert found.reference.detectors[name].power == pytest.approx(share, abs=1e-3)


def test_a_scene_without_receivers_is_refused() -> None:
    wall = Interface("wall", Segment((1.0, 1.0), (-1.0, 1.0)), "air", "air", "absorbing")
    with pytest.raises(DesignError, match="no receiver"):
        convergence(dataclasses.replace(scene(FAN), interfaces=(wall,)))


def test_light_that_is_cut_off_leaves_the_integral_short_of_its_tolerance() -> None:
    """All light stops at one of its first two faces, and whatever is held to account says so."""
    block = [(-1.0, 0.2), (1.0, 0.2), (1.0, 0.6), (-1.0, 0.6)]
    sides = tuple(
        Interface(f"side {i}", Segment(a, b), "glass", "air")
        for i, (a, b) in enumerate(zip(block, [*block[1:], block[0]], strict=True))
    )
    one = scene(FAN)
    glass = dataclasses.replace(one, regions=(*one.regions, Region("glass", 1.5)), interfaces=(*sides, *one.interfaces))
    assert convergence(glass, "count", most_rays=16).reference.method == "adaptive"
    cut = convergence(glass, "count", limits=Limits(max_hits=2), most_rays=16)
    assert cut.reference.ledger.truncated > 0.5
    assert integrate(glass, "count", 1e-3, Limits(max_hits=2)).u_power > 0.5


@pytest.mark.parametrize(
    ("sources", "most_rays", "word"),
    [
        ((Rays(((0.0, 0.0),), ((0.0, 1.0),)),), 16, "a list of rays"),
        ((FAN,), 15, "most_rays = 15"),
        ((FAN,), 0, "most_rays = 0"),
    ],
)
def test_what_has_no_convergence_is_refused(sources: tuple[Source, ...], most_rays: int, word: str) -> None:
    with pytest.raises(DesignError, match=word):
        convergence(scene(*sources), most_rays=most_rays)


def test_an_unknown_mode_is_refused() -> None:
    with pytest.raises(DesignError, match="must be one of count, power, roulette"):
        convergence(scene(FAN), "bogus")  # type: ignore[arg-type]


def test_the_same_seed_gives_the_same_numbers() -> None:
    beam = Beam((-0.5, 0.0), (0.5, 0.0), 0.0, 3)
    one, same, other = (convergence(scene(beam), most_rays=64, seed=seed).series[1] for seed in (1, 1, 2))
    assert (one.error == same.error).all()
    assert (one.error != other.error).any()
