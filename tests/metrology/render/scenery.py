"""Imperfections: non-uniform illumination, glare, dust, fibres and scratches, each a function from image to image."""

from collections.abc import Callable

import numpy as np

from solen.arrays import FloatArray
from tests.metrology.render.coverage import coverage
from tests.metrology.render.optics import gaussian

Scenery = Callable[[FloatArray, np.random.Generator], FloatArray]


def gradient(fraction: float, angle_deg: float) -> Scenery:
    """Return illumination that changes by ``fraction`` from one side of the image to the other."""

    def changed(image: FloatArray, _rng: np.random.Generator) -> FloatArray:
        u, v = _unit_coordinates(image.shape)
        turn = np.radians(angle_deg)
        return np.asarray(image * (1.0 + 0.5 * fraction * (u * np.cos(turn) - v * np.sin(turn))))

    return changed


def vignetting(fraction: float) -> Scenery:
    """Return illumination that falls by ``fraction`` to the corners, as the square of the distance from the centre."""

    def changed(image: FloatArray, _rng: np.random.Generator) -> FloatArray:
        u, v = _unit_coordinates(image.shape)
        return image * (1.0 - 0.5 * fraction * (u**2 + v**2))

    return changed


def glare(patches: int, radius_px: float, level: float) -> Scenery:
    """Return soft round patches of light at random positions, as reflections of a lamp."""

    def changed(image: FloatArray, rng: np.random.Generator) -> FloatArray:
        return image + sum(
            level * np.exp(-0.5 * _squares(image.shape, centre) / radius_px**2)
            for centre in rng.uniform((0, 0), (image.shape[1], image.shape[0]), (patches, 2))
        )

    return changed


def glare_at(u: float, v: float, radius_px: float, level: float) -> Scenery:
    """Return one patch of light at a position in the image."""
    return lambda image, _rng: image + level * np.exp(-0.5 * _squares(image.shape, (u, v)) / radius_px**2)


def dust(specks: int, radius_px: float, level: float) -> Scenery:
    """Return polygonal specks of about ``radius_px``, each of which multiplies the light by 1 + ``level``."""

    def changed(image: FloatArray, rng: np.random.Generator) -> FloatArray:
        rings = [_speck(rng, image.shape, radius_px * rng.lognormal(0.0, 0.4)) for _ in range(specks)]
        return _painted(image, rings, level)

    return changed


def fibres(count: int, length_px: float, width_px: float, level: float) -> Scenery:
    """Return curled fibres."""

    def changed(image: FloatArray, rng: np.random.Generator) -> FloatArray:
        return _painted(image, [_fibre(rng, image.shape, length_px, width_px, 0.02) for _ in range(count)], level)

    return changed


def scratches(count: int, length_px: float, width_px: float, level: float) -> Scenery:
    """Return straight scratches."""

    def changed(image: FloatArray, rng: np.random.Generator) -> FloatArray:
        return _painted(image, [_fibre(rng, image.shape, length_px, width_px, 0.0) for _ in range(count)], level)

    return changed


def texture(fraction: float, size_px: float) -> Scenery:
    """Return print texture: grains ``size_px`` wide that change the light by the RMS ``fraction``."""

    def changed(image: FloatArray, rng: np.random.Generator) -> FloatArray:
        grain = gaussian(size_px)(rng.standard_normal(image.shape), 1)
        return np.asarray(image * (1.0 + fraction * grain / grain.std()))

    return changed


def _unit_coordinates(shape: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    v, u = np.mgrid[-1 : 1 : shape[0] * 1j, -1 : 1 : shape[1] * 1j]
    return u, v


def _squares(shape: tuple[int, ...], centre: tuple[float, float]) -> FloatArray:
    u, v = np.arange(shape[1]) + 0.5 - centre[0], np.arange(shape[0]) + 0.5 - centre[1]
    return np.asarray(u[None, :] ** 2 + v[:, None] ** 2)


def _speck(rng: np.random.Generator, shape: tuple[int, ...], radius_px: float) -> FloatArray:
    angles = np.sort(rng.uniform(0, 2 * np.pi, 9))
    radii = radius_px * rng.uniform(0.5, 1.3, 9)
    centre = rng.uniform((0, 0), (shape[1], shape[0]))
    return np.asarray(centre + np.column_stack([radii * np.cos(angles), radii * np.sin(angles)]))


def _fibre(rng: np.random.Generator, shape: tuple[int, ...], length: float, width: float, curl: float) -> FloatArray:
    steps = max(int(length / 4), 2)
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, curl * 4, steps))
    line = rng.uniform((0, 0), (shape[1], shape[0])) + 4 * np.cumsum(
        np.column_stack([np.cos(heading), np.sin(heading)]), axis=0
    )
    offset = 0.5 * width * np.column_stack([-np.sin(heading), np.cos(heading)])
    return np.vstack([line + offset, (line - offset)[::-1]])


def _painted(image: FloatArray, rings: list[FloatArray], level: float) -> FloatArray:
    cover = np.zeros_like(image)
    for ring in rings:
        cover = np.maximum(cover, np.minimum(coverage([ring], (image.shape[0], image.shape[1])), 1.0))
    return np.asarray(image * (1.0 + level * gaussian(0.8)(cover, 1)))
