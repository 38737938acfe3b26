"""The image model: exact areas, blurred edges of known form, noise, and files with their scale."""

import io

import numpy as np
import pytest
import shapely
import tifffile
from PIL import Image as Pillow
from scipy.special import erf, j0, j1

from solen.arrays import FloatArray
from tests.metrology.render.camera import Camera, integrated, jpeg, ome_tiff, png, tiff
from tests.metrology.render.coverage import coverage
from tests.metrology.render.micrograph import Scene, reflected, transmitted
from tests.metrology.render.optics import Optics, airy, airy_kernel, defocus, disc_kernel, gaussian, smear
from tests.metrology.render.scenery import dust, gradient, vignetting
from tests.metrology.render.shape import Placing, body_of, bump, front_mm, grown, outline_mm, shipped

OUTLINE = outline_mm(shipped())
PLACING = Placing(10.0, (240.0, 60.0), angle_deg=4.0)


def star(rng: np.random.Generator, corners: int) -> FloatArray:
    """Return a simple polygon that extends beyond an image of 20 by 24 px on all sides."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
    radii = rng.uniform(2.0, 18.0, corners)
    return np.column_stack([12 + radii * np.cos(angles), 10 + radii * np.sin(angles)])


@pytest.mark.parametrize("seed", range(8))
def test_coverage_agrees_with_shapely(seed: int) -> None:
    ring = star(np.random.default_rng(seed), 9 + seed)
    pixels = [[shapely.box(j, i, j + 1, i + 1) for j in range(24)] for i in range(20)]
    expected = shapely.area(shapely.intersection(np.array(pixels), shapely.Polygon(ring).buffer(0)))
    assert np.abs(coverage([ring], (20, 24)) - expected).max() < 1e-12  # rounding errors of sums of about 100 areas


def test_coverage_with_hole_and_integer_coordinates() -> None:
    square = np.array([[2.0, 2.0], [8.0, 2.0], [8.0, 8.0], [2.0, 8.0]])
    hole = np.array([[4.0, 4.0], [4.0, 5.5], [6.0, 5.5], [6.0, 4.0]])
    cover = coverage([square, hole], (10, 10))
    assert cover.sum() == pytest.approx(36 - 3, abs=1e-12)
    assert cover[5, 4] == pytest.approx(0.5, abs=1e-12)


def test_light_of_lens_equals_area_of_polygon() -> None:
    scene = Scene((400, 500), reflected(OUTLINE, PLACING, step=1.0, optics=gaussian(2.0)), ground=0.0)
    inside = shapely.Polygon(PLACING.px(OUTLINE)).intersection(shapely.box(0, 0, 500, 400)).area
    cover = coverage([PLACING.px(OUTLINE)], (400, 500))
    assert cover.sum() == pytest.approx(inside, rel=1e-12)
    rng = np.random.default_rng(0)
    assert scene.light(rng).sum() == pytest.approx(inside, rel=2e-3)  # blur carries light across the image's border


def edge_response(optics: Optics, sub: int, angle_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances in px of pixel centres from a straight edge through the centre, and the light there."""
    direction = np.exp(1j * np.radians(angle_deg))
    corners = np.array([0, 200, 200 - 200j, -200j, -200, 0]) * direction + (32.3 + 31.8j)
    ring = np.column_stack([corners.real, corners.imag])
    image = integrated(optics(coverage([sub * ring], (64 * sub, 64 * sub)), sub), sub)
    v, u = np.mgrid[0:64, 0:64] + 0.5
    distance = ((u - 32.3) + 1j * (v - 31.8)) / direction
    middle = np.s_[20:44, 20:44]
    return -distance.imag[middle].ravel(), image[middle].ravel()


@pytest.mark.parametrize(("sub", "max_error"), [(1, 1e-3), (2, 7e-4), (4, 2e-4)])
def test_gaussian_blur_of_edge_is_error_function(sub: int, max_error: float) -> None:
    """The remaining error is due to the grid of areas; 0.001 of the light corresponds to 0.005 px."""
    distance, light = edge_response(gaussian(2.0), sub, 0.0)
    offsets = np.linspace(-0.5, 0.5, 4001)
    expected = [np.mean(0.5 * (1 + erf((centre + offsets) / (2.0 * np.sqrt(2))))) for centre in distance]
    assert light == pytest.approx(np.array(expected), abs=max_error)


def test_defocused_edge_is_chord_of_disc() -> None:
    distance, light = edge_response(defocus(6.0), 3, 17.0)
    t = np.clip(distance / 6.0, -1, 1)
    expected = 0.5 + (t * np.sqrt(1 - t**2) + np.arcsin(t)) / np.pi
    assert light == pytest.approx(expected, abs=4e-3)  # second-order effect of the pixel width: slope'/24


@pytest.mark.parametrize("angle_deg", [0.0, 11.0, 45.0, 83.0])
@pytest.mark.parametrize("optics", [gaussian(2.0), airy(4.0), defocus(3.0), smear(5.0, 30.0)])
def test_light_at_edge_is_half(optics: Optics, angle_deg: float) -> None:
    """All kernels are symmetric, so at a straight edge the light is one half."""
    distance, light = edge_response(optics, 3, angle_deg)
    near = np.abs(distance) < 1.2
    slope, level = np.polyfit(distance[near], light[near], 1)
    assert abs((0.5 - level) / slope) < 0.02  # px; between pixels the light is not linear


def test_encircled_energy_of_kernels() -> None:
    kernel = airy_kernel(10.0)
    v, u = np.mgrid[-60:61, -60:61]
    enclosed = kernel[np.hypot(u, v) <= 10.0].sum()
    kept = 1 - j0(3.8317 * 6) ** 2 - j1(3.8317 * 6) ** 2
    assert enclosed * kept == pytest.approx(
        0.838, abs=0.01
    )  # Rayleigh: 83.8 % within the first dark ring; the kernel is truncated
    assert kernel.sum() == pytest.approx(1.0)
    assert 1 / disc_kernel(5.0).max() == pytest.approx(np.pi * 25, rel=1e-3)


def test_noise_and_its_seed() -> None:
    flat = np.full((300, 300), 0.5)
    camera = Camera(noise=0.03, shot_fraction=0.5, bits=16)
    levels = camera.levels(flat, np.random.default_rng(1)) / 65535
    assert levels.std() == pytest.approx(
        0.03 * np.sqrt(0.75), rel=0.01
    )  # the relative uncertainty from 90,000 pixels is 0.24 %
    assert levels.mean() == pytest.approx(0.5, abs=4e-4)
    again = camera.levels(flat, np.random.default_rng(1)) / 65535
    assert np.array_equal(levels, again)


def test_levels_are_clipped_to_bit_depth() -> None:
    levels = Camera(bits=8).levels(np.linspace(-1, 2, 400).reshape(20, 20), np.random.default_rng(0))
    assert levels.dtype == np.dtype(np.uint8)
    assert (levels.min(), levels.max()) == (0, 255)


def test_placing_and_its_inverse() -> None:
    points = front_mm(shipped())[::7]
    assert PLACING.mm(PLACING.px(points)) == pytest.approx(points, abs=1e-12)
    upright = Placing(10.0, (240.0, 60.0))
    assert upright.px(np.array([[0.1, 0.2]]))[0] == pytest.approx([250.0, 40.0])  # right is right, and up is up
    left = Placing(10.0, (240.0, 60.0), angle_deg=90.0)
    assert left.px(np.array([[0.1, 0.2]]))[0] == pytest.approx([220.0, 50.0])  # counter-clockwise as seen


def test_tilt_and_magnification_change_length() -> None:
    ends = np.array([[0.0, 0.0], [0.0, 2.0]])
    tilted = Placing(10.0, (0.0, 0.0), tilt_deg=10.0, working_mm=1e6).px(ends)
    assert np.ptp(tilted[:, 1]) == pytest.approx(200 * np.cos(np.radians(10.0)), rel=1e-6)
    larger = Placing(10.0, (0.0, 0.0)).scaled(1.01).px(ends)
    assert np.ptp(larger[:, 1]) == pytest.approx(202.0)


def test_bumps_and_growth_are_outwards() -> None:
    bumped = outline_mm(shipped(), bump(0.0, 20.0, 0.1))
    assert bumped[:, 1].min() == pytest.approx(-0.020, abs=1e-6)
    larger = grown(OUTLINE, 10.0)
    strip = 0.010 * shapely.Polygon(OUTLINE).length
    assert shapely.Polygon(larger).area - shapely.Polygon(OUTLINE).area == pytest.approx(strip, rel=2e-3)
    assert body_of(shipped()).area_mm2() == pytest.approx(shapely.Polygon(OUTLINE).area, rel=1e-4)


def test_transmitted_light_shows_dark_wall() -> None:
    levels = transmitted((grown(OUTLINE, 60.0), PLACING, 1.0), (OUTLINE, PLACING, 1.0))
    light = Scene((400, 500), levels, ground=0.9).light(np.random.default_rng(0))
    wall = PLACING.px(np.array([[0.0, -0.030]]))[0].astype(int)
    inside = PLACING.px(np.array([[0.0, 0.5]]))[0].astype(int)
    assert light[wall[1], wall[0]] == pytest.approx(0.35, abs=0.02)
    assert light[inside[1], inside[0]] == pytest.approx(0.82, abs=1e-3)
    assert light[5, 5] == pytest.approx(0.9, abs=1e-3)


def test_effect_of_scenery() -> None:
    flat, rng = np.ones((50, 80)), np.random.default_rng(3)
    tilted = gradient(0.3, 0.0)(flat, rng)
    assert tilted[:, -1].mean() - tilted[:, 0].mean() == pytest.approx(0.3)
    assert vignetting(0.2)(flat, rng)[0, 0] == pytest.approx(0.8)
    dirty = dust(5, 3.0, -0.8)(flat, rng)
    assert 0.15 < dirty.min() < 0.9
    assert np.median(dirty) == 1.0


def test_files_contain_image_and_scale() -> None:
    levels = Scene((40, 50), [], ground=0.5).taken(0)
    with Pillow.open(io.BytesIO(png(levels, 4.0))) as image:
        assert np.array_equal(np.asarray(image), levels)
        assert image.info["dpi"] == pytest.approx((6350, 6350), rel=1e-3)
    with Pillow.open(io.BytesIO(jpeg(levels))) as image:
        assert image.size == (50, 40)
        assert image.getexif() == {}
    with tifffile.TiffFile(io.BytesIO(tiff(levels, 4.0))) as file:
        assert np.array_equal(file.asarray(), levels)
        across, unit = file.pages.first.tags["XResolution"].value
        assert across / unit == 2500
    with tifffile.TiffFile(io.BytesIO(ome_tiff(levels, 2.0))) as file:
        assert file.is_ome
        assert 'PhysicalSizeX="2.0"' in (file.ome_metadata or "")
