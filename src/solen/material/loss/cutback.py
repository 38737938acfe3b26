"""Loss of a guide by cut-back: the slope of level against length, with its interval.

Every centimetre attenuates the light by the same fraction, so the received level in dB falls linearly with length. The
slope is the loss; the value at length zero contains the effect of the ends and the coupling, which therefore need not
be known. Repeated readings of a guide share its coupling and flaws, so the interval is based on the number of pieces, a
piece being a guide at one length. Outliers are excluded by Rosner's test and reported, together with the result that
includes them. The loss is per length of guide: the longer paths of oblique rays and scattering at the walls contribute
to it.

`cut_back` returns a `GuideLoss`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import BoolArray, FloatArray
from solen.material.loss.levels import MM_PER_CM, absorption_per_mm, smallest_loss_dB_per_cm
from solen.material.loss.pieces import Piece, Table, pieces_of
from solen.material.regression import LinearFit, f_tail, frequency, rosner_outliers, t_quantile, t_tail
from solen.material.warning_prefixes import BY_ORIENTATION
from solen.ranks import Caution, do_not_use, note, warning
from solen.recording import Measured
from solen.results import HIDDEN, Result, reported

MAX_OUTLIER_FRACTION = 0.2
"""Maximum fraction of the pieces that may be excluded; one piece may always be excluded."""
MAX_OUTLIERS = 10
"""Maximum number of pieces that may be excluded."""
SIGNIFICANCE = 0.05
"""A difference or a curvature is reported as significant if its p-value is below this level."""
LAYER_UM, U_T = 25.0, 1e-3
"""Thickness of the paper's layer, and uncertainty of the transmittance from a good spectrophotometer."""


@dataclass(frozen=True)
class Outlier:
    """A piece that deviates from the line through the other pieces.

    Attributes
    ----------
    piece
        The guide at one length.
    deviation_dB
        Deviation from that line, positive above the line.
    t
        Deviation in standard errors.
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
        Loss (minus the slope), its standard uncertainty and 95 % interval.
    start_dB, u_start_dB, interval95_start_dB
        Level at length zero, its standard uncertainty and 95 % interval.
    covariance
        Covariance of the start and the loss.
    degrees_of_freedom, start_degrees_of_freedom
        Degrees of freedom of the intervals of the loss and the start.
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
    """Loss of guides: lines with a common slope and a separate start for each orientation.

    Attributes
    ----------
    start_dB
        Mean start over the orientations.
    by_orientation
        Line of each orientation with a separate slope; empty without orientations, or if there are too few pieces.
    p_orientation
        Probability of slopes at least this different if orientation has no effect; None with fewer than two.
    p_curved, curvature_dB_per_cm2
        Probability of at least this curvature by chance, and the second derivative of the level; None with too few
        lengths or pieces.
    points
        All pieces, including outliers.
    outliers, with_outliers
        Excluded pieces, and the line that includes them; None without outliers.
    sd_piece_dB, sd_guide_dB, sd_reading_dB
        Standard deviations: of pieces about the line; of the starts of guides that were cut to several lengths; of
        readings about the mean of their piece (None if none was repeated).
    wavelength_nm
        Wavelength of the light; None if it is not specified.
    power_unit
        Unit of the readings; None if they are proportional to power, without a unit.
    dark
        Reading without light, in `power_unit`; None if it is not specified.
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
        """Shortest and longest length."""
        lengths = [piece.length_mm for piece in self.points]
        return min(lengths), max(lengths)

    @reported
    def layer_limit_dB_per_cm(self) -> float:
        """Smallest loss that can be detected in the transmittance of one printed layer."""
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
        Guide of each reading; without it, all readings at one length (and orientation) are treated as one guide.
    orientation
        Build orientation of the guide of each reading.
    keep_all
        Include outliers.
    launched_dB
        Level of the launched power, from `solen.material.loss.levels.launched_level_dB`.

    Raises
    ------
    DataError
        If the readings determine no slope with an uncertainty: a single length, or no more pieces than parameters.
    """
    length, level = np.asarray(length_mm, float), np.asarray(level_dB, float)
    orientations = [""] * len(length) if orientation is None else list(orientation)
    names = [f"{mm:g} mm" for mm in length] if guide is None else list(guide)
    points, sd_reading_dB = pieces_of(length, level, names, orientations)
    table = Table(points)
    table.check_size()
    all_points = np.ones(len(points), bool)
    outlier_t = {} if keep_all else _outlier_t(table)
    keep = np.array([number not in outlier_t for number in range(len(points))])
    fit = table.fit(table.common_slope(keep), keep)
    lines, p_orientation = _orientations(table, keep, launched_dB)
    p_curved, curvature = _curvature(table, keep)
    loss = GuideLoss(
        **vars(_common_line(table, fit, keep, launched_dB)),
        by_orientation=lines,
        p_orientation=p_orientation,
        p_curved=p_curved,
        curvature_dB_per_cm2=curvature,
        points=points,
        outliers=_outliers(table, fit, keep, outlier_t),
        with_outliers=_common_line(
            table, table.fit(table.common_slope(all_points), all_points), all_points, launched_dB
        )
        if outlier_t
        else None,
        sd_piece_dB=fit.sigma,
        sd_guide_dB=fit.effect_sigmas[0] if fit.effect_sigmas else 0.0,
        sd_reading_dB=sd_reading_dB,
    )
    warnings = (
        *_piece_warnings(loss),
        *_size_warnings(loss),
        *_shape_warnings(loss),
        *_orientation_warnings(loss),
    )
    return replace(loss, warnings=warnings)


def _outlier_t(table: Table) -> dict[int, float]:
    """Return the t of each outlier from lines with separate slopes for the orientations, keyed by piece number."""
    count = len(table.pieces)
    all_points = np.ones(count, bool)
    df = count - table.separate_slopes(all_points).shape[1]
    max_outliers = min(max(1, int(MAX_OUTLIER_FRACTION * count)), df - 2, MAX_OUTLIERS)
    if max_outliers < 1:
        return {}
    outliers = rosner_outliers(lambda keep: table.fit(table.separate_slopes(keep), keep), count, max_outliers)
    keep = np.array([number not in outliers for number in range(count)])
    is_complete = table.orientations(keep) == table.orientations(all_points) and table.sloped(keep)
    return outliers if is_complete else {}


def _outliers(table: Table, fit: LinearFit, keep: BoolArray, outlier_t: dict[int, float]) -> tuple[Outlier, ...]:
    orientations, outliers = table.orientations(keep), []
    for number, t in outlier_t.items():
        piece = table.pieces[number]
        start, slope = fit.parameters[orientations.index(piece.orientation)], fit.parameters[-1]
        outliers.append(Outlier(piece, float(piece.level_dB - start + slope * piece.length_mm / MM_PER_CM), t))
    return tuple(outliers)


def _common_line(table: Table, fit: LinearFit, keep: BoolArray, launched_dB: float | None) -> Line:
    """Return the line with the mean start of all orientations and the common slope."""
    count = len(table.orientations(keep))
    start, slope = np.append(np.full(count, 1.0 / count), 0.0), np.append(np.zeros(count), 1.0)
    return replace(_line(table, fit, keep, start, slope), launched_dB=launched_dB)


def _line(
    table: Table, fit: LinearFit, keep: BoolArray, start: FloatArray, slope: FloatArray, orientation: str = ""
) -> Line:
    """Return the line whose start and slope are given linear combinations of the fit parameters."""
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
    """Return the line of each orientation, and the probability of slopes at least this different by chance."""
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
    p = _wald_p(fit, slopes[:1] - slopes[1:]) if len(sloped) > 1 else None
    return tuple(replace(line, launched_dB=launched_dB) for line in lines), p


def _wald_p(fit: LinearFit, contrasts: FloatArray) -> float:
    """Return the probability of contrasts at least this far from 0 by chance (Wald's F test)."""
    differences = contrasts @ fit.parameters
    variance = contrasts @ fit.covariance @ contrasts.T
    if not fit.sigma > 0.0:
        return 1.0 if np.allclose(differences, 0.0) else 0.0
    ratio = float(differences @ np.linalg.solve(variance, differences)) / len(contrasts)
    return f_tail(ratio, len(contrasts), min(fit.df(row) for row in contrasts))


def _curvature(table: Table, keep: BoolArray) -> tuple[float | None, float | None]:
    """Return the probability of at least this curvature by chance, and the second derivative; None if unknown."""
    design, cm = table.separate_slopes(keep), table.cm[keep]
    quadratic = np.column_stack([design, (cm - cm.mean()) ** 2])
    if len(cm) <= quadratic.shape[1] or np.linalg.matrix_rank(quadratic) < quadratic.shape[1]:
        return None, None
    fit, last = table.fit(quadratic, keep), np.eye(quadratic.shape[1])[-1]
    coefficient, u = float(fit.parameters[-1]), fit.u(last)
    return (t_tail(coefficient / u, fit.df(last)) if u > 0.0 else 1.0), 2.0 * coefficient


def _piece_warnings(loss: GuideLoss) -> list[Caution]:
    warnings = []
    for outlier in loss.outliers:
        side = "above" if outlier.deviation_dB > 0.0 else "below"
        warnings.append(
            warning(
                f"{outlier.piece.name} is excluded as an outlier: it is {abs(outlier.deviation_dB):.2g} dB "
                f"({abs(outlier.t):.1f} standard errors) {side} the line through the other pieces; inspect it, or "
                "include it with --keep-all"
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


def _size_warnings(loss: GuideLoss) -> list[Caution]:
    low, high = loss.interval95_loss_dB_per_cm
    shortest, longest = loss.lengths_mm
    drop = loss.loss_dB_per_cm * (longest - shortest) / MM_PER_CM
    signal_and_noise = (
        f"from {shortest:g} to {longest:g} mm the level falls by {drop:.2g} dB, while pieces scatter "
        f"by {loss.sd_piece_dB:.2g} dB"
    )
    if high <= 0.0:
        return [
            do_not_use(
                f"longer guides transmit more light ({signal_and_noise}), so this is not a loss; check the lengths, "
                "the dark reading and the unit"
            )
        ]
    if low <= 0.0:
        upper = loss.loss_dB_per_cm + t_quantile(0.9, loss.degrees_of_freedom) * loss.u_loss_dB_per_cm
        return [
            do_not_use(
                f"the loss is not resolved ({signal_and_noise}): it is below {upper:.2g} dB/cm with 95 % confidence; "
                "use longer guides, or more guides"
            )
        ]
    if high - low > loss.loss_dB_per_cm:
        return [
            warning(
                f"the loss is known only to within a factor of {high / low:.1f} ({signal_and_noise}): "
                "use longer guides, or more guides"
            )
        ]
    return []


def _shape_warnings(loss: GuideLoss) -> list[Caution]:
    if loss.lengths == 2:
        return [warning("two lengths cannot show whether the level falls linearly with length; add a third length")]
    if loss.p_curved is None or loss.curvature_dB_per_cm2 is None or loss.p_curved > SIGNIFICANCE:
        return []
    flattens = loss.curvature_dB_per_cm2 > 0.0
    causes = (
        "short guides carry rays that are lost in the first centimetres, or the dark reading was not subtracted"
        if flattens
        else "short guides saturate the receiver, or long ones have defects"
    )
    return [
        warning(
            f"the line {'flattens' if flattens else 'steepens'} with length (expected by chance "
            f"{frequency(loss.p_curved)}), and a single loss does not describe it; possible causes: {causes}"
        )
    ]


def _orientation_warnings(loss: GuideLoss) -> list[Caution]:
    warnings = []
    orientations = dict.fromkeys(piece.orientation for piece in loss.points if piece.orientation)
    evaluated = {line.orientation for line in loss.by_orientation}
    if missing := [orientation for orientation in orientations if orientation not in evaluated]:
        text = f"orientations with too few lengths or pieces for a separate loss: {', '.join(missing)}"
        warnings.append(warning(text))
    if loss.p_orientation is None:
        return warnings
    values = ", ".join(f"{line.orientation}: {line.loss_dB_per_cm:.3g}" for line in loss.by_orientation)
    if loss.p_orientation < SIGNIFICANCE:
        warnings.append(
            warning(
                f"{BY_ORIENTATION} (dB/cm: {values}; expected by chance {frequency(loss.p_orientation)}): "
                "use the value for your orientation, not the overall value"
            )
        )
    else:
        warnings.append(
            note(
                f"no significant difference between orientations (dB/cm: {values}; expected by "
                f"chance {frequency(loss.p_orientation)}); this does not prove that there is none"
            )
        )
    single = [line.orientation for line in loss.by_orientation if line.guides == 1]
    if single:
        warnings.append(
            warning(
                f"orientations with only one guide: {', '.join(single)}; differences in loss may be differences "
                "between guides, not orientations"
            )
        )
    return warnings
