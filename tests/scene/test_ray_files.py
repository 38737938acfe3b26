"""Vendors' ray files: reading, placement of the rays, and error messages for damaged files."""

import math
import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from solen.curve import Segment
from solen.errors import DataError
from solen.plane import heading
from solen.scene import Interface, RayFile, Scene, dumps, loads
from solen.scene.model import Region
from solen.scene.sources.ray_formats import read_rays
from solen.trace import trace
from tests.scene.rayfile_support import lambertian, tm25, zemax

THREE = np.array(
    [
        [0.1, 0.2, 0.3, 0.6, 0.0, 0.8, 1.0],
        [-0.4, 0.0, 0.0, 0.0, 0.6, 0.8, 3.0],
        [0.0, -0.5, 0.1, 0.0, 0.0, 1.0, 0.0],
    ]
)


def with_colours(rays: np.ndarray, *values: float) -> np.ndarray:
    return np.column_stack([rays, np.resize(values, len(rays))])


@pytest.mark.parametrize("write", [zemax, tm25], ids=["zemax", "tm25"])
def test_rays_read_equal_rays_written(write: Callable[[Path, np.ndarray], Path], tmp_path: Path) -> None:
    rays_read = read_rays(write(tmp_path / "a.dat", THREE))
    assert rays_read.point_mm == pytest.approx(THREE[:, :3], abs=1e-7)
    assert rays_read.direction == pytest.approx(THREE[:, 3:6], abs=1e-7)
    assert rays_read.power == pytest.approx([0.25, 0.75, 0.0], abs=1e-7)
    ((nm, weight),) = rays_read.spectrum
    assert (nm, weight) == pytest.approx((850.0, 1.0), rel=1e-6)
    assert rays_read.line is None


@pytest.mark.parametrize(("unit", "factor"), [(0, 1000.0), (1, 25.4), (2, 10.0), (3, 304.8), (4, 1.0)])
def test_reads_lengths_in_unit_of_zemax_file(unit: int, factor: float, tmp_path: Path) -> None:
    rays_read = read_rays(zemax(tmp_path / "a.sdf", THREE, unit=unit))
    assert rays_read.point_mm == pytest.approx(factor * THREE[:, :3], rel=1e-6)


def test_reads_wavelength_of_each_ray(tmp_path: Path) -> None:
    rays = with_colours(THREE, 0.45, 0.62, 0.45)
    rays_read = read_rays(zemax(tmp_path / "a.sdf", rays, kind=2))
    assert [nm for nm, _ in rays_read.spectrum] == pytest.approx([450.0, 620.0], rel=1e-6)
    assert [weight for _, weight in rays_read.spectrum] == pytest.approx([0.25, 0.75], rel=1e-6)
    assert rays_read.line is not None
    assert rays_read.line.tolist() == [0, 1, 0]
    tm25_rays = read_rays(
        tm25(
            tmp_path / "a.tm25ray", with_colours(THREE, 450.0, 620.0, 450.0), spectral=2, flags=(1, 1, 1, 1, 0, 0, 0, 0)
        )
    )
    assert tm25_rays.line is not None
    assert tm25_rays.line.tolist() == [0, 1, 0]


def test_bins_many_wavelengths_and_keeps_their_mean(tmp_path: Path) -> None:
    rays = lambertian(2000)
    nm = np.linspace(400.0, 700.0, 2000)
    rays_read = read_rays(zemax(tmp_path / "a.sdf", np.column_stack([rays, nm / 1000.0]), kind=2))
    values, weights = (np.array(column) for column in zip(*rays_read.spectrum, strict=True))
    assert len(values) <= 32
    assert weights.sum() == pytest.approx(1.0, rel=1e-6)
    assert values @ weights == pytest.approx(550.0, abs=0.01)
    assert rays_read.line is not None
    assert np.max(np.abs(values[rays_read.line] - nm)) < 300.0 / 32


def test_reads_past_spectral_table_text_and_luminous_columns(tmp_path: Path) -> None:
    rays = np.column_stack([THREE, 683.0 * THREE[:, 6]])  # radiant and luminous flux
    path = tm25(
        tmp_path / "a.tm25ray",
        rays,
        spectral=3,
        flags=(1, 1, 1, 0, 1, 0, 0, 0),
        table=((450.0, 1.0), (500.0, 0.0), (620.0, 3.0)),
        text=b"x" * 64,
    )
    rays_read = read_rays(path)
    assert rays_read.power == pytest.approx([0.25, 0.75, 0.0], abs=1e-7)
    assert rays_read.spectrum == ((450.0, 1.0), (620.0, 3.0))


def with_value(row: int, column: int, value: float) -> np.ndarray:
    bad = THREE.copy()
    bad[row, column] = value
    return bad


def cut(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])


BROKEN: dict[str, Callable[[Path], object]] = {
    "missing": lambda path: path.unlink(missing_ok=True),
    "text": lambda path: path.write_text("3 4\n0 0 0 0 0 1 1\n", encoding="utf-8"),
    "empty": lambda path: path.write_bytes(b""),
    "header": lambda path: path.write_bytes(struct.pack("<i", 1010)),
    "cut": lambda path: cut(zemax(path, THREE), -1),
    "longer": lambda path: path.write_bytes(zemax(path, THREE).read_bytes() + b"1234"),
    "cut tm25": lambda path: cut(tm25(path, THREE), -30),
    "cut table": lambda path: cut(tm25(path, THREE, spectral=3, table=((450.0, 1.0), (620.0, 1.0))), 36_294),
    "unit": lambda path: zemax(path, THREE, unit=9),
    "format": lambda path: zemax(path, THREE, kind=1),
    "lumens": lambda path: zemax(path, THREE, flux=1, wavelength_um=0.0),
    "luminous": lambda path: tm25(path, THREE, spectral=0, flags=(1, 1, 0, 0, 1, 0, 0, 0)),
    "no flux": lambda path: tm25(path, THREE[:, :6], flags=(1, 1, 0, 0, 0, 0, 0, 0)),
    "by ray": lambda path: tm25(path, np.column_stack([THREE, [1, 1, 1]]), spectral=4, flags=(1, 1, 1, 0, 0, 0, 0, 1)),
    "dark": lambda path: zemax(path, THREE * [1, 1, 1, 1, 1, 1, 0]),
    "not unit": lambda path: zemax(path, with_value(1, 4, 0.9)),
    "nan": lambda path: zemax(path, with_value(2, 0, math.nan)),
    "negative": lambda path: zemax(path, with_value(2, 6, -1.0)),
}


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("missing", "cannot be read"),
        ("text", "neither a binary Zemax file"),
        ("empty", "neither a binary Zemax file"),
        ("header", "truncated in the header: it has 4 bytes and requires at least 208"),
        ("cut", "truncated in ray 3 of 3: it has 291 bytes and requires at least 292"),
        ("longer", "4 more than its 3 rays of 28 bytes"),
        ("cut tm25", "truncated in ray 2 of 3"),
        ("cut table", "truncated in spectral table 1"),
        ("unit", "dimension units = 9"),
        ("format", "ray format = 1"),
        ("lumens", "luminous"),
        ("luminous", "luminous"),
        ("no flux", "a position, a direction and a flux"),
        ("by ray", "spectral data = 4"),
        ("dark", "all its rays have zero flux"),
        ("not unit", "ray 2 of 3; its direction must be a unit vector"),
        ("nan", "ray 3 of 3; its numbers must be finite"),
        ("negative", "ray 3 of 3; its flux must be at least 0"),
    ],
)
def test_reports_position_of_fault(kind: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.dat"
    BROKEN[kind](path)
    with pytest.raises(DataError) as refusal:
        read_rays(path)
    line = str(refusal.value)
    assert message in line
    assert "broken.dat" in line
    assert len(line.splitlines()) == 1


def test_reads_changed_file_again(tmp_path: Path) -> None:
    path = zemax(tmp_path / "a.dat", THREE)
    assert len(read_rays(path)) == 3
    zemax(path, THREE[:2])
    os.utime(path, ns=(1, 1))
    assert len(read_rays(path)) == 2


def test_places_rays_relative_to_axis(tmp_path: Path) -> None:
    """The z-axis of the file is along the axis, x to its right and y upwards; each ray has its own power."""
    source = RayFile.of(str(zemax(tmp_path / "a.dat", THREE)), (1.0, -2.0), 30.0, power=4.0)
    launch = source.launch(in_space=True)
    assert launch.y_mm is not None
    assert launch.dy is not None
    axis, right = heading(30.0), heading(-60.0)
    for i, (x, y, z, dx, dy, dz, flux) in enumerate(THREE):
        assert launch.x_mm[i] == pytest.approx(1.0 + x * right[0] + z * axis[0], abs=1e-6)
        assert launch.z_mm[i] == pytest.approx(-2.0 + x * right[1] + z * axis[1], abs=1e-6)
        assert launch.dx[i] == pytest.approx(dx * right[0] + dz * axis[0], abs=1e-6)
        assert launch.dz[i] == pytest.approx(dx * right[1] + dz * axis[1], abs=1e-6)
        assert (launch.y_mm[i], launch.dy[i]) == pytest.approx((y, dy), abs=1e-6)
        assert launch.power_s[i] + launch.power_p[i] == pytest.approx(flux, abs=1e-6)
    flat = source.launch()
    assert np.hypot(flat.dx, flat.dz) == pytest.approx(1.0, abs=1e-15)
    assert flat.dx / flat.dz == pytest.approx(launch.dx / launch.dz, rel=1e-12)


def test_ray_along_y_becomes_ray_along_axis_in_plane(tmp_path: Path) -> None:
    along_y = np.array([[0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0]])
    launch = RayFile.of(str(zemax(tmp_path / "a.dat", along_y)), (0.0, 0.0), 20.0).launch()
    assert (launch.dx[0], launch.dz[0]) == pytest.approx(heading(20.0))


def test_draws_fewer_rays_in_proportion_to_power(tmp_path: Path) -> None:
    rays = lambertian(4000)
    rays[:, 6] *= np.where(rays[:, 0] > 0.0, 3.0, 1.0)
    source = RayFile.of(str(zemax(tmp_path / "a.dat", rays)), (0.0, 0.0), 0.0, 1000)
    launch = source.launch()
    assert len(launch) == 1000
    assert np.ptp(launch.power_s) == 0.0
    expected = rays[rays[:, 0] > 0.0, 6].sum() / rays[:, 6].sum()
    assert np.mean(launch.x_mm > 0.0) == pytest.approx(
        expected, abs=0.03
    )  # for a thousand rays, drawn in the order of the file


def test_ray_file_is_source_of_scene(tmp_path: Path) -> None:
    path = zemax(tmp_path / "a.dat", with_colours(lambertian(64), 0.45, 0.62), kind=2)
    source = RayFile.of(str(path), (0.0, 0.0), 0.0)
    scene = Scene((Region("air", 1.0),), (), (source,))
    assert loads(dumps(scene)) == scene
    for sampling in ("fan", "sobol"):
        rays_read = trace(scene, "power", sampling=sampling)
        assert rays_read.ledger.escaped == pytest.approx(1.0, abs=1e-12)
    assert source.dimensions() == 1
    assert np.bincount(source.launch().line).tolist() == [32, 32]
    assert source.with_spectrum(()).launch().line.tolist() == [0] * 64


@pytest.mark.parametrize("sampling", ["fan", "sobol"])
def test_power_of_rays_is_the_same_for_every_sampling(sampling: Literal["fan", "sobol"], tmp_path: Path) -> None:
    """Of 300 rays, those to the right carry nine times the power of those to the left."""
    angles = np.radians(np.linspace(-40.0, 40.0, 300))
    rays = np.zeros((300, 7))
    rays[:, 3], rays[:, 5], rays[:, 6] = np.sin(angles), np.cos(angles), np.where(angles > 0.0, 9.0, 1.0)
    source = RayFile.of(str(zemax(tmp_path / "a.dat", rays)), (0.0, 0.0), 0.0)
    ends = ((-9.0, 5.0), (0.0, 5.0), (9.0, 5.0))
    screens = tuple(
        Interface(name, Segment(a, b).reversed(), "air", "air", "receiver", name)
        for name, a, b in (("left", *ends[:2]), ("right", *ends[1:]))
    )
    rays_read = trace(Scene((Region("air", 1.0),), screens, (source,)), "power", sampling=sampling)
    assert rays_read.detectors["right"].power == pytest.approx(0.9, abs=max(4.0 * rays_read.u_power, 1e-3))
    assert rays_read.ledger.total == pytest.approx(1.0, abs=1e-12)
