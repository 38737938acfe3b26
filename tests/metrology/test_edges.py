"""Sub-pixel edges on images whose edge is known by construction."""

import numpy as np
import pytest
from scipy.special import erf

from solen.arrays import FloatArray
from solen.metrology import fit_edge, fit_two_edges, normals_of

CENTRE, RADIUS = np.array([200.4, 160.7]), 120.3


def blurred_disc(blur_px: float, inside: float = 0.2, outside: float = 0.7) -> FloatArray:
    """Return a disc whose edge is an error function; at this radius, it is a Gaussian blur to within 1 %."""
    y, x = np.mgrid[0:320, 0:400]
    distance = np.hypot(x - CENTRE[0], y - CENTRE[1]) - RADIUS
    return np.asarray(inside + (outside - inside) * 0.5 * (1.0 + erf(distance / (np.sqrt(2.0) * blur_px))))


def circle(radius: float, count: int = 250) -> FloatArray:
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return CENTRE + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def radial_error_px(points: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(*(points - CENTRE).T) - RADIUS)


@pytest.mark.parametrize("blur_px", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("contour_error_px", [-2.0, 0.0, 1.5])
def test_edge_without_noise_to_a_hundredth_of_a_pixel(blur_px: float, contour_error_px: float) -> None:
    # the average over five parallel lines across an arc of radius R is 2 / (2 R) = 0.008 px too far out
    contour = circle(RADIUS + contour_error_px)
    edge = fit_edge(blurred_disc(blur_px), contour, normals_of(contour, closed=True), closed=True)
    assert edge.kept.all()
    assert np.abs(radial_error_px(edge.points_px)).max() < 0.015
    assert edge.blur == pytest.approx(blur_px, rel=0.03)
    assert abs(edge.contrast) == pytest.approx(0.5, rel=0.01)


def test_scatter_agrees_with_stated_uncertainty() -> None:
    rng = np.random.default_rng(5)
    clean, contour = blurred_disc(2.0), circle(RADIUS + 1.0)
    normals = normals_of(contour, closed=True)
    edges = [
        fit_edge(clean + rng.normal(0.0, 0.03 * 0.5, clean.shape), contour, normals, closed=True) for _ in range(8)
    ]
    error = np.concatenate([radial_error_px(edge.points_px)[edge.kept] for edge in edges])
    stated = np.concatenate([edge.u_px[edge.kept] for edge in edges])
    assert len(error) > 0.99 * 8 * len(contour)
    assert abs(error.mean()) < 0.01  # 0.008 px is the sag of the arc across the averaged lines
    assert error.std() < 0.06
    assert error.std() == pytest.approx(stated.mean(), rel=0.15)


def test_rejects_and_counts_dust_and_saturation() -> None:
    image = blurred_disc(2.0)
    y, x = np.mgrid[0:320, 0:400]
    speck = CENTRE + (RADIUS + 1.0) * np.array([1.0, 0.0])
    image[np.hypot(x - speck[0], y - speck[1]) < 5.0] = 0.05
    glare = CENTRE + RADIUS * np.array([0.0, 1.0])
    image[np.hypot(x - glare[0], y - glare[1]) < 9.0] = 1.0
    contour = circle(RADIUS, 600)
    edge = fit_edge(image, contour, normals_of(contour, closed=True), ceiling=1.0, closed=True)
    assert np.abs(radial_error_px(edge.points_px[edge.kept])).max() < 0.3
    assert edge.rejected["saturated"] > 0
    assert sum(edge.rejected.values()) == int(np.sum(~edge.kept))
    assert 0.85 < edge.kept.mean() < 0.99


def test_measures_contour_within_image() -> None:
    contour = circle(RADIUS)
    edge = fit_edge(blurred_disc(2.0)[:, :260], contour, normals_of(contour, closed=True), closed=True)
    assert edge.rejected["outside the image"] > 50
    assert np.abs(radial_error_px(edge.points_px[edge.kept])).max() < 0.02


def test_finds_no_edge_in_noise() -> None:
    image = np.random.default_rng(2).normal(0.5, 0.02, (320, 400))
    contour = circle(RADIUS)
    edge = fit_edge(image, contour, normals_of(contour, closed=True), closed=True)
    assert edge.kept.mean() < 0.05


def test_distinguishes_two_edges_with_overlapping_blurs() -> None:
    x = np.arange(200.0)
    row = (
        0.2
        + 0.3 * 0.5 * (1 + erf((x - 98.3) / (np.sqrt(2) * 2)))
        + 0.2 * 0.5 * (1 + erf((x - 105.1) / (np.sqrt(2) * 2)))
    )
    contour = np.stack([np.full(60, 101.0), np.arange(20.0, 80.0)], axis=1)
    normals = np.tile([1.0, 0.0], (60, 1))
    first, second = fit_two_edges(np.tile(row, (100, 1)), contour, normals, np.tile([-2.0, 3.5], (60, 1)))
    assert first.kept.all()
    assert second.kept.all()
    np.testing.assert_allclose(first.points_px[:, 0], 98.3, atol=0.02)
    np.testing.assert_allclose(second.points_px[:, 0], 105.1, atol=0.02)
