"""Covered fractions of pixels agree with intersections by shapely and with closed forms."""

from collections.abc import Callable

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.raster import coverage, coverage_bytes, rings_of

ROUNDING = 1e-12
"""Fractions are sums of about a hundred numbers with rounding errors below 7e-15."""


def shapely_coverage(
    area: shapely.Geometry, pitch: float, origin: tuple[float, float], shape: tuple[int, int]
) -> FloatArray:
    """Return the covered fraction of each pixel, by intersection with its square."""
    rows, columns = np.indices(shape)
    x, y = origin[0] + columns * pitch, origin[1] + rows * pitch
    return shapely.area(shapely.intersection(shapely.box(x, y, x + pitch, y + pitch), area)) / pitch**2


def star(seed: int, corners: int, centre: tuple[float, float], max_radius: float) -> shapely.Polygon:
    """Return a random polygon without self-intersection, with its corners at ascending angles."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners))
    radius = max_radius * rng.uniform(0.2, 1.0, corners)
    return shapely.Polygon(np.column_stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)]))


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 10**6),
    st.integers(3, 40),
    st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
    st.floats(0.25, 1.0),
)
def test_coverage_of_random_polygons_agrees_with_shapely(
    seed: int, corners: int, centre: tuple[float, float], pitch: float
) -> None:
    area = star(seed, corners, centre, 4.0)
    if not area.is_valid or area.area < 1e-3:
        return
    origin, shape = (-2.0, -1.5), (13, 17)
    pixels = coverage(rings_of(area), pitch, origin, shape)
    assert pixels == pytest.approx(shapely_coverage(area, pitch, origin, shape), abs=ROUNDING)


def test_coverage_of_holes_and_separate_areas() -> None:
    area = shapely.union(star(1, 30, (1.0, 1.0), 0.9), star(2, 30, (3.2, 1.1), 0.9))
    area = shapely.difference(area, shapely.Point(1.05, 1.02).buffer(0.15))
    pixels = coverage(rings_of(area), 0.05, (0.0, 0.0), (48, 90))
    assert pixels == pytest.approx(shapely_coverage(area, 0.05, (0.0, 0.0), (48, 90)), abs=1e-11)
    assert pixels.sum() * 0.05**2 == pytest.approx(area.area, rel=1e-12)


def test_coverage_is_exact_along_pixel_boundaries() -> None:
    square = np.array([(1.0, 1.0), (3.0, 1.0), (3.0, 4.0), (1.0, 4.0)])
    pixels = coverage([square], 1.0, (0.0, 0.0), (5, 5))
    expected = np.zeros((5, 5))
    expected[1:4, 1:3] = 1.0
    assert (pixels == expected).all()
    closed = np.vstack([square, square[:1]])
    assert (coverage([closed], 1.0, (0.0, 0.0), (5, 5)) == expected).all(), "a repeated point has no effect"


def test_rows_are_counted_upwards_and_columns_to_the_right() -> None:
    triangle = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 0.5)])
    pixels = coverage([triangle], 0.5, (0.0, 0.0), (2, 3))
    assert pixels == pytest.approx(np.array([[0.75, 0.25, 0.0], [0.0, 0.0, 0.0]]), abs=1e-15)


def test_the_area_of_a_disc_does_not_depend_on_its_position() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    disc = np.column_stack([np.cos(angle), np.sin(angle)])
    area = 2000.0 * np.sin(2.0 * np.pi / 4000)
    for shift in ((0.0, 0.0), (0.0123, -0.0307), (0.5, 0.25)):
        pixels = coverage([disc + shift], 0.05, (-2.0, -2.0), (80, 80))
        assert pixels.sum() * 0.05**2 == pytest.approx(area, rel=1e-13)


def test_ignores_areas_outside_the_grid() -> None:
    square = np.array([(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)])
    assert (coverage([square], 0.3, (-1.0, -1.0), (7, 9)) == 1.0).all()
    assert not coverage([square + 200.0], 0.3, (-1.0, -1.0), (7, 9)).any()
    assert not coverage_bytes([square + 200.0], 0.3, (-1.0, -1.0), (7, 9)).any()
    assert not coverage_bytes([], 0.3, (0.0, 0.0), (7, 9)).any()
    assert not coverage([], 0.3, (0.0, 0.0), (7, 9)).any()


@pytest.mark.parametrize("shift", [(0.0, 0.0), (-1.3, 0.4), (2.9, 3.1)])
def test_bytes_are_the_rounded_fractions(shift: tuple[float, float]) -> None:
    rings = rings_of(shapely.difference(star(3, 50, (2.0, 2.0), 1.9), shapely.Point(2.0, 2.1).buffer(0.2)))
    moved = [ring + shift for ring in rings]
    fractions = coverage(moved, 0.03, (0.0, 0.0), (150, 140))
    pixels = coverage_bytes(moved, 0.03, (0.0, 0.0), (150, 140))
    assert pixels.dtype == np.uint8
    assert np.abs(pixels - 255.0 * fractions).max() <= 0.5 + 1e-9


def test_coverage_of_a_hundred_rings_is_the_sum_of_each() -> None:
    grid = (0.1, (0.0, 0.0), (100, 100))
    rings = [ring for k in range(100) for ring in rings_of(star(k, 8, (0.5 + k % 10, 0.5 + k // 10), 0.49))]
    total = sum(coverage([ring], *grid) for ring in rings)
    assert coverage(rings, *grid) == pytest.approx(total, abs=1e-12)


@pytest.mark.parametrize(
    ("pitch", "origin", "shape", "line"),
    [
        (0.0, (0.0, 0.0), (5, 5), "pixel pitch = 0.0; must be above 0 mm"),
        (float("nan"), (0.0, 0.0), (5, 5), "pixel pitch"),
        (0.1, (0.0, float("inf")), (5, 5), "origin of the pixels"),
        (0.1, (0.0, 0.0), (0, 5), "pixels"),
    ],
)
def test_refuses_an_invalid_grid(pitch: float, origin: tuple[float, float], shape: tuple[int, int], line: str) -> None:
    with pytest.raises(DataError, match=line.replace("(", r"\(")):
        coverage([np.zeros((3, 2))], pitch, origin, shape)


@pytest.mark.parametrize("function", [coverage, coverage_bytes])
def test_refuses_a_point_that_is_not_finite(function: Callable[..., object]) -> None:
    with pytest.raises(DataError, match="not finite"):
        function([np.array([(0.0, 0.0), (1.0, np.nan), (0.0, 1.0)])], 0.1, (0.0, 0.0), (5, 5))
