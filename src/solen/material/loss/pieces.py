"""Pieces of guide, the independent points of a cut-back, and the straight lines through them.

A guide at one length is one piece, regardless of the number of readings. There are two models of the lines:
`Table.common_slope` has one slope for all pieces and a start for each orientation, and `Table.separate_slopes` has a
start and a slope for each orientation. The start and slope of a guide that was cut to several lengths deviate from the
line by random effects.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError
from solen.material.loss.levels import MM_PER_CM
from solen.material.regression import LinearFit, fitted, group_covariance, group_means

LENGTHS_MM = (1e-3, 1e6)
"""Range of lengths that a guide may have."""


@dataclass(frozen=True)
class Piece:
    """A guide at one length.

    Attributes
    ----------
    guide, orientation
        Name of the guide and its build orientation, from the table.
    length_mm, level_dB
        Length, and mean level of the readings.
    readings
        Number of readings.
    """

    guide: str
    orientation: str
    length_mm: float
    level_dB: float
    readings: int

    @property
    def name(self) -> str:
        """Name of the piece in messages."""
        orientation = f", {self.orientation}" if self.orientation else ""
        return f"guide {self.guide} ({self.length_mm:g} mm{orientation})"


def pieces_of(
    length_mm: FloatArray, level_dB: FloatArray, guide: Sequence[str], orientation: Sequence[str]
) -> tuple[tuple[Piece, ...], float | None]:
    """Return the pieces with mean levels, and the standard deviation of repeated readings of a piece (None if none).

    Raises
    ------
    DataError
        If a length is impossible, or a level is not a number.
    """
    shortest, longest = LENGTHS_MM
    is_valid = (length_mm >= shortest) & (length_mm <= longest)
    for name, values, valid in (("length", length_mm, is_valid), ("level", level_dB, np.isfinite(level_dB))):
        invalid = np.flatnonzero(~valid)
        if len(invalid):
            value = f"{values[invalid[0]]:g} (reading {invalid[0] + 1})"
            limit = f"must be from {shortest:g} to {longest:g} mm" if name == "length" else "must be a number"
            raise DataError(f"cut-back: {name}", value=value, limit=limit, remedy="correct or remove the row")
    keys = list(zip(guide, orientation, length_mm.tolist(), strict=True))
    means, counts = group_means(keys, level_dB), Counter(keys)
    df = len(keys) - len(means)
    residuals = level_dB - [means[key] for key in keys]
    sd = math.sqrt(float(np.sum(residuals**2)) / df) if df else None
    return tuple(Piece(*key, level, counts[key]) for key, level in means.items()), sd


@dataclass(frozen=True)
class Table:
    """Pieces as arrays; the masks of the methods select pieces."""

    pieces: tuple[Piece, ...]

    @cached_property
    def cm(self) -> FloatArray:
        """Lengths in cm."""
        return np.array([piece.length_mm for piece in self.pieces]) / MM_PER_CM

    @cached_property
    def level(self) -> FloatArray:
        """Levels in dB."""
        return np.array([piece.level_dB for piece in self.pieces])

    @cached_property
    def guide(self) -> list[tuple[str, str]]:
        """Guide of each piece; the same name in two orientations means two guides."""
        return [(piece.orientation, piece.guide) for piece in self.pieces]

    @cached_property
    def orientation(self) -> NDArray[np.str_]:
        """Orientation of each piece."""
        return np.array([piece.orientation for piece in self.pieces])

    def orientations(self, keep: BoolArray) -> list[str]:
        """Return the orientations of the selected pieces."""
        return list(dict.fromkeys(self.orientation[keep].tolist()))

    def lengths(self, keep: BoolArray) -> list[float]:
        """Return the different lengths of the selected pieces in cm, in ascending order."""
        return sorted(set(self.cm[keep].tolist()))

    def sloped(self, keep: BoolArray) -> list[str]:
        """Return the orientations with at least two lengths among the selected pieces."""
        return [
            orientation
            for orientation in self.orientations(keep)
            if len(self.lengths(keep & (self.orientation == orientation))) > 1
        ]

    def cut_guides(self, keep: BoolArray) -> int:
        """Return the number of selected guides that were cut to several lengths."""
        guides = [guide for guide, kept in zip(self.guide, keep.tolist(), strict=True) if kept]
        return sum(guides.count(guide) > 1 for guide in set(guides))

    def common_slope(self, keep: BoolArray) -> FloatArray:
        """Return the design matrix of a common slope: a start per orientation, then the slope."""
        return np.column_stack([self._starts(keep), -self.cm[keep]])

    def separate_slopes(self, keep: BoolArray) -> FloatArray:
        """Return the design matrix of separate slopes: a start per orientation, then a slope for each of `sloped`."""
        slopes = [-self.cm[keep] * (self.orientation[keep] == orientation) for orientation in self.sloped(keep)]
        return np.column_stack([self._starts(keep), *slopes])

    def fit(self, design: FloatArray, keep: BoolArray) -> LinearFit:
        """Fit a design matrix to the selected pieces."""
        guide = [self.guide[index] for index in np.flatnonzero(keep)]
        factors = (None, self.cm[keep] - self.cm[keep].mean()) if self.cut_guides(keep) > 1 else (None,)
        effects = [effect for factor in factors if (effect := group_covariance(guide, factor)) is not None]
        return fitted(design, self.level[keep], effects=effects)

    def check_size(self) -> None:
        """Raise `DataError` if the pieces do not determine a slope and its uncertainty."""
        keep = np.ones(len(self.pieces), bool)
        lengths = self.lengths(keep)
        remedy = "measure guides of at least three lengths, several at each length"
        if not self.sloped(keep):
            value = f"{lengths[0] * MM_PER_CM:g} mm" if len(lengths) == 1 else None
            where = "" if value else " in each orientation"
            limit = f"a single length{where} determines no slope"
            raise DataError("cut-back: length", value=value, limit=limit, remedy=remedy)
        if len(self.pieces) <= (parameters := len(self.orientations(keep)) + 1):
            limit = (
                f"must be more than the number of fitted parameters, {parameters}, for an uncertainty (a guide at one "
                "length is one piece, regardless of the number of readings)"
            )
            raise DataError("cut-back: number of pieces", value=len(self.pieces), limit=limit, remedy=remedy)

    def _starts(self, keep: BoolArray) -> FloatArray:
        """Return the columns of a design matrix for a start per orientation."""
        return np.column_stack(
            [(self.orientation[keep] == orientation).astype(float) for orientation in self.orientations(keep)]
        )
