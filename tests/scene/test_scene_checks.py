"""A scene is checked when it is made: what does not fit is named in one line."""

import math
from typing import Any

import pytest

from solen.curve import Segment
from solen.errors import DesignError
from solen.scene import Fan, Interface, Monitor, Rays, Region, Scene, Source

AIR, GLASS = Region("air", 1.0), Region("glass", 1.5)
FACE = Interface("face", Segment((-1.0, 0.0), (1.0, 0.0)), "glass", "air")
FAN = Fan((0.0, -1.0), 0.0, 60.0, 10)
EYE = Interface("eye", Segment((-1.0, 5.0), (1.0, 5.0)), "air", "air", "receiver", "eye")


def scene(**parts: Any) -> Scene:
    return Scene(**{"regions": (AIR, GLASS), "interfaces": (FACE,), "sources": (FAN,)} | parts)


def refused(**parts: Any) -> str:
    with pytest.raises(DesignError) as refusal:
        scene(**parts)
    line = str(refusal.value)
    assert len(line.splitlines()) == 1
    return line


def test_a_sound_scene_says_what_it_holds() -> None:
    double = Interface("eye-2", Segment((2.0, 5.0), (3.0, 5.0)), "air", "air", "receiver", "eye")
    made = scene(interfaces=(EYE, FACE, double), sources=(FAN, Fan((0.0, 0.0), 0.0, 10.0, 5, power=2.5)))
    assert made.receivers == ("eye",)
    assert made.rays == 15
    assert made.emitted == 3.5
    assert made.name == "scene"


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"regions": (AIR, AIR)}, "scene region = 'air'; the name is taken twice"),
        ({"interfaces": (FACE, FACE)}, "scene interface = 'face'; the name is taken twice"),
        ({"interfaces": (EYE,), "monitors": (Monitor("eye", (0.0, 0.0), (1.0, 0.0)),)}, "'eye'; the name is taken"),
        ({"monitors": (Monitor("m", (0.0, 0.0), (1.0, 0.0)),) * 2}, "scene detector = 'm'"),
        ({"regions": (AIR,)}, "interface face = 'glass'; no such region; there are air"),
        ({"regions": (AIR, Region("glass", 0.99))}, "region glass = 0.99; the index must be finite and at least 1"),
        ({"regions": (AIR, Region("glass", math.nan))}, "region glass = nan"),
        ({"regions": (AIR, Region("glass", math.inf))}, "region glass = inf"),
        ({"regions": (AIR, Region("glass", 1.5, -0.1))}, "region glass = -0.1; the absorption"),
        ({"regions": (AIR, Region("glass", 1.5, math.nan))}, "region glass = nan; the absorption"),
        ({"interfaces": (Interface("i", FACE.curve, "air", "air", "receiver"),)}, "interface i"),
        ({"interfaces": (Interface("i", FACE.curve, "air", "air", "mirror", "eye"),)}, "interface i = 'eye'"),
        ({"sources": ()}, "scene sources = 0; at least one is needed"),
        ({"sources": (Rays((), ()),)}, "source rays = 0; must be a whole number of at least 1"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 0),)}, "source rays = 0; must be a whole number of at least 1"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 3, power=0.0),)}, "source power = 0.0; must be above 0"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 3, power=math.nan),)}, "source = 'nan'; must be a finite number"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 3, power=math.inf),)}, "source = 'inf'; must be a finite number"),
    ],
)
def test_what_does_not_fit_is_named(parts: dict[str, Any], words: str) -> None:
    assert words in refused(**parts)


def test_an_unknown_behaviour_is_refused_with_those_there_are() -> None:
    strange = Interface("i", FACE.curve, "air", "air", "sponge")  # type: ignore[arg-type]
    assert "'sponge'; must be one of refracting, mirror, absorbing, receiver" in refused(interfaces=(strange,))


UNCHECKED: list[tuple[str, Source]] = [
    ("a second source without rays loses its power", Fan((0.0, 0.0), 0.0, 10.0, 0)),
    ("a negative number of rays", Fan((0.0, 0.0), 0.0, 10.0, -1)),
    ("a share of s beyond 1", Fan((0.0, 0.0), 0.0, 10.0, 3, s_share=2.0)),
    ("a place that is no number", Fan((math.nan, 0.0), 0.0, 10.0, 3)),
    ("an axis that is no number", Fan((0.0, 0.0), math.inf, 10.0, 3)),
    ("a cone that is no number", Fan((0.0, 0.0), 0.0, math.nan, 3)),
    ("more origins than directions", Rays(((0.0, 0.0), (1.0, 0.0)), ((0.0, 1.0),))),
    ("more directions than origins", Rays(((0.0, 0.0),), ((0.0, 1.0), (1.0, 0.0)))),
    ("a direction of no length", Rays(((0.0, 0.0),), ((0.0, 0.0),))),
]


@pytest.mark.parametrize("source", [source for _, source in UNCHECKED], ids=[name for name, _ in UNCHECKED])
def test_every_source_is_checked(source: Source) -> None:
    refused(sources=(FAN, source))


@pytest.mark.parametrize(
    "values",
    [
        ((0.0, 0.0), (0.0, 0.0)),
        ((0.0, 0.0), (1.0, 0.0), -1),
        ((0.0, 0.0), (1.0, 0.0), 1.5),
        ((0.0, math.nan), (1.0, 0.0)),
        ((0.0, 0.0), (math.inf, 0.0)),
        ((0.0,), (1.0, 0.0)),
    ],
)
def test_every_monitor_is_checked(values: Any) -> None:
    with pytest.raises(DesignError, match="monitor m"):
        Monitor("m", *values)


@pytest.mark.parametrize("ends", [((-1.0, 0.0), (1.0, 0.0)), ((0.5, 0.0), (-0.5, 0.0)), ((0.9, 0.0), (5.0, 0.0))])
def test_a_monitor_along_an_interface_is_refused_with_both_names(ends: Any) -> None:
    line = refused(monitors=(Monitor("m", *ends),))
    assert "monitor m = 'lies on interface face'; must lie off every interface" in line


@pytest.mark.parametrize(
    "ends",
    [
        ((-1.0, 1e-6), (1.0, 1e-6)),
        ((0.0, -1.0), (0.0, 1.0)),
        ((-1.0, -1e-3), (1.0, 1e-3)),
        ((1.0, 0.0), (2.0, 0.0)),
        ((1.5, 0.0), (2.0, 0.0)),
    ],
)
def test_a_monitor_beside_across_or_behind_an_interface_stands(ends: Any) -> None:
    assert scene(monitors=(Monitor("m", *ends),)).monitors[0].start == ends[0]


