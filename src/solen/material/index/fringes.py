"""Where the two faces of a layer interfere, so that adding their powers fails.

The idea: fringes are λ²/(2nh) apart. A monochromator whose bandwidth is well above that averages over
them and the powers add; one whose bandwidth is below sees them, and so does a spectrum whose wavelengths are close
enough to show them. Points that are too far apart show no fringe and are still off by it.

The interface: `fringe_warnings`, in sentences.
"""

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.units import NM_PER_UM


def fringe_spacing_nm(n: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike) -> FloatArray:
    """Distance in nm between two maxima of the interference of a layer's two faces, λ²/(2nh)."""
    wavelength = np.asarray(wavelength_nm, dtype=float)
    return np.asarray(wavelength**2 / (2.0 * np.asarray(n) * np.asarray(thickness_um) * NM_PER_UM))


def fringe_warnings(
    wavelength_nm: FloatArray, n: FloatArray, thickness_um: float, bandwidth_nm: float | None
) -> tuple[str, ...]:
    """What fringes mean for a spectrum along ascending wavelengths.

    ``n`` may hold NaN; the median of the rest serves there. A bandwidth of None is one that is not known.
    """
    if not np.isfinite(n).any():
        return ()
    index = np.where(np.isfinite(n), n, np.nanmedian(n))
    spacing = fringe_spacing_nm(index, thickness_um, wavelength_nm)
    ends = f"{spacing[0]:.2g} nm apart at {wavelength_nm[0]:g} nm"
    if spacing.size > 1:
        ends += f" and {spacing[-1]:.2g} nm at {wavelength_nm[-1]:g} nm"
    what = f"fringes of a layer of {thickness_um:g} µm are {ends}"
    if bandwidth_nm is None:
        return (f"{what}: powers add for a bandwidth above that; the instrument's is not stated",)
    wide = spacing > bandwidth_nm
    if not wide.any():
        return ()
    lost = f"{what}, and from {wavelength_nm[np.argmax(wide)]:g} nm on more than the bandwidth of {bandwidth_nm:g} nm"
    found = [f"{lost}: the spectrum follows the interference, which the sum of powers leaves out"]
    step = float(np.median(np.diff(wavelength_nm))) if wavelength_nm.size > 1 else np.inf
    if step > spacing[wide].min() / 2.0:
        apart = f"its wavelengths are {step:g} nm apart" if np.isfinite(step) else "it has one wavelength"
        found.append(f"{apart}, too far to show the fringes: they are in n as an error that looks like scatter")
    return tuple(found)
