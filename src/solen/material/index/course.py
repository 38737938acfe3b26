"""How the index of a layer runs along the wavelengths while its fringes are fitted: Cauchy, Sellmeier, or free.

The idea: with u from −1 to 1 along 1/λ², n in the middle, its rise and its bend are Cauchy's three terms. One pole of
Sellmeier's formula has the same middle and rise and no other number: n² = 1 + (n₀² − 1)/(1 − q u) with
q = 2 n₀ rise/(n₀² − 1). Free, n is Cauchy's with a smooth curve added whose knots are a few fringes apart; what three
terms can be is taken out of it. One wavelength of a fringe does not determine n, so that is as free as it can be.

The interface: `Course` gives n and its slope, `free_knots` how many knots some fringes allow.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.interpolate import CubicSpline

from solen.arrays import FloatArray

Kind = Literal["cauchy", "sellmeier", "free"]
LEAST_FRINGES = 20
"""Fringes from which on n can be free."""
_PER_KNOT, _MOST_KNOTS, _TERMS = 4, 18, 3


def free_knots(fringes: float) -> int:
    """Number of knots of a free index that the given fringes determine; 0 if too few."""
    return 0 if fringes < LEAST_FRINGES else int(min(fringes // _PER_KNOT, _MOST_KNOTS))


@dataclass(frozen=True, eq=False)
class Course:
    """A form of the index.

    Attributes
    ----------
    kind
        Which.
    u, u_per_nm
        From −1 to 1 along 1/λ², and its derivative by the wavelength, shape (n,).
    waves, slopes
        Curves that are added to a free index and their derivatives by u, shape (n, curves), of root mean square 1.
    """

    kind: Kind
    u: FloatArray
    u_per_nm: FloatArray
    waves: FloatArray
    slopes: FloatArray

    @classmethod
    def of(cls, kind: Kind, u: FloatArray, u_per_nm: FloatArray, knots: int = 0) -> "Course":
        """Form along some wavelengths, free with so many knots."""
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
        """How many curves are added."""
        return int(self.waves.shape[1])

    def index(self, n: Any, rise: Any, bend: Any, added: Any) -> tuple[Any, Any]:
        """Index and its derivative by the wavelength."""
        u = self.u
        if self.kind == "sellmeier":
            q = 2.0 * n * rise / (n**2 - 1.0)
            found = np.sqrt(1.0 + (n**2 - 1.0) / (1.0 - q * u))
            return found + bend * u**2, ((n * rise / (1.0 - q * u) ** 2) / found + 2.0 * bend * u) * self.u_per_nm
        straight = n + rise * u + bend * u**2
        return straight + self.waves @ added, (rise + 2.0 * bend * u + self.slopes @ added) * self.u_per_nm
