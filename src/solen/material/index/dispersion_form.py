"""Functional form of a layer's index against wavelength in a fringe fit: Cauchy, Sellmeier, or free.

With u from −1 to 1 along 1/λ², the index n at the centre, its linear and its quadratic change are Cauchy's three terms.
One pole of Sellmeier's formula has the same centre and linear change and no other parameter: n² = 1 + (n₀² − 1)/(1 − q
u) with q = 2 n₀ rise/(n₀² − 1). A free n is Cauchy's formula plus a smooth curve whose knots are a few fringes apart
and which contains no part that the three terms can represent. A single wavelength of a fringe does not determine n, so
this is the largest freedom that the data allow.

`DispersionForm` computes n and its slope, and `free_knots` the number of knots that a number of fringes allows.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.interpolate import CubicSpline

from solen.arrays import FloatArray

Kind = Literal["cauchy", "sellmeier", "free"]
MIN_FRINGES = 20
"""Smallest number of fringes for which n can be free."""
_PER_KNOT, _MAX_KNOTS, _TERMS = 4, 18, 3


def free_knots(fringes: float) -> int:
    """Return the number of knots of a free index that the given number of fringes determines; 0 for too few."""
    return 0 if fringes < MIN_FRINGES else int(min(fringes // _PER_KNOT, _MAX_KNOTS))


@dataclass(frozen=True, eq=False)
class DispersionForm:
    """Functional form of the index.

    Attributes
    ----------
    kind
        ``cauchy``, ``sellmeier`` or ``free``.
    u, u_per_nm
        Coordinate from −1 to 1 along 1/λ², and its derivative with respect to wavelength, shape (n,).
    waves, slopes
        Curves added to a free index, with root mean square 1, and their derivatives with respect to u, shape (n,
        curves).
    """

    kind: Kind
    u: FloatArray
    u_per_nm: FloatArray
    waves: FloatArray
    slopes: FloatArray

    @classmethod
    def of(cls, kind: Kind, u: FloatArray, u_per_nm: FloatArray, knots: int = 0) -> "DispersionForm":
        """Return a form for given wavelengths; a free form has the given number of knots."""
        if kind != "free":
            return cls(kind, u, u_per_nm, np.zeros((u.size, 0)), np.zeros((u.size, 0)))
        spline = CubicSpline(np.linspace(-1.0, 1.0, knots), np.eye(knots), bc_type="natural")
        curves, slopes = spline(u), spline(u, 1)
        terms = np.stack([np.ones_like(u), u, u**2], axis=1)
        beside = np.linalg.lstsq(terms, curves, rcond=None)[0]
        left, by_u = curves - terms @ beside, slopes - np.stack([0.0 * u, np.ones_like(u), 2.0 * u], axis=1) @ beside
        _, sizes, axes = np.linalg.svd(left, full_matrices=False)
        kept = axes[: knots - _TERMS].T / sizes[: knots - _TERMS] * np.sqrt(u.size)
        return cls(kind, u, u_per_nm, left @ kept, by_u @ kept)

    @property
    def curves(self) -> int:
        """Number of added curves."""
        return int(self.waves.shape[1])

    def index(self, n: Any, rise: Any, bend: Any, added: Any) -> tuple[Any, Any]:
        """Return the index and its derivative with respect to wavelength."""
        u = self.u
        if self.kind == "sellmeier":
            q = 2.0 * n * rise / (n**2 - 1.0)
            found = np.sqrt(1.0 + (n**2 - 1.0) / (1.0 - q * u))
            return found + bend * u**2, ((n * rise / (1.0 - q * u) ** 2) / found + 2.0 * bend * u) * self.u_per_nm
        straight = n + rise * u + bend * u**2
        return straight + self.waves @ added, (rise + 2.0 * bend * u + self.slopes @ added) * self.u_per_nm
