"""A scene is checked when it is made: what does not fit is named in one line."""

import dataclasses
import math
import tempfile
from pathlib import Path
from typing import Any

import pytest

from solen.curve import Segment
from solen.errors import DataError, DesignError
from solen.material import Cauchy, Dispersion, Sellmeier, Tabulated
from solen.scene import Ambient, Beam, Chip, Emitter, Fan, Interface, Monitor, RayFile, Rays, Region, Scene, Source
from solen.scene.json import SOURCES
from solen.trace import trace
from tests.scene.rayfile_support import lambertian, zemax

AIR, GLASS = Region("air", 1.0), Region("glass", 1.5)
FACE = Interface("face", Segment((-1.0, 0.0), (1.0, 0.0)), "glass", "air")
PRISM = (
    FACE,
    Interface("right", Segment((1.0, 0.0), (0.0, 1.0)), "glass", "air"),
    Interface("left", Segment((0.0, 1.0), (-1.0, 0.0)), "glass", "air"),
)
FAN = Fan((0.0, -1.0), 0.0, 60.0, 10)
FILE = zemax(Path(tempfile.mkdtemp()) / "rays.sdf", lambertian(3))
EYE = Interface("eye", Segment((-1.0, 5.0), (1.0, 5.0)), "air", "air", "receiver", "eye")


def scene(**parts: Any) -> Scene:
    return Scene(**{"regions": (AIR, GLASS), "interfaces": PRISM, "sources": (FAN,)} | parts)


def refused(**parts: Any) -> str:
    with pytest.raises(DesignError) as refusal:
        scene(**parts)
    line = str(refusal.value)
    assert len(line.splitlines()) == 1
    return line


def test_a_sound_scene_says_what_it_holds() -> None:
    double = Interface("eye-2", Segment((2.0, 5.0), (3.0, 5.0)), "air", "air", "receiver", "eye")
    made = scene(interfaces=(EYE, *PRISM, double), sources=(FAN, Fan((0.0, 0.0), 0.0, 10.0, 5, power=2.5)))
    assert made.receivers == ("eye",)
    assert made.rays == 15
    assert made.emitted == 3.5
    assert made.name == "scene"


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"regions": (AIR, AIR)}, "scene region = 'air'; must be unique"),
        ({"interfaces": (FACE, FACE)}, "scene interface = 'face'; must be unique"),
        ({"interfaces": (EYE,), "monitors": (Monitor("eye", (0.0, 0.0), (1.0, 0.0)),)}, "'eye'; must be unique"),
        ({"monitors": (Monitor("m", (0.0, 0.0), (1.0, 0.0)),) * 2}, "scene detector = 'm'"),
        ({"regions": (AIR,)}, "interface face = 'glass'; there is no such region, only air"),
        ({"regions": (AIR, Region("glass", 0.99))}, "region glass index = 0.99; must be at least 1"),
        ({"regions": (AIR, Region("glass", math.nan))}, "region glass index = 'nan'"),
        ({"regions": (AIR, Region("glass", math.inf))}, "region glass index = 'inf'"),
        ({"regions": (AIR, Region("glass", 1.5, -0.1))}, "region glass absorption_per_mm = -0.1"),
        ({"regions": (AIR, Region("glass", 1.5, math.nan))}, "region glass absorption_per_mm = 'nan'"),
        ({"interfaces": (Interface("i", FACE.curve, "air", "air", "receiver"),)}, "interface i"),
        ({"interfaces": (Interface("i", FACE.curve, "air", "air", "mirror", "eye"),)}, "interface i = 'eye'"),
        ({"sources": ()}, "scene sources = 0; a scene requires at least one source"),
        ({"sources": (Rays((), ()),)}, "source rays = 0; must be a whole number of at least 1"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 0),)}, "source rays = 0; must be a whole number of at least 1"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 3, power=0.0),)}, "source power = 0.0; must be from 1e-12 to 1e+12"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 3, power=math.nan),)}, "source = 'nan'; must be a finite number"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 3, power=math.inf),)}, "source = 'inf'; must be a finite number"),
    ],
)
def test_what_does_not_fit_is_named(parts: dict[str, Any], words: str) -> None:
    assert words in refused(**parts)


def test_an_unknown_behaviour_is_refused_with_those_there_are() -> None:
    strange = Interface("i", FACE.curve, "air", "air", "sponge")  # type: ignore[arg-type]
    assert "'sponge'; must be one of refracting, mirror, absorbing, receiver" in refused(interfaces=(strange,))


REFUSED: list[tuple[str, Source]] = [
    ("no rays", Fan((0.0, 0.0), 0.0, 10.0, 0)),
    ("a negative number of rays", Fan((0.0, 0.0), 0.0, 10.0, -1)),
    ("a share of s beyond 1", Fan((0.0, 0.0), 0.0, 10.0, 3, s_share=2.0)),
    ("a place that is no number", Fan((math.nan, 0.0), 0.0, 10.0, 3)),
    ("an axis that is no number", Fan((0.0, 0.0), math.inf, 10.0, 3)),
    ("a cone that is no number", Fan((0.0, 0.0), 0.0, math.nan, 3)),
    ("more origins than directions", Rays(((0.0, 0.0), (1.0, 0.0)), ((0.0, 1.0),))),
    ("more directions than origins", Rays(((0.0, 0.0),), ((0.0, 1.0), (1.0, 0.0)))),
    ("a direction of no length", Rays(((0.0, 0.0),), ((0.0, 0.0),))),
    ("a place in space", Fan((0.0, 0.0, 0.0), 0.0, 10.0, 3)),  # type: ignore[arg-type]
    ("a cone below nothing", Fan((0.0, 0.0), 0.0, -1.0, 3)),
    ("a cone beyond the full circle", Fan((0.0, 0.0), 0.0, 360.001, 3)),
    ("half a ray", Fan((0.0, 0.0), 0.0, 10.0, 1.5)),  # type: ignore[arg-type]
    ("rays that are no number", Fan((0.0, 0.0), 0.0, 10.0, math.nan)),  # type: ignore[arg-type]
    ("rays without end", Fan((0.0, 0.0), 0.0, 10.0, math.inf)),  # type: ignore[arg-type]
    ("a beam without rays", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 0)),
    ("a beam of half a ray", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 2.5)),  # type: ignore[arg-type]
    ("a beam without power", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 3, power=0.0)),
    ("a beam of negative power", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 3, power=-1.0)),
    ("a beam's share of s below nothing", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 3, s_share=-0.1)),
    ("a beam's share of s that is no number", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 3, s_share=math.nan)),
    ("a beam from no number", Beam((math.nan, 0.0), (1.0, 0.0), 0.0, 3)),
    ("a beam to infinity", Beam((0.0, 0.0), (math.inf, 0.0), 0.0, 3)),
    ("a beam from one number", Beam((0.0,), (1.0, 0.0), 0.0, 3)),  # type: ignore[arg-type]
    ("a beam towards no number", Beam((0.0, 0.0), (1.0, 0.0), math.nan, 3)),
    ("no single ray", Rays((), ())),
    ("rays of no power", Rays(((0.0, 0.0),), ((0.0, 1.0),), power=0.0)),
    ("rays of infinite power", Rays(((0.0, 0.0),), ((0.0, 1.0),), power=math.inf)),
    ("rays' share of s beyond 1", Rays(((0.0, 0.0),), ((0.0, 1.0),), s_share=1.1)),
    ("a ray from no number", Rays(((0.0, math.nan),), ((0.0, 1.0),))),
    ("a ray towards no number", Rays(((0.0, 0.0),), ((math.inf, 1.0),))),
    ("a ray from one number", Rays(((0.0,),), ((0.0, 1.0),))),  # type: ignore[arg-type]
    ("a chip without rays", Chip((0.0, 0.0), 1.0, 0.0, 60.0, 0)),
    ("a chip of half a ray", Chip((0.0, 0.0), 1.0, 0.0, 60.0, 2.5)),  # type: ignore[arg-type]
    ("a chip without power", Chip((0.0, 0.0), 1.0, 0.0, 60.0, 3, power=0.0)),
    ("a chip's share of s beyond 1", Chip((0.0, 0.0), 1.0, 0.0, 60.0, 3, s_share=1.5)),
    ("a chip at no number", Chip((0.0, math.nan), 1.0, 0.0, 60.0, 3)),
    ("a chip in space", Chip((0.0, 0.0, 0.0), 1.0, 0.0, 60.0, 3)),  # type: ignore[arg-type]
    ("a chip narrower than nothing", Chip((0.0, 0.0), -1e-9, 0.0, 60.0, 3)),
    ("a chip of no number's width", Chip((0.0, 0.0), math.nan, 0.0, 60.0, 3)),
    ("a chip without end", Chip((0.0, 0.0), math.inf, 0.0, 60.0, 3)),
    ("a chip towards no number", Chip((0.0, 0.0), 1.0, math.inf, 60.0, 3)),
    ("a chip's cone below nothing", Chip((0.0, 0.0), 1.0, 0.0, -1.0, 3)),
    ("a chip's cone beyond the full circle", Chip((0.0, 0.0), 1.0, 0.0, 361.0, 3)),
    ("a chip's cone that is no number", Chip((0.0, 0.0), 1.0, 0.0, math.nan, 3)),
    ("ambient light through nothing", Ambient((0.0, 0.0), 0.0, 3)),
    ("ambient light through no number", Ambient((0.0, 0.0), math.nan, 3)),
    ("ambient light about no number", Ambient((0.0, math.nan), 1.0, 3)),
    ("ambient light lower than nothing", Ambient((0.0, 0.0), 1.0, 3, -1.0)),
    ("rays of a file at no number", RayFile(str(FILE), (0.0, math.nan), 0.0, 3)),
    ("rays of a file towards no number", RayFile(str(FILE), (0.0, 0.0), math.nan, 3)),
    ("rays of a file without power", RayFile(str(FILE), (0.0, 0.0), 0.0, 3, power=0.0)),
    ("an emitter without rays", Emitter((0.0, 0.0), 0.0, 0)),
    ("an emitter without power", Emitter((0.0, 0.0), 0.0, 3, power=0.0)),
    ("an emitter at no number", Emitter((0.0, math.nan), 0.0, 3)),
    ("an emitter at no height", Emitter((0.0, 0.0), 0.0, 3, y_mm=math.nan)),
    ("an emitter towards no number", Emitter((0.0, 0.0), math.inf, 3)),
    ("an emitter narrower than nothing", Emitter((0.0, 0.0), 0.0, 3, width_mm=-1e-9)),
    ("an emitter lower than nothing", Emitter((0.0, 0.0), 0.0, 3, height_mm=-1e-9)),
    ("an emitter of more than all directions", Emitter((0.0, 0.0), 0.0, 3, cone_deg=361.0)),
]


@pytest.mark.parametrize("source", [source for _, source in REFUSED], ids=[name for name, _ in REFUSED])
def test_every_source_is_checked(source: Source) -> None:
    refused(sources=(FAN, source))
    with pytest.raises(DesignError):
        source.check()


def test_sources_of_every_kind_are_among_the_refused() -> None:
    assert {type(source) for _, source in REFUSED} == set(SOURCES.values())


@pytest.mark.parametrize(
    "source",
    [
        FAN,
        Fan((0.0, 0.0), 1e9, 0.0, 1),
        Fan((0.0, 0.0), -720.0, 360.0, 1, power=1e-12, s_share=0.0),
        Beam((0.0, 0.0), (0.0, 0.0), 0.0, 2),  # all rays from one place: a thin beam
        Beam((0.0, 0.0), (1.0, 0.0), -3.0, 1, power=1e12, s_share=1.0),
        Rays(((0.0, 0.0), (0.0, 0.0)), ((0.0, 1e-300), (1e300, 0.0))),
        Chip((0.0, 0.0), 0.0, 400.0, 0.0, 1),  # of no width: a fan
        Chip((0.0, 0.0), 1e3, -90.0, 360.0, 5, power=1e12, s_share=1.0),
        Chip((0.0, 0.0), 0.3, 0.0, 120.0, 5, spectrum=((860.0, 1e-300),)),
        Fan((0.0, 0.0), 0.0, 60.0, 5, spectrum=((860.0, 1.0), (1e-3, 1e300), (860.0, 2.0))),
    ],
)
def test_a_sound_source_passes(source: Source) -> None:
    source.check()
    assert scene(sources=(source,)).rays == source.rays
    launch = source.launch()
    assert [math.hypot(*direction) for direction in zip(launch.dx, launch.dz, strict=True)] == pytest.approx(
        [1.0] * source.rays, abs=1e-15
    )


def test_a_number_of_rays_is_refused_or_traced() -> None:
    """A whole number that is a float must not pass the check and then end the trace in a TypeError."""
    source = Fan((0.0, 0.0), 0.0, 10.0, 10.0)  # type: ignore[arg-type]
    try:
        made = scene(sources=(source,))
    except DesignError:
        return
    assert trace(made).rays == 10


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
    assert "monitor m = 'lies on interface face'; a monitor must not overlap any interface" in line


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


@pytest.mark.parametrize(
    ("spectrum", "words"),
    [
        (((0.0, 1.0),), "source spectrum = (0.0, 1.0); wavelengths and weights must be above 0"),
        (((860.0, 0.0),), "source spectrum = (860.0, 0.0); wavelengths and weights must be above 0"),
        (((860.0, 1.0), (-620.0, 1.0)), "source spectrum = (-620.0, 1.0)"),
        (((860.0, -1.0),), "source spectrum = (860.0, -1.0)"),
        (((860.0, math.nan),), "source spectrum = 'nan'; must be a finite number"),
        (((math.inf, 1.0),), "source spectrum = 'inf'; must be a finite number"),
        ((("red", 1.0),), "source spectrum = \"'red'\"; must be a finite number"),
        ((860.0, 1.0), "source spectrum = '860.0'; must be pairs (wavelength in nm, weight)"),
        (((860.0,),), "source spectrum = '(860.0,)'; must be pairs"),
        (((860.0, 1.0, 2.0),), "source spectrum = '(860.0, 1.0, 2.0)'; must be pairs"),
        (([860.0, 1.0],), "source spectrum = '[860.0, 1.0]'; must be pairs"),
    ],
)
@pytest.mark.parametrize("kind", SOURCES)
def test_a_spectrum_is_of_wavelengths_and_weights_above_0(kind: str, spectrum: Any, words: str) -> None:
    sound: dict[str, Source] = {
        "fan": FAN,
        "chip": Chip((0.0, -1.0), 0.1, 0.0, 60.0, 10),
        "emitter": Emitter((0.0, -1.0), 0.0, 10),
        "ambient": Ambient((0.0, 0.0), 5.0, 10),
        "ray-file": RayFile(str(FILE), (0.0, -1.0), 0.0, 3),
        "beam": Beam((0.0, -1.0), (1.0, -1.0), 0.0, 10),
        "rays": Rays(((0.0, -1.0),), ((0.0, 1.0),)),
    }
    wrong = dataclasses.replace(sound[kind], spectrum=spectrum)
    assert words in refused(sources=(wrong,))


RED = dataclasses.replace(FAN, spectrum=((620.0, 1.0), (860.0, 2.0)))
RESIN = Cauchy(A=1.5, B_um2=0.004)


def test_a_scene_knows_its_wavelengths() -> None:
    assert scene().wavelengths_nm == ()
    other = dataclasses.replace(FAN, spectrum=((940.0, 3.0), (620.0, 1.0)))
    assert scene(sources=(RED, other)).wavelengths_nm == (620.0, 860.0, 940.0)
    assert scene(sources=(RED,)).wavelengths_nm == (620.0, 860.0)  # of numbers as indices too


@pytest.mark.parametrize("sources", [(FAN, RED), (RED, FAN), (RED, FAN, RED)])
def test_all_sources_have_a_spectrum_or_none_has(sources: tuple[Source, ...]) -> None:
    line = refused(sources=sources)
    assert f"source spectrum = 'missing in 1 of {len(sources)}'; either all sources" in line


def test_an_index_that_depends_on_the_wavelength_needs_one() -> None:
    line = refused(regions=(AIR, Region("glass", RESIN)))
    assert "region glass = 'depends on the wavelength'; every source requires a spectrum" in line
    assert "specify a spectrum for the sources, or a constant index for the region" in line
    assert scene(regions=(AIR, Region("glass", RESIN)), sources=(RED,)).regions[1].index == RESIN


@pytest.mark.parametrize(
    ("index", "words"),
    [
        (Cauchy(A=1.5, valid_nm=(700.0, 900.0)), "index at 620 nm; it is known only from 700 to 900 nm"),
        (
            Tabulated(wavelength_nm=(500.0, 859.9), n=(1.6, 1.5)),
            "index at 860 nm; it is known only from 500 to 859.9 nm",
        ),
        (Cauchy(A=0.5), "index at 620 nm = 0.5; must be finite and at least 1"),
        (Sellmeier(B=(1.0,), C_um2=(0.62**2,)), "index at 620 nm = nan; must be finite and at least 1"),
    ],
)
def test_every_region_has_an_index_at_every_wavelength(index: Dispersion, words: str) -> None:
    with pytest.raises(DataError) as refusal:
        scene(regions=(AIR, Region("glass", index)), sources=(RED,))
    assert words in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


def test_a_region_has_its_index_at_a_wavelength() -> None:
    assert Region("glass", 1.5).index_at(None) == Region("glass", 1.5).index_at(860.0) == 1.5
    assert Region("glass", RESIN).index_at(500.0) == pytest.approx(1.5 + 0.004 / 0.25, abs=1e-15)
    with pytest.raises(DesignError, match="region glass"):
        Region("glass", RESIN).index_at(None)
