"""Scenes of the simulator ray-optics, read from its files, give the readings recorded by its own tests.

Its tests require |a − e| / (|e| + 1e-3) ≤ 1e-3 in every bin, for computed a and recorded e. Rays are traced as it
traces them, in turns and with its rule for weak branches, and curves given by formulas are its polylines. The
agreement is 1e-9, due to rounding after many surfaces, and this is required here.
"""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from solen.cli import run_command
from solen.scene import dumps, loads, rayoptics
from solen.trace import RoundRobin, trace, trace_round_robin
from tests.outside.ray_optics_support import SceneFile, angle_source, beam, load, point_source

TOLERANCE, MAX_DEVIATION = 1e-3, 1e-9
WITH_GRATING = ("blocker/Blocker/filter", "mirror/BeamSplitter/filter-invert", "mirror/Mirror/filter")
"""Scenes with gratings that emit twice the incident power, which only the rule of ray-optics reproduces."""
SCENES = (
    *("blocker/Aperture/default", "blocker/Blocker/color", "blocker/CircleBlocker/default"),
    *("glass/CircleGlass/equiv_merge", "glass/CurveGlass/equiv_param", "glass/CustomGlass/equiv_circle"),
    *("glass/Glass/equiv_hole", "glass/Glass/equiv_nonsimple", "glass/Glass/partialReflect_off", "glass/Glass/weak"),
    *("glass/IdealLens/negative", "glass/ParamGlass/equiv_circle", "glass/PlaneGlass/cauchy"),
    *("glass/SphericalLens/equiv_plano_convex", "lightSource/AngleSource/correctBrightness"),
    *("lightSource/AngleSource/symmetric", "lightSource/Beam/brightness", "lightSource/Beam/emisAngle"),
    *("lightSource/Beam/lambert_random", "lightSource/Beam/wavelength", "lightSource/PointSource/brightness"),
    *("lightSource/PointSource/wavelength", "lightSource/SingleRay/brightness", "mirror/ArcMirror/colinear"),
    *("mirror/BeamSplitter/color", "mirror/BeamSplitter/truncate_correctBrightness", "mirror/CustomMirror/default"),
    *("mirror/CustomMirror/equiv_zigzag", "mirror/IdealMirror/negative", "mirror/Mirror/color"),
    *("mirror/ParabolicMirror/colinear", "mirror/ParabolicMirror/parallel", "mirror/ParamMirror/equiv_arc"),
    *WITH_GRATING,
)


def scene_path(outside: Path, name: str) -> Path:
    return outside / "raytrace" / "ray-optics_scenes" / f"{name}.json"


def recorded(outside: Path, name: str) -> NDArray[np.float64]:
    """Return recorded positions and irradiances (2, bins)."""
    with scene_path(outside, name).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return np.array([[float(row["Position"]), float(row["Irradiance"])] for row in rows]).T


def deviation(irradiance: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    assert irradiance.shape == expected.shape
    return float((np.abs(irradiance - expected) / (np.abs(expected) + TOLERANCE)).max())


@pytest.mark.parametrize("name", SCENES)
def test_readings_agree_with_recorded_ones(
    name: str, outside: Path, record_property: Callable[[str, object], None]
) -> None:
    imported = rayoptics.load(scene_path(outside, name), facets=True)
    assert imported.not_understood == ()
    result = trace_round_robin(imported.scene, RoundRobin(imported.weak, imported.weakest, imported.fresh))
    assert result.undefined == 0, result.undefined_at_mm
    assert abs(result.ledger.total - 1.0) < 1e-12
    (reading,) = imported.readings(result.monitors).values()
    assert reading.position is not None
    assert reading.irradiance is not None
    position, irradiance = recorded(outside, name)
    max_deviation = deviation(reading.irradiance, irradiance)
    record_property("deviation", max_deviation)
    print(f"{name}: {max_deviation:.1e}")
    np.testing.assert_allclose(reading.position, position, rtol=1e-12)
    assert max_deviation <= MAX_DEVIATION


def test_all_scene_files_are_tested(outside: Path) -> None:
    folder = outside / "raytrace" / "ray-optics_scenes"
    names = {str(path.relative_to(folder).with_suffix("").as_posix()) for path in folder.rglob("*.json")}
    assert len(names) == 36
    assert names == set(SCENES)


def test_command_reads_ray_optics_scene(outside: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = "glass/Glass/weak"
    assert run_command(["trace", str(scene_path(outside, name)), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    maps = result["readings"]["detector1"]
    position, irradiance = recorded(outside, name)
    assert deviation(np.array(maps["irradiance"]), irradiance) <= MAX_DEVIATION
    assert maps["position"] == position.tolist()
    assert (result["length_unit"], result["power_unit"]) == ("unit of the file", "brightness")


@pytest.mark.parametrize(
    "name",
    [
        name
        for name in SCENES
        if not {"CustomGlass", "ParamGlass", "CustomMirror"} & {*name.split("/")} and name not in WITH_GRATING
    ],
)
def test_engine_gives_same_total(name: str, outside: Path) -> None:
    """The engine follows all weak branches, and its curves are exact; totals over a detector differ only slightly.

    In ray-optics, one weak branch of up to about 0.01 represents others, so a total deviates by a few of them.
    """
    imported = rayoptics.load(scene_path(outside, name))
    result = trace(imported.scene, "power")
    assert result.undefined == 0, result.undefined_at_mm
    (reading,) = imported.readings(result.monitors).values()
    assert reading.irradiance is not None
    _, irradiance = recorded(outside, name)
    size = imported.detectors[0].bin_size
    throughput = float(np.abs(irradiance).sum()) * size
    assert abs(float((reading.irradiance - irradiance).sum()) * size) <= max(2e-3 * throughput, 0.15)


@pytest.mark.parametrize(
    "name", ["glass/Glass/equiv_nonsimple", "mirror/IdealMirror/negative", "glass/PlaneGlass/cauchy"]
)
def test_imported_scene_round_trip(name: str, outside: Path) -> None:
    scene = rayoptics.load(scene_path(outside, name)).scene
    assert loads(dumps(scene)) == scene


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("glass/Glass/weak", "Beam"),
        ("lightSource/Beam/emisAngle", "Beam"),
        ("lightSource/PointSource/brightness", "PointSource"),
        ("lightSource/AngleSource/correctBrightness", "AngleSource"),
    ],
)
def test_source_rays_agree_with_independent_implementation(name: str, kind: str, outside: Path) -> None:
    """y of ray-optics points down: it is −z in the import, and z in the independent implementation."""
    file: SceneFile = load(outside, name)
    (item,) = file.objects(kind)
    expected = {"Beam": beam, "PointSource": point_source, "AngleSource": angle_source}[kind](file, item).launch()
    (source,) = rayoptics.load(scene_path(outside, name)).scene.sources
    launched = source.launch()
    for values, expected_values in (
        (launched.x_mm, expected.x_mm),
        (launched.z_mm, -expected.z_mm),
        (launched.power_s, expected.power_s),
    ):
        np.testing.assert_allclose(values, expected_values, rtol=1e-12)
    np.testing.assert_allclose(launched.dx, expected.dx, atol=1e-12)
    np.testing.assert_allclose(launched.dz, -expected.dz, atol=1e-12)
