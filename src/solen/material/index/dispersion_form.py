"""Functional form of the index of a layer against wavelength in a fringe fit: Cauchy, Sellmeier, or free.

Let u be 1/λ² scaled to the range from −1 to 1. Cauchy's three terms are then the index n₀ at u = 0 and its linear and
quadratic changes with u. Sellmeier's formula with one pole has only the first two parameters: n² = 1 + (n₀² − 1)/(1 − q
u) with q = 2 n₀ rise/(n₀² − 1). A free n is Cauchy's formula plus smooth curves with knots a few fringes apart,
orthogonal to the three terms. Fringes determine no finer structure of n, because a single wavelength of a fringe does
not determine n.

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
_FRINGES_PER_KNOT, _MAX_KNOTS, _TERMS = 4, 18, 3


def free_knots(fringes: float) -> int:
    """Return the number of knots of a free index that a number of fringes determines; 0 for too few fringes."""
    return 0 if fringes < MIN_FRINGES else int(min(fringes // _FRINGES_PER_KNOT, _MAX_KNOTS))


@dataclass(frozen=True, eq=False)
class DispersionForm:
    """Functional form of the index.

    Attributes
    ----------
    kind
        ``cauchy``, ``sellmeier`` or ``free``.
    u, u_per_nm
        1/λ² scaled to the range from −1 to 1, and its derivative with respect to wavelength, shape (n,).
    curves, slopes
        Curves added to a free index, with an RMS value of 1, and their derivatives with respect to u, shape (n,
        curves).
    """

    kind: Kind
    u: FloatArray
    u_per_nm: FloatArray
    curves: FloatArray
    slopes: FloatArray

    @classmethod
    def of(cls, kind: Kind, u: FloatArray, u_per_nm: FloatArray, knots: int = 0) -> "DispersionForm":
        """Return a form for given wavelengths; ``knots`` is the number of knots of a free form."""
        if kind != "free":
            return cls(kind, u, u_per_nm, np.zeros((u.size, 0)), np.zeros((u.size, 0)))
        spline = CubicSpline(np.linspace(-1.0, 1.0, knots), np.eye(knots), bc_type="natural")
        terms = np.stack([np.ones_like(u), u, u**2], axis=1)
        term_slopes = np.stack([0.0 * u, np.ones_like(u), 2.0 * u], axis=1)
        projection = np.linalg.lstsq(terms, spline(u), rcond=None)[0]
        curves, slopes = spline(u) - terms @ projection, spline(u, 1) - term_slopes @ projection
        _, sizes, axes = np.linalg.svd(curves, full_matrices=False)
        basis = axes[: knots - _TERMS].T / sizes[: knots - _TERMS] * np.sqrt(u.size)
        return cls(kind, u, u_per_nm, curves @ basis, slopes @ basis)

    @property
    def count(self) -> int:
        """Number of added curves."""
        return int(self.curves.shape[1])

    def index(self, n: Any, rise: Any, bend: Any, added: Any) -> tuple[Any, Any]:
        """Return the index and its derivative with respect to wavelength."""
        u = self.u
        if self.kind == "sellmeier":
            q = 2.0 * n * rise / (n**2 - 1.0)
            index = np.sqrt(1.0 + (n**2 - 1.0) / (1.0 - q * u))
            return index + bend * u**2, ((n * rise / (1.0 - q * u) ** 2) / index + 2.0 * bend * u) * self.u_per_nm
        index = n + rise * u + bend * u**2
        return index + self.curves @ added, (rise + 2.0 * bend * u + self.slopes @ added) * self.u_per_nm
