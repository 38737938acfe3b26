"""Dispersion: the refractive index against wavelength, with its uncertainty.

An index is a number, a table, or a formula with a few parameters. If a covariance of the parameters is specified, the
standard uncertainty of the index follows by linear propagation, u² = J Σ Jᵀ, where J contains the exact derivatives
with respect to the parameters. Outside the measured range, an index raises an error instead of extrapolating. An index
also has a `mode`, which specifies how it was determined, and warnings; an index computed as published, without a
measured reflectance, must have a warning.

`Dispersion.index` and `Dispersion.u_index` evaluate an index at a wavelength in nm. The subclasses are `Constant`,
`Tabulated`, `Cauchy` and `Sellmeier`, listed by ``kind`` in `KINDS`, and `Unknown` for a resin without an index.
"""

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from solen.arrays import FloatArray
from solen.errors import DataError, SolenError
from solen.spec.strict import NotNegative, Number, Positive, Strict, Text, nearest, refused
from solen.units import um_from_nm

Covariance = tuple[tuple[Number, ...], ...]

MODES = ("measured", "absorptance", "lossless", "fringes", "joint", "as-published", "refractometer", "literature")
"""How an index was determined: from R and T; from T and absorptance; from T alone; from fringes; jointly with the bare
substrate; from T and an absorbance used as an absorptance; with a refractometer or ellipsometer; from the literature.
"""
AS_PUBLISHED = "as-published"

_ROUNDING = 1e-9  # tolerated asymmetry and negative eigenvalues, relative to the variances


def check_covariance(covariance: Sequence[Sequence[float]] | None, parameters: int) -> None:
    """Raise if a covariance is not symmetric and positive semidefinite with one row and column per parameter."""
    if covariance is None:
        return
    if len(covariance) != parameters or any(len(row) != parameters for row in covariance):
        shape = f"{len(covariance)} rows of {', '.join(str(n) for n in sorted({len(row) for row in covariance}))}"
        raise refused("covariance", f"must be {parameters} by {parameters}, one row per parameter", value=shape)
    matrix = np.array(covariance)
    if (np.diag(matrix) < 0).any():
        raise refused("covariance", "must not have negative variances", value=float(np.diag(matrix).min()))
    spread = np.sqrt(np.diag(matrix))
    spread[spread == 0] = 1.0
    correlation = matrix / np.outer(spread, spread)  # parameters differ by orders of magnitude, so they are scaled
    if (gap := float(np.abs(correlation - correlation.T).max())) > _ROUNDING:
        limit = f"must be symmetric: rows and columns differ by {gap:.3g}, relative to the standard deviations"
        raise refused("covariance", limit)
    if (lowest := float(np.linalg.eigvalsh(correlation).min())) < -_ROUNDING:
        raise refused("covariance", "must not have negative eigenvalues", value=lowest)


def _propagated(covariance: Covariance | None, jacobian: Sequence[float]) -> float | None:
    """Return the variance J Σ Jᵀ, or None without a covariance."""
    if covariance is None:
        return None
    row = np.array(jacobian)
    return max(float(row @ np.array(covariance) @ row), 0.0)


class Dispersion(Strict, ABC):
    """A refractive index that depends on wavelength."""

    table: ClassVar[str] = "index"
    kind: str
    error: ClassVar[type[SolenError]] = DataError

    valid_nm: tuple[Positive, Positive] | None = Field(
        None, description="Lowest and highest wavelength for which the index is valid, in nm."
    )
    mode: str = Field("", description=f"How the index was determined: {', '.join(MODES)}.")
    warnings: tuple[Text, ...] = Field((), description="Warnings, one sentence each.")

    @model_validator(mode="after")
    def _check_mode(self) -> Self:
        if self.mode and self.mode not in MODES:
            near = nearest(self.mode, MODES)
            limit = f"must be one of {', '.join(MODES)}"
            raise refused("mode", limit, value=self.mode, remedy=f"did you mean {near}?" if near else "")
        if self.mode == AS_PUBLISHED and not self.warnings:
            remedy = 'add, for example, warnings = ["computed without a measured reflectance"]'
            raise refused(
                "warnings", f'is missing: mode = "{AS_PUBLISHED}" requires at least one warning', remedy=remedy
            )
        return self

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if self.valid_nm is not None and not self.valid_nm[0] < self.valid_nm[1]:
            raise refused("valid_nm", "must be in ascending order, [from, to]", value=list(self.valid_nm))
        return self

    @property
    def range_nm(self) -> tuple[float, float]:
        """Lowest and highest wavelength for which the index is known, in nm."""
        return self.valid_nm or self._data_range_nm()

    def index(self, wavelength_nm: float) -> float:
        """Return the refractive index at a wavelength in nm.

        Raises
        ------
        DataError
            If the wavelength is outside `range_nm`, or the formula gives an index below 1 or one that is not finite.
        """
        self._refuse_outside(wavelength_nm)
        try:
            index = self._index(wavelength_nm)
        except (ArithmeticError, ValueError):  # a pole, an overflow, the root of a negative square
            index = math.nan
        if not 1 <= index < math.inf:
            raise DataError(
                f"index at {wavelength_nm:g} nm",
                value=index,
                limit="must be finite and at least 1",
                remedy="check the coefficients and their units (µm), or narrow valid_nm",
            )
        return index

    def u_index(self, wavelength_nm: float) -> float | None:
        """Return the standard uncertainty of the index at a wavelength in nm, or None if it is unknown.

        Raises
        ------
        DataError
            In the same cases as `index`.
        """
        self.index(wavelength_nm)
        variance = self._variance(wavelength_nm)
        return None if variance is None else math.sqrt(variance)

    def indices(self, wavelength_nm: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the index and its standard uncertainty at several wavelengths in nm; an unknown uncertainty is NaN.

        Raises
        ------
        DataError
            In the same cases as `index`.
        """
        wavelengths = np.atleast_1d(np.asarray(wavelength_nm, dtype=float)).tolist()
        u = np.array([self.u_index(nm) for nm in wavelengths], dtype=float)
        return np.array([self.index(nm) for nm in wavelengths]), u

    def _refuse_outside(self, wavelength_nm: float) -> None:
        low, high = self.range_nm
        if not (low <= wavelength_nm <= high and 0 < wavelength_nm < math.inf):
            limit = (
                f"is known only from {low:g} to {high:g} nm" if high < math.inf else "requires a wavelength above 0 nm"
            )
            remedy = "choose a wavelength inside this range, or use data that include it"
            raise DataError(f"index at {wavelength_nm:g} nm", limit=limit, remedy=remedy)

    def _data_range_nm(self) -> tuple[float, float]:
        """Return the range of the data; that of a formula is unlimited."""
        return 0.0, math.inf

    @abstractmethod
    def _index(self, wavelength_nm: float) -> float:
        """Return the index without any check."""

    @abstractmethod
    def _variance(self, wavelength_nm: float) -> float | None:
        """Return the variance of the index, or None if it is unknown."""


class Unknown(Dispersion):
    """Unknown index, for a resin of which only other properties are known."""

    kind: Literal["unknown"] = "unknown"

    def _refuse_outside(self, wavelength_nm: float) -> None:
        limit = "is unknown: the resin has no index"
        remedy = "add [index], for example with solen resin build --index"
        raise DataError(f"index at {wavelength_nm:g} nm", limit=limit, remedy=remedy)

    def _data_range_nm(self) -> tuple[float, float]:
        return 0.0, 0.0

    def _index(self, wavelength_nm: float) -> float:
        raise NotImplementedError

    def _variance(self, wavelength_nm: float) -> float | None:
        raise NotImplementedError


class Constant(Dispersion):
    """One index for all wavelengths within `valid_nm`."""

    kind: Literal["number"] = "number"
    n: Positive = Field(ge=1, lt=5, description="refractive index, at least 1 and below 5.")
    u_n: NotNegative | None = Field(None, description="Standard uncertainty of n.")

    def _index(self, wavelength_nm: float) -> float:  # noqa: ARG002
        return self.n

    def _variance(self, wavelength_nm: float) -> float | None:  # noqa: ARG002
        return None if self.u_n is None else self.u_n**2


class Tabulated(Dispersion):
    """Measured indices, interpolated linearly, without a dispersion formula."""

    kind: Literal["table"] = "table"
    wavelength_nm: tuple[Positive, ...] = Field(min_length=2, description="wavelengths in nm, in ascending order.")
    n: tuple[Number, ...] = Field(min_length=2, description="index at each wavelength.")
    covariance: Covariance | None = Field(None, description="Covariance of the entries of n.")
    u_n: tuple[NotNegative, ...] | None = Field(
        None, description="Standard uncertainty of each n, assumed fully correlated; alternative to a covariance."
    )

    @model_validator(mode="after")
    def _check_table(self) -> Self:
        if len(self.n) != len(self.wavelength_nm):
            raise refused("n", f"must have {len(self.wavelength_nm)} entries, one per wavelength", value=len(self.n))
        for low, high in pairwise(self.wavelength_nm):
            if not low < high:
                limit = "must be in ascending order"
                raise refused("wavelength_nm", limit, value=[low, high], remedy="sort the table")
        if min(self.n) < 1:
            raise refused("n", "must be at least 1", value=min(self.n))
        low, high = self._data_range_nm()
        if self.valid_nm is not None and not low <= self.valid_nm[0] < self.valid_nm[1] <= high:
            raise refused("valid_nm", f"must be within the table, {low:g} to {high:g}", value=list(self.valid_nm))
        check_covariance(self.covariance, len(self.n))
        if self.u_n is not None and self.covariance is not None:
            raise refused("u_n", "cannot be combined with covariance", remedy="keep one of the two")
        if self.u_n is not None and len(self.u_n) != len(self.n):
            raise refused("u_n", f"must have {len(self.n)} entries, one per wavelength", value=len(self.u_n))
        return self

    def _data_range_nm(self) -> tuple[float, float]:
        return self.wavelength_nm[0], self.wavelength_nm[-1]

    def _weights(self, wavelength_nm: float) -> tuple[float, ...]:
        """Return the weight of each entry in the interpolated index."""
        right = min(bisect_right(self.wavelength_nm, wavelength_nm), len(self.n) - 1)
        low, high = self.wavelength_nm[right - 1], self.wavelength_nm[right]
        weight = (wavelength_nm - low) / (high - low)
        return (*(0.0,) * (right - 1), 1 - weight, weight, *(0.0,) * (len(self.n) - right - 1))

    def _index(self, wavelength_nm: float) -> float:
        return sum(w * n for w, n in zip(self._weights(wavelength_nm), self.n, strict=True) if w)

    def _variance(self, wavelength_nm: float) -> float | None:
        weights = self._weights(wavelength_nm)
        if self.u_n is not None:
            return sum(w * u for w, u in zip(weights, self.u_n, strict=True)) ** 2
        return _propagated(self.covariance, weights)


class Cauchy(Dispersion):
    """Cauchy's formula n = A + B/λ² + C/λ⁴, λ in µm, for transparent materials far from absorption bands."""

    kind: Literal["cauchy"] = "cauchy"
    A: Number = Field(description="constant term.")
    B_um2: Number = Field(0.0, description="Coefficient of 1/λ² in µm².")
    C_um4: Number = Field(0.0, description="Coefficient of 1/λ⁴ in µm⁴.")
    covariance: Covariance | None = Field(None, description="Covariance of (A, B_um2, C_um4).")

    @model_validator(mode="after")
    def _check_covariance(self) -> Self:
        check_covariance(self.covariance, 3)
        return self

    def _index(self, wavelength_nm: float) -> float:
        square = um_from_nm(wavelength_nm) ** 2
        return self.A + self.B_um2 / square + self.C_um4 / square**2

    def _variance(self, wavelength_nm: float) -> float | None:
        square = um_from_nm(wavelength_nm) ** 2
        return _propagated(self.covariance, (1.0, 1 / square, 1 / square**2))


class Sellmeier(Dispersion):
    """Sellmeier's formula n² = 1 + Σ B λ²/(λ² − C), λ in µm, with any number of terms."""

    kind: Literal["sellmeier"] = "sellmeier"
    B: tuple[Number, ...] = Field(min_length=1, description="strength of each term.")
    C_um2: tuple[NotNegative, ...] = Field(
        min_length=1, description="square of each term's resonance wavelength in µm²."
    )
    covariance: Covariance | None = Field(None, description="Covariance of (B..., C_um2...).")

    @model_validator(mode="after")
    def _check_terms(self) -> Self:
        if len(self.B) != len(self.C_um2):
            raise refused("C_um2", f"must have {len(self.B)} entries, one per B", value=len(self.C_um2))
        check_covariance(self.covariance, 2 * len(self.B))
        return self

    def _index(self, wavelength_nm: float) -> float:
        square = um_from_nm(wavelength_nm) ** 2
        return math.sqrt(1 + sum(b * square / (square - c) for b, c in zip(self.B, self.C_um2, strict=True)))

    def _variance(self, wavelength_nm: float) -> float | None:
        square, twice = um_from_nm(wavelength_nm) ** 2, 2 * self._index(wavelength_nm)
        by_b = [square / (square - c) / twice for c in self.C_um2]
        by_c = [b * square / (square - c) ** 2 / twice for b, c in zip(self.B, self.C_um2, strict=True)]
        return _propagated(self.covariance, by_b + by_c)


KINDS: dict[str, type[Dispersion]] = {
    "number": Constant,
    "table": Tabulated,
    "cauchy": Cauchy,
    "sellmeier": Sellmeier,
}
