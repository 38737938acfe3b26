"""Lens profiles like those from an image or a print model: ovals with simulated errors."""

import numpy as np

from solen.arrays import FloatArray
from solen.lens import FittedProfile, MeasuredLens, MeasuredProfile, OvalLens, profile_of

LENS = OvalLens(1.0, 20.0, 2.0, 1.44)
X = np.linspace(-2.0, 2.0, 2001)
"""Lateral positions 2 µm apart, like the pixels of a micrograph."""


def profile(
    more_um: FloatArray | float = 0.0,
    u_mm: float = 0.0,
    *,
    x: FloatArray = X,
    oval: OvalLens = LENS,
    simulated: bool = True,
) -> MeasuredProfile:
    """Profile of an oval with ``more_um`` of additional material along its normal."""
    z = oval.z_mm(x) - 1e-3 * np.asarray(more_um) * np.hypot(1.0, oval.slope(x))
    return profile_of(x, z, u_mm, simulated=simulated)


def noise_um(size_um: float, seed: int = 1, neighbours: float = 0.0) -> FloatArray:
    """Normally distributed errors of the points, with a correlation length of ``neighbours`` points."""
    numbers = np.random.default_rng(seed).standard_normal(X.size)
    if neighbours:
        reach = int(5 * neighbours)
        weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / neighbours) ** 2)
        numbers = np.convolve(numbers, weights / np.sqrt(np.sum(weights**2)), mode="same")
    return size_um * numbers


def lens(measured: MeasuredProfile, designed: OvalLens = LENS) -> MeasuredLens:
    """Measured lens of a profile whose design is an oval."""
    return MeasuredLens(FittedProfile(designed, measured))


def placed(x_shift_mm: float = 0.0, turn_deg: float = 0.0, scale: float = 1.0, about: float = 0.0) -> MeasuredProfile:
    """Exact profile of `LENS` scaled about its vertex, rotated about (0, ``about``) and shifted; cut to ±2 mm."""
    wide = OvalLens(1.0, 20.0, 2.2, 1.44)
    x = np.linspace(-2.15, 2.15, 4001)
    points = scale * np.column_stack([x, wide.z_mm(x)]) - [0.0, about]
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    x, z = (points @ np.array([[c, s], [-s, c]]) + [x_shift_mm, about]).T
    keep = np.abs(x) <= 2.0
    return profile_of(x[keep], z[keep], 0.0, simulated=True)
