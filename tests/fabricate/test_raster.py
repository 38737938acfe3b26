"""Covered shares of pixels against intersections by shapely, which shares nothing with the sums, and by formulas."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.raster import coverage, coverage_bytes, rings_of

ROUNDING = 1e-12
"""Shares are sums of some hundred numbers, each rounded to less than 7e-15."""


def by_shapely(area: shapely.Geometry, pitch: float, origin: tuple[float, float], shape: tuple[int, int]) -> FloatArray:
    """Share of each pixel by intersecting its square."""
    rows, columns = np.indices(shape)
    x, y = origin[0] + columns * pitch, origin[1] + rows * pitch
    return shapely.area(shapely.intersection(shapely.box(x, y, x + pitch, y + pitch), area)) / pitch**2


def star(seed: int, corners: int, middle: tuple[float, float], radius: float) -> shapely.Polygon:
    """A polygon without self-crossing: corners at ascending angles."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners))
    far = radius * rng.uniform(0.2, 1.0, corners)
    return shapely.Polygon(np.column_stack([middle[0] + far * np.cos(angle), middle[1] + far * np.sin(angle)]))


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 10**6),
    st.integers(3, 40),
    st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
    st.floats(0.25, 1.0),
)
def test_any_polygon_covers_what_shapely_says(
    seed: int, corners: int, middle: tuple[float, float], pitch: float
) -> None:
    area = star(seed, corners, middle, 4.0)
    if not area.is_valid or area.area < 1e-3:
        return
    origin, shape = (-2.0, -1.5), (13, 17)
    found = coverage(rings_of(area), pitch, origin, shape)
    assert found == pytest.approx(by_shapely(area, pitch, origin, shape), abs=ROUNDING)


def test_holes_and_several_areas() -> None:
    area = shapely.union(star(1, 30, (1.0, 1.0), 0.9), star(2, 30, (3.2, 1.1), 0.9))
    area = shapely.difference(area, shapely.Point(1.05, 1.02).buffer(0.15))
    found = coverage(rings_of(area), 0.05, (0.0, 0.0), (48, 90))
    assert found == pytest.approx(by_shapely(area, 0.05, (0.0, 0.0), (48, 90)), abs=1e-11)
    assert found.sum() * 0.05**2 == pytest.approx(area.area, rel=1e-12)


def test_sides_on_the_lines_between_pixels_cover_pixels_wholly() -> None:
    square = np.array([(1.0, 1.0), (3.0, 1.0), (3.0, 4.0), (1.0, 4.0)])
    found = coverage([square], 1.0, (0.0, 0.0), (5, 5))
    expected = np.zeros((5, 5))
    expected[1:4, 1:3] = 1.0
    assert (found == expected).all(), "exact, not almost"
    closed = np.vstack([square, square[:1]])
    assert (coverage([closed], 1.0, (0.0, 0.0), (5, 5)) == expected).all(), "a repeated point changes nothing"


def test_rows_count_upwards_and_columns_to_the_right() -> None:
    corner = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 0.5)])
    found = coverage([corner], 0.5, (0.0, 0.0), (2, 3))
    assert found == pytest.approx(np.array([[0.75, 0.25, 0.0], [0.0, 0.0, 0.0]]), abs=1e-15)


def test_a_disc_has_its_area_wherever_it_lies() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    disc = np.column_stack([np.cos(angle), np.sin(angle)])
    area = 2000.0 * np.sin(2.0 * np.pi / 4000)
    for shift in ((0.0, 0.0), (0.0123, -0.0307), (0.5, 0.25)):
        found = coverage([disc + shift], 0.05, (-2.0, -2.0), (80, 80))
        assert found.sum() * 0.05**2 == pytest.approx(area, rel=1e-13)


def test_what_lies_beyond_the_grid_is_left_out() -> None:
    wide = np.array([(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)])
    assert (coverage([wide], 0.3, (-1.0, -1.0), (7, 9)) == 1.0).all()
    assert not coverage([wide + 200.0], 0.3, (-1.0, -1.0), (7, 9)).any()
    assert not coverage_bytes([wide + 200.0], 0.3, (-1.0, -1.0), (7, 9)).any()
    assert not coverage_bytes([], 0.3, (0.0, 0.0), (7, 9)).any()
    assert not coverage([], 0.3, (0.0, 0.0), (7, 9)).any()


@pytest.mark.parametrize("shift", [(0.0, 0.0), (-1.3, 0.4), (2.9, 3.1)])
def test_bytes_are_the_rounded_shares(shift: tuple[float, float]) -> None:
    rings = rings_of(shapely.difference(star(3, 50, (2.0, 2.0), 1.9), shapely.Point(2.0, 2.1).buffer(0.2)))
    moved = [ring + shift for ring in rings]
    shares = coverage(moved, 0.03, (0.0, 0.0), (150, 140))
    found = coverage_bytes(moved, 0.03, (0.0, 0.0), (150, 140))
    assert found.dtype == np.uint8
    assert np.abs(found - 255.0 * shares).max() <= 0.5 + 1e-9


def test_a_hundred_rings_are_the_sum_of_each() -> None:
    grid = (0.1, (0.0, 0.0), (100, 100))
    rings = [ring for k in range(100) for ring in rings_of(star(k, 8, (0.5 + k % 10, 0.5 + k // 10), 0.49))]
    apart = sum(coverage([ring], *grid) for ring in rings)
    assert coverage(rings, *grid) == pytest.approx(apart, abs=1e-12)


@pytest.mark.parametrize(
    ("pitch", "origin", "shape", "line"),
    [
        (0.0, (0.0, 0.0), (5, 5), "pixel pitch = 0.0; must be above 0 mm"),
        (float("nan"), (0.0, 0.0), (5, 5), "pixel pitch"),
        (0.1, (0.0, float("inf")), (5, 5), "origin of the pixels"),
        (0.1, (0.0, 0.0), (0, 5), "pixels"),
    ],
)
def test_no_grid_is_one_line(pitch: float, origin: tuple[float, float], shape: tuple[int, int], line: str) -> None:
    with pytest.raises(DataError, match=line.replace("(", r"\(")):
        coverage([np.zeros((3, 2))], pitch, origin, shape)


@pytest.mark.parametrize("function", [coverage, coverage_bytes])
def test_a_point_that_is_none_is_one_line(function: object) -> None:
    assert callable(function)
    with pytest.raises(DataError, match="not finite"):
        function([np.array([(0.0, 0.0), (1.0, np.nan), (0.0, 1.0)])], 0.1, (0.0, 0.0), (5, 5))
