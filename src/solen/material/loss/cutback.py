"""Loss of a guide by cut-back: the slope of level against length, with its interval.

The idea: light loses the same share in every centimetre, so the received level in dB falls along a straight line with
length. Its slope is the loss; its start, at length zero, is what the ends and the coupling leave, so neither has to be
known. A reading repeated on one guide repeats that guide's coupling and flaws: what the interval counts is pieces, a
guide at a length. A piece that does not belong to the rest is set aside by a stated rule and named, with the result
that has it. Loss is per length of guide: slanted rays run further, walls scatter, and both are in it.

The interface: `cut_back` gives a `CutBack`; `cautions` says in sentences what does not follow from it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import BoolArray, FloatArray
from solen.material.loss.levels import MM_PER_CM, absorption_per_mm
from solen.material.loss.pieces import Piece, Table, pieces_of
from solen.material.regression import LinearFit, bad_points, chance, f_tail, t_quantile, t_tail

MOST_SET_ASIDE = 0.2
"""Share of the pieces, at least one piece, that may be set aside."""
LARGEST_NUMBER = 10
"""And their number."""
DOUBT = 0.05
"""Chance below which a difference or a bend is taken as one."""


@dataclass(frozen=True)
class SetAside:
    """A piece that does not belong to the rest: how many dB it is above the line of the others, and its t there."""

    piece: Piece
    off_dB: float
    t: float


@dataclass(frozen=True)
class Line:
    """Level against length.

    Attributes
    ----------
    orientation
        Build orientation that it is for; empty for all.
    loss_dB_per_cm, u_loss_dB_per_cm, interval95
        Slope, positive where light is lost.
    start_dB, u_start_dB, start_interval95
        Level at length zero.
    covariance
        Of start and slope.
    df, start_df
        Degrees of freedom of the intervals.
    guides, pieces, lengths
        How many of each.
    """

    orientation: str
    loss_dB_per_cm: float
    u_loss_dB_per_cm: float
    interval95: tuple[float, float]
    start_dB: float
    u_start_dB: float
    start_interval95: tuple[float, float]
    covariance: float
    df: float
    start_df: float
    guides: int
    pieces: int
    lengths: int

    @property
    def absorption_per_mm(self) -> float:
        """Loss of power per mm of guide, base e."""
        return absorption_per_mm(self.loss_dB_per_cm)

    @property
    def u_absorption_per_mm(self) -> float:
        """Its standard uncertainty."""
        return absorption_per_mm(self.u_loss_dB_per_cm)

    def level_dB(self, length_mm: ArrayLike) -> FloatArray:
        """Level at a length."""
        return self.start_dB - self.loss_dB_per_cm * np.asarray(length_mm, float) / MM_PER_CM

    def half_width_dB(self, length_mm: ArrayLike) -> FloatArray:
        """Half width of the line's 95 % interval at a length."""
        cm = np.asarray(length_mm, float) / MM_PER_CM
        squares = self.u_start_dB**2 - 2.0 * cm * self.covariance + (cm * self.u_loss_dB_per_cm) ** 2
        return np.asarray(t_quantile(0.95, min(self.df, self.start_df)) * np.sqrt(np.maximum(squares, 0.0)))


@dataclass(frozen=True)
class CutBack:
    """Result of `cut_back`.

    Attributes
    ----------
    line
        One slope for all pieces; each orientation has a start of its own, of which the mean is given.
    by_orientation
        Each orientation that has a slope, with its own; empty where none is stated, or pieces are too few.
    p_orientation
        How likely slopes this different are where orientation does not matter; None with fewer than two.
    p_curved, curvature_dB_per_cm2
        The same for a bend of the line, and its second derivative; None where there are too few lengths or pieces.
    pieces
        All, those set aside too.
    set_aside, line_with_all
        Pieces that the line does without, and the line that has them.
    piece_dB, guide_dB, reading_dB
        Standard deviations: of pieces about the line; of the starts of guides that were cut to several lengths; of
        readings about their piece (None where none was repeated).
    """

    line: Line
    by_orientation: tuple[Line, ...]
    p_orientation: float | None
    p_curved: float | None
    curvature_dB_per_cm2: float | None
    pieces: tuple[Piece, ...]
    set_aside: tuple[SetAside, ...]
    line_with_all: Line
    piece_dB: float
    guide_dB: float
    reading_dB: float | None


def cut_back(
    length_mm: ArrayLike,
    level_dB: ArrayLike,
    guide: Sequence[str] | None = None,
    orientation: Sequence[str] | None = None,
    *,
    keep_all: bool = False,
) -> CutBack:
    """Loss from the levels of guides of several lengths.

    Parameters
    ----------
    length_mm, level_dB
        Shape (n,), one entry a reading; levels as `solen.material.loss.levels.levels_dB` gives them.
    guide
        Which guide was read; without it all readings at one length (and orientation) are taken as those of one guide.
    orientation
        How it was built.
    keep_all
        Set no piece aside.

    Raises
    ------
    DataError
        Where no slope with an uncertainty follows: one length, or no more pieces than numbers to find.
    """
    length, level = np.asarray(length_mm, float), np.asarray(level_dB, float)
    ways = [""] * len(length) if orientation is None else list(orientation)
    names = [f"{mm:g} mm" for mm in length] if guide is None else list(guide)
    pieces, within = pieces_of(length, level, names, ways)
    table = Table(pieces)
    table.refuse_too_few()
    bad = {} if keep_all else _bad(table)
    keep = np.array([number not in bad for number in range(len(pieces))])
    fit = table.fit(table.common(keep), keep)
    lines, p_orientation = _orientations(table, keep)
    p_curved, bend = _curved(table, keep)
    line = _common_line(table, fit, keep)
    return CutBack(
        line=line,
        by_orientation=lines,
        p_orientation=p_orientation,
        p_curved=p_curved,
        curvature_dB_per_cm2=bend,
        pieces=pieces,
        set_aside=_set_aside(table, fit, keep, bad),
        line_with_all=_line_with_all(table) if bad else line,
        piece_dB=fit.sigma,
        guide_dB=fit.effect_sigmas[0] if fit.effect_sigmas else 0.0,
        reading_dB=within,
    )


def _bad(table: Table) -> dict[int, float]:
    """Pieces to set aside, each with its t; the lines they are judged by have a slope for each orientation."""
    count = len(table.pieces)
    spare = count - table.apart(np.ones(count, bool)).shape[1]
    most = min(max(1, int(MOST_SET_ASIDE * count)), spare - 2, LARGEST_NUMBER)
    if most < 1:
        return {}
    found = bad_points(lambda keep: table.fit(table.apart(keep), keep), count, most)
    left = np.array([number not in found for number in range(count)])
    return found if table.ways(left) == table.ways(np.ones(count, bool)) and table.sloped(left) else {}


def _set_aside(table: Table, fit: LinearFit, keep: BoolArray, bad: dict[int, float]) -> tuple[SetAside, ...]:
    ways, found = table.ways(keep), []
    for number, t in bad.items():
        piece = table.pieces[number]
        start, slope = fit.parameters[ways.index(piece.orientation)], fit.parameters[-1]
        found.append(SetAside(piece, float(piece.level_dB - start + slope * piece.length_mm / MM_PER_CM), t))
    return tuple(found)


def _line_with_all(table: Table) -> Line:
    everything = np.ones(len(table.pieces), bool)
    return _common_line(table, table.fit(table.common(everything), everything), everything)


def _common_line(table: Table, fit: LinearFit, keep: BoolArray) -> Line:
    count = len(table.ways(keep))
    start, slope = np.append(np.full(count, 1.0 / count), 0.0), np.append(np.zeros(count), 1.0)
    return _line(table, fit, keep, start, slope)


def _line(table: Table, fit: LinearFit, keep: BoolArray, start: FloatArray, slope: FloatArray, way: str = "") -> Line:
    """Line whose start and slope are these combinations of a fit's parameters."""
    return Line(
        orientation=way,
        loss_dB_per_cm=float(slope @ fit.parameters),
        u_loss_dB_per_cm=fit.u(slope),
        interval95=fit.interval(slope),
        start_dB=float(start @ fit.parameters),
        u_start_dB=fit.u(start),
        start_interval95=fit.interval(start),
        covariance=float(start @ fit.covariance @ slope),
        df=fit.df(slope),
        start_df=fit.df(start),
        guides=len({guide for guide, kept in zip(table.guide, keep.tolist(), strict=True) if kept}),
        pieces=int(keep.sum()),
        lengths=len(table.lengths(keep)),
    )


def _orientations(table: Table, keep: BoolArray) -> tuple[tuple[Line, ...], float | None]:
    """Line of each orientation, and how likely their slopes differ this much by chance."""
    ways, sloped, design = table.ways(keep), table.sloped(keep), table.apart(keep)
    if ways == [""] or not sloped or int(keep.sum()) <= design.shape[1]:
        return (), None
    fit, unit = table.fit(design, keep), np.eye(design.shape[1])
    slopes = unit[len(ways) :]
    lines = [
        _line(table, fit, keep & (table.way == way), unit[ways.index(way)], slopes[number], way)
        for number, way in enumerate(sloped)
    ]
    return tuple(lines), _chance(fit, slopes[:1] - slopes[1:]) if len(sloped) > 1 else None


def _chance(fit: LinearFit, contrasts: FloatArray) -> float:
    """How likely contrasts are this far from 0 by chance (Wald's F)."""
    differences = contrasts @ fit.parameters
    variance = contrasts @ fit.covariance @ contrasts.T
    if not fit.sigma > 0.0:
        return 1.0 if np.allclose(differences, 0.0) else 0.0
    ratio = float(differences @ np.linalg.solve(variance, differences)) / len(contrasts)
    return f_tail(ratio, len(contrasts), min(fit.df(row) for row in contrasts))


def _curved(table: Table, keep: BoolArray) -> tuple[float | None, float | None]:
    """How likely a bend this strong is by chance, and the second derivative of the level; None where it is unknown."""
    design, cm = table.apart(keep), table.cm[keep]
    bent = np.column_stack([design, (cm - cm.mean()) ** 2])
    if len(cm) <= bent.shape[1] or np.linalg.matrix_rank(bent) < bent.shape[1]:
        return None, None
    fit, last = table.fit(bent, keep), np.eye(bent.shape[1])[-1]
    bend, u = float(fit.parameters[-1]), fit.u(last)
    return (t_tail(bend / u, fit.df(last)) if u > 0.0 else 1.0), 2.0 * bend


def cautions(found: CutBack) -> list[str]:
    """What a result does not say, in sentences with numbers."""
    return [
        *_of_pieces(found),
        *_of_size(found),
        *_of_shape(found),
        *_of_orientation(found),
    ]


def _of_pieces(found: CutBack) -> list[str]:
    told = []
    low, high = found.line_with_all.interval95
    for bad in found.set_aside:
        side = "above" if bad.off_dB > 0.0 else "below"
        told.append(
            f"{bad.piece.name} is set aside: {abs(bad.off_dB):.2g} dB {side} the line of the others, "
            f"{abs(bad.t):.1f} of its standard errors; look at it, or keep it with --keep-all"
        )
    if told:
        told.append(
            f"with {'it' if len(told) == 1 else 'them'} the loss is "
            f"{found.line_with_all.loss_dB_per_cm:.3g} dB/cm, {low:.3g} to {high:.3g}"
        )
    if found.line.df < 4.0:
        told.append(
            f"{found.line.pieces} pieces of {found.line.guides} guides leave {found.line.df:.1f} degrees of freedom: "
            f"the interval is {t_quantile(0.95, found.line.df):.1f} standard uncertainties to each side"
        )
    return told


def _of_size(found: CutBack) -> list[str]:
    line, told = found.line, []
    low, high = line.interval95
    lengths = [piece.length_mm for piece in found.pieces]
    drop = line.loss_dB_per_cm * (max(lengths) - min(lengths)) / MM_PER_CM
    span = (
        f"from {min(lengths):g} to {max(lengths):g} mm the level falls by {drop:.2g} dB, and pieces scatter by "
        f"{found.piece_dB:.2g} dB"
    )
    if high <= 0.0:
        told.append(f"longer guides are brighter ({span}): this is no loss; check lengths, dark reading and unit")
    elif low <= 0.0:
        most = line.loss_dB_per_cm + t_quantile(0.9, line.df) * line.u_loss_dB_per_cm
        told.append(f"the loss is not resolved ({span}): below {most:.2g} dB/cm with 95 %; take longer guides or more")
    elif high - low > line.loss_dB_per_cm:
        told.append(f"the loss is known within a factor {high / low:.1f} only ({span}): take longer guides or more")
    return told


def _of_shape(found: CutBack) -> list[str]:
    if found.line.lengths == 2:
        return ["two lengths: whether the level falls along a straight line cannot be told; add a third"]
    if found.p_curved is None or found.curvature_dB_per_cm2 is None or found.p_curved > DOUBT:
        return []
    flattens = found.curvature_dB_per_cm2 > 0.0
    why = (
        "short guides carry rays that leave soon, or the dark reading is not taken off"
        if flattens
        else "short guides saturate the receiver, or long ones have defects"
    )
    return [
        f"the line {'flattens' if flattens else 'steepens'} with length (by chance {chance(found.p_curved)}): {why}; "
        "one loss does not describe it"
    ]


def _of_orientation(found: CutBack) -> list[str]:
    told = []
    named = dict.fromkeys(piece.orientation for piece in found.pieces if piece.orientation)
    if flat := [way for way in named if way not in {line.orientation for line in found.by_orientation}]:
        told.append(f"too few lengths or pieces for a loss of its own: {', '.join(flat)}")
    if found.p_orientation is None:
        return told
    values = ", ".join(f"{line.orientation}: {line.loss_dB_per_cm:.3g}" for line in found.by_orientation)
    if found.p_orientation < DOUBT:
        told.append(
            f"the loss depends on the build orientation (dB/cm: {values}; by chance {chance(found.p_orientation)}): "
            "use the value of your orientation, not the common one"
        )
    else:
        told.append(
            f"no difference between orientations is seen (dB/cm: {values}; by chance {chance(found.p_orientation)}); "
            "that is no proof that there is none"
        )
    lone = [line.orientation for line in found.by_orientation if line.guides == 1]
    if lone:
        told.append(f"one guide each for {', '.join(lone)}: guides are compared there, not orientations")
    return told
