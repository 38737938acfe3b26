"""Loss of a guide by cut-back: the slope of level against length, with its interval.

Light loses the same fraction in every centimetre, so the received level in dB falls linearly with length. The slope is
the loss; the value at length zero contains the effect of the ends and the coupling, which therefore need not be known.
Repeated readings of a guide share its coupling and flaws, so the interval counts pieces, a piece being a guide at one
length. Outliers are excluded by a documented rule and named, with the result that includes them. The loss is per length
of guide: the longer paths of slanted rays and scattering at the walls are included.

`cut_back` returns a `GuideLoss`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import BoolArray, FloatArray
from solen.material.loss.levels import MM_PER_CM, absorption_per_mm, smallest_loss_dB_per_cm
from solen.material.loss.pieces import Piece, Table, pieces_of
from solen.material.regression import LinearFit, chance, f_tail, rosner_outliers, t_quantile, t_tail
from solen.material.warning_prefixes import BY_ORIENTATION
from solen.ranks import Caution, do_not_use, note, warning
from solen.recording import Measured
from solen.results import HIDDEN, Result, reported

MAX_OUTLIERS = 0.2
"""Maximum fraction of the pieces that may be excluded; one piece may always be excluded."""
MAX_EXCLUDED = 10
"""Maximum number of pieces that may be excluded."""
SIGNIFICANCE = 0.05
"""A difference or a curvature is reported if its p-value is below this probability."""
LAYER_UM, U_T = 25.0, 1e-3
"""Thickness of the paper's layer, and the uncertainty of a good spectrophotometer's transmittance."""


@dataclass(frozen=True)
class Outlier:
    """A piece that does not fit the others.

    Attributes
    ----------
    piece
        The guide at a length.
    deviation_dB
        Deviation from the line of the others, positive above it.
    t
        Deviation in units of its standard error.
    """

    piece: Piece
    deviation_dB: float
    t: float


class Line(Result, kw_only=True):
    """Level against length.

    Attributes
    ----------
    orientation
        Build orientation of the guides; empty for all.
    loss_dB_per_cm, u_loss_dB_per_cm, interval95_loss_dB_per_cm
        Loss, which is minus the slope, with its standard uncertainty and 95 % interval.
    start_dB, u_start_dB, interval95_start_dB
        Level at length zero, with its standard uncertainty and 95 % interval.
    covariance
        Covariance of start and slope.
    degrees_of_freedom, start_degrees_of_freedom
        Degrees of freedom of the intervals for the slope and the start.
    guides, pieces, lengths
        Number of guides, pieces and different lengths.
    launched_dB
        Level of the launched power; None if unknown.
    """

    orientation: str
    loss_dB_per_cm: float
    u_loss_dB_per_cm: float
    interval95_loss_dB_per_cm: tuple[float, float]
    start_dB: float
    u_start_dB: float
    interval95_start_dB: tuple[float, float]
    covariance: float = field(metadata=HIDDEN)
    degrees_of_freedom: float
    start_degrees_of_freedom: float
    guides: int
    pieces: int
    lengths: int
    launched_dB: float | None = None

    @reported
    def absorption_per_mm(self) -> float | None:
        """Absorption coefficient of the guide per mm, base e; None if the loss is not positive."""
        return absorption_per_mm(self.loss_dB_per_cm) if self.loss_dB_per_cm > 0.0 else None

    @reported
    def u_absorption_per_mm(self) -> float | None:
        """Standard uncertainty of the absorption coefficient; None if the loss is not positive."""
        return absorption_per_mm(self.u_loss_dB_per_cm) if self.loss_dB_per_cm > 0.0 else None

    @reported
    def interval95_absorption_per_mm(self) -> tuple[float, float]:
        """95 % interval of the absorption coefficient."""
        low, high = self.interval95_loss_dB_per_cm
        return absorption_per_mm(low), absorption_per_mm(high)

    @reported
    def coupling_loss_dB(self) -> float | None:
        """Loss of the coupling and the ends; None if the launched power is unknown."""
        return None if self.launched_dB is None else self.launched_dB - self.start_dB

    @reported
    def u_coupling_loss_dB(self) -> float | None:
        """Standard uncertainty of the coupling loss."""
        return None if self.launched_dB is None else self.u_start_dB

    @reported
    def interval95_coupling_loss_dB(self) -> tuple[float, float] | None:
        """95 % interval of the coupling loss."""
        low, high = self.interval95_start_dB
        return None if self.launched_dB is None else (self.launched_dB - high, self.launched_dB - low)

    def level_dB(self, length_mm: ArrayLike) -> FloatArray:
        """Return the level at a length."""
        return self.start_dB - self.loss_dB_per_cm * np.asarray(length_mm, float) / MM_PER_CM

    def half_width_dB(self, length_mm: ArrayLike) -> FloatArray:
        """Return the half width of the line's 95 % interval at a length."""
        cm = np.asarray(length_mm, float) / MM_PER_CM
        squares = self.u_start_dB**2 - 2.0 * cm * self.covariance + (cm * self.u_loss_dB_per_cm) ** 2
        df = min(self.degrees_of_freedom, self.start_degrees_of_freedom)
        return np.asarray(t_quantile(0.95, df) * np.sqrt(np.maximum(squares, 0.0)))


class GuideLoss(Line, Measured, kw_only=True):
    """Loss of guides: a common line with a single slope and a separate start for each orientation.

    Attributes
    ----------
    start_dB
        Mean start over the orientations.
    by_orientation
        Line for each orientation that has a slope; empty without orientations, or if there are too few pieces.
    p_orientation
        Probability of slopes this different if orientation has no effect; None with fewer than two orientations.
    p_curved, curvature_dB_per_cm2
        Probability of this curvature by chance, and the second derivative; None if there are too few lengths or pieces.
    points
        All pieces, including outliers.
    outliers, with_outliers
        Omitted pieces, and the line that includes them; None without any.
    sd_piece_dB, sd_guide_dB, sd_reading_dB
        Standard deviations: of pieces about the line; of the starts of guides that were cut to several lengths; of
        readings about the mean of their piece (None if none was repeated).
    wavelength_nm
        Wavelength of the light, as specified.
    power_unit
        Unit of the readings; None if they are proportional to power.
    dark
        Specified reading without light, in that unit.
    falls_with_light
        Whether light lowers the readings.
    """

    by_orientation: tuple[Line, ...]
    p_orientation: float | None
    p_curved: float | None
    curvature_dB_per_cm2: float | None
    points: tuple[Piece, ...]
    outliers: tuple[Outlier, ...]
    with_outliers: Line | None
    sd_piece_dB: float
    sd_guide_dB: float
    sd_reading_dB: float | None
    wavelength_nm: float | None = None
    power_unit: str | None = None
    dark: float | None = None
    falls_with_light: bool = False

    @reported
    def readings(self) -> int:
        """Number of readings."""
        return sum(piece.readings for piece in self.points)

    @reported
    def lengths_mm(self) -> tuple[float, float]:
        """Lengths of the shortest and the longest guide."""
        lengths = [piece.length_mm for piece in self.points]
        return min(lengths), max(lengths)

    @reported
    def layer_limit_dB_per_cm(self) -> float:
        """Smallest loss that the transmittance of one printed layer could show."""
        return smallest_loss_dB_per_cm(LAYER_UM, U_T)


def cut_back(
    length_mm: ArrayLike,
    level_dB: ArrayLike,
    guide: Sequence[str] | None = None,
    orientation: Sequence[str] | None = None,
    *,
    keep_all: bool = False,
    launched_dB: float | None = None,
) -> GuideLoss:
    """Fit the loss to the levels of guides of several lengths.

    Parameters
    ----------
    length_mm, level_dB
        Length and level of each reading, shape (n,); levels as from `solen.material.loss.levels.levels_dB`.
    guide
        The guide of each reading; without it, all readings at one length (and orientation) count as a single guide.
    orientation
        Build orientation of each reading.
    keep_all
        Keep outliers.
    launched_dB
        Level of the launched power, from `solen.material.loss.levels.full_level_dB`.

    Raises
    ------
    DataError
        If no slope with an uncertainty follows: a single length, or no more pieces than parameters.
    """
    length, level = np.asarray(length_mm, float), np.asarray(level_dB, float)
    orientations = [""] * len(length) if orientation is None else list(orientation)
    names = [f"{mm:g} mm" for mm in length] if guide is None else list(guide)
    points, within = pieces_of(length, level, names, orientations)
    table = Table(points)
    table.refuse_too_few()
    every = np.ones(len(points), bool)
    bad = {} if keep_all else _bad(table)
    keep = np.array([number not in bad for number in range(len(points))])
    fit = table.fit(table.common_slope(keep), keep)
    lines, p_orientation = _orientations(table, keep, launched_dB)
    p_curved, bend = _curved(table, keep)
    loss = GuideLoss(
        **vars(_common_line(table, fit, keep, launched_dB)),
        by_orientation=lines,
        p_orientation=p_orientation,
        p_curved=p_curved,
        curvature_dB_per_cm2=bend,
        points=points,
        outliers=_outliers(table, fit, keep, bad),
        with_outliers=_common_line(table, table.fit(table.common_slope(every), every), every, launched_dB)
        if bad
        else None,
        sd_piece_dB=fit.sigma,
        sd_guide_dB=fit.effect_sigmas[0] if fit.effect_sigmas else 0.0,
        sd_reading_dB=within,
    )
    return replace(loss, warnings=(*_of_pieces(loss), *_of_size(loss), *_of_shape(loss), *_of_orientation(loss)))


def _bad(table: Table) -> dict[int, float]:
    """Return outliers, each with its t, tested against lines with a slope for each orientation."""
    count = len(table.pieces)
    spare = count - table.separate_slopes(np.ones(count, bool)).shape[1]
    most = min(max(1, int(MAX_OUTLIERS * count)), spare - 2, MAX_EXCLUDED)
    if most < 1:
        return {}
    found = rosner_outliers(lambda keep: table.fit(table.separate_slopes(keep), keep), count, most)
    left = np.array([number not in found for number in range(count)])
    return found if table.orientations(left) == table.orientations(np.ones(count, bool)) and table.sloped(left) else {}


def _outliers(table: Table, fit: LinearFit, keep: BoolArray, bad: dict[int, float]) -> tuple[Outlier, ...]:
    orientations, outliers = table.orientations(keep), []
    for number, t in bad.items():
        piece = table.pieces[number]
        start, slope = fit.parameters[orientations.index(piece.orientation)], fit.parameters[-1]
        outliers.append(Outlier(piece, float(piece.level_dB - start + slope * piece.length_mm / MM_PER_CM), t))
    return tuple(outliers)


def _common_line(table: Table, fit: LinearFit, keep: BoolArray, launched_dB: float | None) -> Line:
    count = len(table.orientations(keep))
    start, slope = np.append(np.full(count, 1.0 / count), 0.0), np.append(np.zeros(count), 1.0)
    return replace(_line(table, fit, keep, start, slope), launched_dB=launched_dB)


def _line(
    table: Table, fit: LinearFit, keep: BoolArray, start: FloatArray, slope: FloatArray, orientation: str = ""
) -> Line:
    """Return the line whose start and slope are the given combinations of a fit's parameters."""
    return Line(
        orientation=orientation,
        loss_dB_per_cm=float(slope @ fit.parameters),
        u_loss_dB_per_cm=fit.u(slope),
        interval95_loss_dB_per_cm=fit.interval(slope),
        start_dB=float(start @ fit.parameters),
        u_start_dB=fit.u(start),
        interval95_start_dB=fit.interval(start),
        covariance=float(start @ fit.covariance @ slope),
        degrees_of_freedom=fit.df(slope),
        start_degrees_of_freedom=fit.df(start),
        guides=len({guide for guide, kept in zip(table.guide, keep.tolist(), strict=True) if kept}),
        pieces=int(keep.sum()),
        lengths=len(table.lengths(keep)),
    )


def _orientations(table: Table, keep: BoolArray, launched_dB: float | None) -> tuple[tuple[Line, ...], float | None]:
    """Return the line of each orientation, and the probability of slopes this different by chance."""
    orientations, sloped, design = table.orientations(keep), table.sloped(keep), table.separate_slopes(keep)
    if orientations == [""] or not sloped or int(keep.sum()) <= design.shape[1]:
        return (), None
    fit, unit = table.fit(design, keep), np.eye(design.shape[1])
    slopes = unit[len(orientations) :]
    lines = [
        _line(
            table,
            fit,
            keep & (table.orientation == orientation),
            unit[orientations.index(orientation)],
            slopes[number],
            orientation,
        )
        for number, orientation in enumerate(sloped)
    ]
    return tuple(replace(line, launched_dB=launched_dB) for line in lines), _chance(
        fit, slopes[:1] - slopes[1:]
    ) if len(sloped) > 1 else None


def _chance(fit: LinearFit, contrasts: FloatArray) -> float:
    """Return the probability of contrasts this far from 0 by chance (Wald's F)."""
    differences = contrasts @ fit.parameters
    variance = contrasts @ fit.covariance @ contrasts.T
    if not fit.sigma > 0.0:
        return 1.0 if np.allclose(differences, 0.0) else 0.0
    ratio = float(differences @ np.linalg.solve(variance, differences)) / len(contrasts)
    return f_tail(ratio, len(contrasts), min(fit.df(row) for row in contrasts))


def _curved(table: Table, keep: BoolArray) -> tuple[float | None, float | None]:
    """Return the probability of this curvature by chance, and the second derivative of the level; None if unknown."""
    design, cm = table.separate_slopes(keep), table.cm[keep]
    bent = np.column_stack([design, (cm - cm.mean()) ** 2])
    if len(cm) <= bent.shape[1] or np.linalg.matrix_rank(bent) < bent.shape[1]:
        return None, None
    fit, last = table.fit(bent, keep), np.eye(bent.shape[1])[-1]
    bend, u = float(fit.parameters[-1]), fit.u(last)
    return (t_tail(bend / u, fit.df(last)) if u > 0.0 else 1.0), 2.0 * bend


def _of_pieces(loss: GuideLoss) -> list[Caution]:
    warnings = []
    for outlier in loss.outliers:
        side = "above" if outlier.deviation_dB > 0.0 else "below"
        warnings.append(
            warning(
                f"{outlier.piece.name} is set aside: it lies {abs(outlier.deviation_dB):.2g} dB "
                f"{side} the line through the other pieces, {abs(outlier.t):.1f} standard errors "
                "away; inspect it, or keep it with --keep-all"
            )
        )
    if loss.with_outliers is not None:
        low, high = loss.with_outliers.interval95_loss_dB_per_cm
        warnings.append(
            warning(
                f"including {'it' if len(warnings) == 1 else 'them'}, the loss is "
                f"{loss.with_outliers.loss_dB_per_cm:.3g} dB/cm, {low:.3g} to {high:.3g}"
            )
        )
    if loss.degrees_of_freedom < 4.0:
        warnings.append(
            warning(
                f"{loss.pieces} pieces of {loss.guides} guides leave {loss.degrees_of_freedom:.1f} "
                f"degrees of freedom, so the interval extends {t_quantile(0.95, loss.degrees_of_freedom):.1f} "
                "standard uncertainties to each side"
            )
        )
    return warnings


def _of_size(loss: GuideLoss) -> list[Caution]:
    low, high = loss.interval95_loss_dB_per_cm
    shortest, longest = loss.lengths_mm
    drop = loss.loss_dB_per_cm * (longest - shortest) / MM_PER_CM
    span = (
        f"from {shortest:g} to {longest:g} mm the level falls by {drop:.2g} dB, while pieces scatter "
        f"by {loss.sd_piece_dB:.2g} dB"
    )
    if high <= 0.0:
        return [
            do_not_use(
                f"longer guides are brighter ({span}), so this is not a loss; check lengths, dark reading and unit"
            )
        ]
    if low <= 0.0:
        most = loss.loss_dB_per_cm + t_quantile(0.9, loss.degrees_of_freedom) * loss.u_loss_dB_per_cm
        return [
            do_not_use(
                f"the loss is not resolved ({span}): it is below {most:.2g} dB/cm with 95 % confidence; "
                "use longer guides or more"
            )
        ]
    if high - low > loss.loss_dB_per_cm:
        return [
            warning(
                f"the loss is known only to within a factor of {high / low:.1f} ({span}): use longer guides or more"
            )
        ]
    return []


def _of_shape(loss: GuideLoss) -> list[Caution]:
    if loss.lengths == 2:
        return [warning("two lengths cannot show whether the level falls along a straight line; add a third length")]
    if loss.p_curved is None or loss.curvature_dB_per_cm2 is None or loss.p_curved > SIGNIFICANCE:
        return []
    flattens = loss.curvature_dB_per_cm2 > 0.0
    why = (
        "short guides carry rays that are soon lost, or the dark reading was not subtracted"
        if flattens
        else "short guides saturate the receiver, or long ones have defects"
    )
    return [
        warning(
            f"the line {'flattens' if flattens else 'steepens'} with length (expected by chance "
            f"{chance(loss.p_curved)}): {why}; a single loss does not describe it"
        )
    ]


def _of_orientation(loss: GuideLoss) -> list[Caution]:
    warnings = []
    named = dict.fromkeys(piece.orientation for piece in loss.points if piece.orientation)
    if flat := [
        orientation for orientation in named if orientation not in {line.orientation for line in loss.by_orientation}
    ]:
        warnings.append(warning(f"too few lengths or pieces for a separate loss: {', '.join(flat)}"))
    if loss.p_orientation is None:
        return warnings
    values = ", ".join(f"{line.orientation}: {line.loss_dB_per_cm:.3g}" for line in loss.by_orientation)
    if loss.p_orientation < SIGNIFICANCE:
        warnings.append(
            warning(
                f"{BY_ORIENTATION} (dB/cm: {values}; expected by chance {chance(loss.p_orientation)}): "
                "use the value for your orientation, not the overall value"
            )
        )
    else:
        warnings.append(
            note(
                f"no significant difference between orientations (dB/cm: {values}; expected by "
                f"chance {chance(loss.p_orientation)}); this does not prove that there is none"
            )
        )
    lone = [line.orientation for line in loss.by_orientation if line.guides == 1]
    if lone:
        warnings.append(warning(f"only one guide for {', '.join(lone)}: this compares guides, not orientations"))
    return warnings
