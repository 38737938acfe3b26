"""Checks on construction of a scene, each with an error message of one line."""

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


def test_scene_lists_its_receivers_rays_and_power() -> None:
    double = Interface("eye-2", Segment((2.0, 5.0), (3.0, 5.0)), "air", "air", "receiver", "eye")
    built = scene(interfaces=(EYE, *PRISM, double), sources=(FAN, Fan((0.0, 0.0), 0.0, 10.0, 5, power=2.5)))
    assert built.receivers == ("eye",)
    assert built.rays == 15
    assert built.emitted == 3.5
    assert built.name == "scene"


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"regions": (AIR, AIR)}, "scene region = 'air'; must be unique"),
        ({"interfaces": (FACE, FACE)}, "scene interface = 'face'; must be unique"),
        ({"interfaces": (EYE,), "monitors": (Monitor("eye", (0.0, 0.0), (1.0, 0.0)),)}, "'eye'; must be unique"),
        ({"monitors": (Monitor("m", (0.0, 0.0), (1.0, 0.0)),) * 2}, "scene detector = 'm'"),
        ({"regions": (AIR,)}, "interface face = 'glass'; must be a region: air"),
        ({"regions": (AIR, Region("glass", 0.99))}, "region glass index = 0.99; must be at least 1"),
        ({"regions": (AIR, Region("glass", math.nan))}, "region glass index = 'nan'"),
        ({"regions": (AIR, Region("glass", math.inf))}, "region glass index = 'inf'"),
        ({"regions": (AIR, Region("glass", 1.5, -0.1))}, "region glass absorption_per_mm = -0.1"),
        ({"regions": (AIR, Region("glass", 1.5, math.nan))}, "region glass absorption_per_mm = 'nan'"),
        ({"interfaces": (Interface("i", FACE.curve, "air", "air", "receiver"),)}, "interface i"),
        ({"interfaces": (Interface("i", FACE.curve, "air", "air", "mirror", "eye"),)}, "interface i receiver = 'eye'"),
        ({"sources": ()}, "scene sources = 0; a scene requires at least one source"),
        ({"sources": (Rays((), ()),)}, "source rays = 0; must be an integer of at least 1"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 0),)}, "source rays = 0; must be an integer of at least 1"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 3, power=0.0),)}, "source power = 0.0; must be from 1e-12 to 1e+12"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 3, power=math.nan),)}, "source = 'nan'; must be a finite number"),
        ({"sources": (Fan((0.0, 0.0), 0.0, 10.0, 3, power=math.inf),)}, "source = 'inf'; must be a finite number"),
    ],
)
def test_refuses_inconsistent_scene(parts: dict[str, Any], message: str) -> None:
    assert message in refused(**parts)


def test_refuses_unknown_behaviour() -> None:
    unknown = Interface("i", FACE.curve, "air", "air", "sponge")  # type: ignore[arg-type]
    assert "'sponge'; must be one of refracting, mirror, absorbing, receiver" in refused(interfaces=(unknown,))


INVALID_SOURCES: list[tuple[str, Source]] = [
    ("no rays", Fan((0.0, 0.0), 0.0, 10.0, 0)),
    ("negative rays", Fan((0.0, 0.0), 0.0, 10.0, -1)),
    ("s_share above 1", Fan((0.0, 0.0), 0.0, 10.0, 3, s_share=2.0)),
    ("nan position", Fan((math.nan, 0.0), 0.0, 10.0, 3)),
    ("infinite axis", Fan((0.0, 0.0), math.inf, 10.0, 3)),
    ("nan cone", Fan((0.0, 0.0), 0.0, math.nan, 3)),
    ("more origins than directions", Rays(((0.0, 0.0), (1.0, 0.0)), ((0.0, 1.0),))),
    ("more directions than origins", Rays(((0.0, 0.0),), ((0.0, 1.0), (1.0, 0.0)))),
    ("zero direction", Rays(((0.0, 0.0),), ((0.0, 0.0),))),
    ("three coordinates", Fan((0.0, 0.0, 0.0), 0.0, 10.0, 3)),  # type: ignore[arg-type]
    ("negative cone", Fan((0.0, 0.0), 0.0, -1.0, 3)),
    ("cone above 360", Fan((0.0, 0.0), 0.0, 360.001, 3)),
    ("fractional rays", Fan((0.0, 0.0), 0.0, 10.0, 1.5)),  # type: ignore[arg-type]
    ("nan rays", Fan((0.0, 0.0), 0.0, 10.0, math.nan)),  # type: ignore[arg-type]
    ("infinite rays", Fan((0.0, 0.0), 0.0, 10.0, math.inf)),  # type: ignore[arg-type]
    ("beam without rays", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 0)),
    ("beam with fractional rays", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 2.5)),  # type: ignore[arg-type]
    ("beam without power", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 3, power=0.0)),
    ("beam with negative power", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 3, power=-1.0)),
    ("beam with negative s_share", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 3, s_share=-0.1)),
    ("beam with nan s_share", Beam((0.0, 0.0), (1.0, 0.0), 0.0, 3, s_share=math.nan)),
    ("beam with nan start", Beam((math.nan, 0.0), (1.0, 0.0), 0.0, 3)),
    ("beam with infinite end", Beam((0.0, 0.0), (math.inf, 0.0), 0.0, 3)),
    ("beam start with one coordinate", Beam((0.0,), (1.0, 0.0), 0.0, 3)),  # type: ignore[arg-type]
    ("beam with nan direction", Beam((0.0, 0.0), (1.0, 0.0), math.nan, 3)),
    ("empty list of rays", Rays((), ())),
    ("rays without power", Rays(((0.0, 0.0),), ((0.0, 1.0),), power=0.0)),
    ("rays with infinite power", Rays(((0.0, 0.0),), ((0.0, 1.0),), power=math.inf)),
    ("rays with s_share above 1", Rays(((0.0, 0.0),), ((0.0, 1.0),), s_share=1.1)),
    ("ray with nan origin", Rays(((0.0, math.nan),), ((0.0, 1.0),))),
    ("ray with infinite direction", Rays(((0.0, 0.0),), ((math.inf, 1.0),))),
    ("ray origin with one coordinate", Rays(((0.0,),), ((0.0, 1.0),))),  # type: ignore[arg-type]
    ("chip without rays", Chip((0.0, 0.0), 1.0, 0.0, 60.0, 0)),
    ("chip with fractional rays", Chip((0.0, 0.0), 1.0, 0.0, 60.0, 2.5)),  # type: ignore[arg-type]
    ("chip without power", Chip((0.0, 0.0), 1.0, 0.0, 60.0, 3, power=0.0)),
    ("chip with s_share above 1", Chip((0.0, 0.0), 1.0, 0.0, 60.0, 3, s_share=1.5)),
    ("chip with nan position", Chip((0.0, math.nan), 1.0, 0.0, 60.0, 3)),
    ("chip with three coordinates", Chip((0.0, 0.0, 0.0), 1.0, 0.0, 60.0, 3)),  # type: ignore[arg-type]
    ("chip with negative width", Chip((0.0, 0.0), -1e-9, 0.0, 60.0, 3)),
    ("chip with nan width", Chip((0.0, 0.0), math.nan, 0.0, 60.0, 3)),
    ("chip with infinite width", Chip((0.0, 0.0), math.inf, 0.0, 60.0, 3)),
    ("chip with infinite axis", Chip((0.0, 0.0), 1.0, math.inf, 60.0, 3)),
    ("chip with negative cone", Chip((0.0, 0.0), 1.0, 0.0, -1.0, 3)),
    ("chip with cone above 360", Chip((0.0, 0.0), 1.0, 0.0, 361.0, 3)),
    ("chip with nan cone", Chip((0.0, 0.0), 1.0, 0.0, math.nan, 3)),
    ("ambient light with zero radius", Ambient((0.0, 0.0), 0.0, 3)),
    ("ambient light with nan radius", Ambient((0.0, 0.0), math.nan, 3)),
    ("ambient light with nan centre", Ambient((0.0, math.nan), 1.0, 3)),
    ("ambient light with negative height", Ambient((0.0, 0.0), 1.0, 3, -1.0)),
    ("ray file with nan position", RayFile(str(FILE), (0.0, math.nan), 0.0, 3)),
    ("ray file with nan axis", RayFile(str(FILE), (0.0, 0.0), math.nan, 3)),
    ("ray file without power", RayFile(str(FILE), (0.0, 0.0), 0.0, 3, power=0.0)),
    ("emitter without rays", Emitter((0.0, 0.0), 0.0, 0)),
    ("emitter without power", Emitter((0.0, 0.0), 0.0, 3, power=0.0)),
    ("emitter with nan position", Emitter((0.0, math.nan), 0.0, 3)),
    ("emitter with nan height", Emitter((0.0, 0.0), 0.0, 3, y_mm=math.nan)),
    ("emitter with infinite axis", Emitter((0.0, 0.0), math.inf, 3)),
    ("emitter with negative width", Emitter((0.0, 0.0), 0.0, 3, width_mm=-1e-9)),
    ("emitter with negative height", Emitter((0.0, 0.0), 0.0, 3, height_mm=-1e-9)),
    ("emitter with cone above 360", Emitter((0.0, 0.0), 0.0, 3, cone_deg=361.0)),
]


@pytest.mark.parametrize("source", [source for _, source in INVALID_SOURCES], ids=[name for name, _ in INVALID_SOURCES])
def test_refuses_invalid_source(source: Source) -> None:
    refused(sources=(FAN, source))
    with pytest.raises(DesignError):
        source.check()


def test_invalid_sources_cover_every_kind() -> None:
    assert {type(source) for _, source in INVALID_SOURCES} == set(SOURCES.values())


@pytest.mark.parametrize(
    "source",
    [
        FAN,
        Fan((0.0, 0.0), 1e9, 0.0, 1),
        Fan((0.0, 0.0), -720.0, 360.0, 1, power=1e-12, s_share=0.0),
        Beam((0.0, 0.0), (0.0, 0.0), 0.0, 2),  # all rays from one point
        Beam((0.0, 0.0), (1.0, 0.0), -3.0, 1, power=1e12, s_share=1.0),
        Rays(((0.0, 0.0), (0.0, 0.0)), ((0.0, 1e-300), (1e300, 0.0))),
        Chip((0.0, 0.0), 0.0, 400.0, 0.0, 1),  # without width, a fan
        Chip((0.0, 0.0), 1e3, -90.0, 360.0, 5, power=1e12, s_share=1.0),
        Chip((0.0, 0.0), 0.3, 0.0, 120.0, 5, spectrum=((860.0, 1e-300),)),
        Fan((0.0, 0.0), 0.0, 60.0, 5, spectrum=((860.0, 1.0), (1e-3, 1e300), (860.0, 2.0))),
    ],
)
def test_accepts_valid_source(source: Source) -> None:
    source.check()
    assert scene(sources=(source,)).rays == source.rays
    launch = source.launch()
    assert [math.hypot(*direction) for direction in zip(launch.dx, launch.dz, strict=True)] == pytest.approx(
        [1.0] * source.rays, abs=1e-15
    )


def test_refuses_or_traces_float_ray_count() -> None:
    """A float that is an integer must not pass the check and then end the trace with a TypeError."""
    source = Fan((0.0, 0.0), 0.0, 10.0, 10.0)  # type: ignore[arg-type]
    try:
        built = scene(sources=(source,))
    except DesignError:
        return
    assert trace(built).rays == 10


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
def test_refuses_invalid_monitor(values: Any) -> None:
    with pytest.raises(DesignError, match="monitor m"):
        Monitor("m", *values)


@pytest.mark.parametrize("ends", [((-1.0, 0.0), (1.0, 0.0)), ((0.5, 0.0), (-0.5, 0.0)), ((0.9, 0.0), (5.0, 0.0))])
def test_refuses_monitor_that_overlaps_interface(ends: Any) -> None:
    line = refused(monitors=(Monitor("m", *ends),))
    assert "monitor m; must not overlap an interface, but lies on face" in line


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
def test_accepts_monitor_that_crosses_or_misses_interface(ends: Any) -> None:
    assert scene(monitors=(Monitor("m", *ends),)).monitors[0].start == ends[0]


@pytest.mark.parametrize(
    ("spectrum", "message"),
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
def test_refuses_invalid_spectrum(kind: str, spectrum: Any, message: str) -> None:
    sources: dict[str, Source] = {
        "fan": FAN,
        "chip": Chip((0.0, -1.0), 0.1, 0.0, 60.0, 10),
        "emitter": Emitter((0.0, -1.0), 0.0, 10),
        "ambient": Ambient((0.0, 0.0), 5.0, 10),
        "ray-file": RayFile(str(FILE), (0.0, -1.0), 0.0, 3),
        "beam": Beam((0.0, -1.0), (1.0, -1.0), 0.0, 10),
        "rays": Rays(((0.0, -1.0),), ((0.0, 1.0),)),
    }
    wrong = dataclasses.replace(sources[kind], spectrum=spectrum)
    assert message in refused(sources=(wrong,))


RED = dataclasses.replace(FAN, spectrum=((620.0, 1.0), (860.0, 2.0)))
RESIN = Cauchy(A=1.5, B_um2=0.004)


def test_scene_lists_wavelengths_of_all_sources() -> None:
    assert scene().wavelengths_nm == ()
    other = dataclasses.replace(FAN, spectrum=((940.0, 3.0), (620.0, 1.0)))
    assert scene(sources=(RED, other)).wavelengths_nm == (620.0, 860.0, 940.0)
    assert scene(sources=(RED,)).wavelengths_nm == (620.0, 860.0)  # with constant indices too


@pytest.mark.parametrize("sources", [(FAN, RED), (RED, FAN), (RED, FAN, RED)])
def test_refuses_spectra_for_only_some_sources(sources: tuple[Source, ...]) -> None:
    line = refused(sources=sources)
    assert f"source spectrum; is missing in 1 of {len(sources)} sources" in line


def test_dispersive_index_requires_spectrum() -> None:
    line = refused(regions=(AIR, Region("glass", RESIN)))
    assert "region glass index; depends on the wavelength, so every source requires a spectrum" in line
    assert "specify a spectrum for the sources, or a constant index for the region" in line
    assert scene(regions=(AIR, Region("glass", RESIN)), sources=(RED,)).regions[1].index == RESIN


@pytest.mark.parametrize(
    ("index", "message"),
    [
        (Cauchy(A=1.5, valid_nm=(700.0, 900.0)), "index at 620 nm; is known only from 700 to 900 nm"),
        (
            Tabulated(wavelength_nm=(500.0, 859.9), n=(1.6, 1.5)),
            "index at 860 nm; is known only from 500 to 859.9 nm",
        ),
        (Cauchy(A=0.5), "index at 620 nm = 0.5; must be finite and at least 1"),
        (Sellmeier(B=(1.0,), C_um2=(0.62**2,)), "index at 620 nm = nan; must be finite and at least 1"),
    ],
)
def test_refuses_index_that_is_invalid_at_a_wavelength(index: Dispersion, message: str) -> None:
    with pytest.raises(DataError) as refusal:
        scene(regions=(AIR, Region("glass", index)), sources=(RED,))
    assert message in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


def test_region_returns_index_at_wavelength() -> None:
    assert Region("glass", 1.5).index_at(None) == Region("glass", 1.5).index_at(860.0) == 1.5
    assert Region("glass", RESIN).index_at(500.0) == pytest.approx(1.5 + 0.004 / 0.25, abs=1e-15)
    with pytest.raises(DesignError, match="region glass"):
        Region("glass", RESIN).index_at(None)
