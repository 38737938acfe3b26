"""A sensor's recordings to its response and numbers, and several sensors side by side.

The idea: one recording gives its cycles, of which the first is left out as in the paper: the material and the stage
settle in it. All recordings of one sensor lie on one grid, so that their ways are pooled. Sensors are the replicates:
their mean and standard deviation are those of their mean curves, n is the number of prints.

The interface: `analysed` of a sensor's `Signals`; `beside` of several sensors gives a `Group`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.analysis.clipping import clipped
from solen.analysis.motion import Motion, find_motion
from solen.analysis.numbers import receiver_numbers
from solen.analysis.response import Curve, Passes, common_range, curve, grid_deg, nice_step, passes
from solen.analysis.sides import pair_numbers, sign_warnings
from solen.analysis.signals import Signals, pair
from solen.arrays import FloatArray
from solen.errors import DataError

_SETTLE = 0.2
"""Share of a hold at its beginning that its noise is not taken from."""
_LEAST_HOLD = 8
_TENTH = 0.1
_ROUNDING_V = 1e-9


@dataclass(frozen=True)
class Settings:
    """How recordings are analysed.

    Attributes
    ----------
    drop_cycles
        Cycles at the beginning of each recording that are not used.
    step_deg
        Step of the grid of angles; None for one that fits the range.
    rails_V
        Lowest and highest voltage that the recorder shows, where they are known.
    dark_V
        Voltage of a receiver without light, where it is known.
    """

    drop_cycles: int = 1
    step_deg: float | None = None
    rails_V: tuple[float, float] | None = None
    dark_V: float | None = None


@dataclass(frozen=True)
class Run:
    """One recording: its motion, the places of the cycles that are used, and which samples are clipped, (n, m)."""

    signals: Signals
    motion: Motion
    used: tuple[int, ...]
    clipped: NDArray[np.bool_]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Analysed:
    """One sensor.

    Attributes
    ----------
    label, lens, receivers
        As in `Signals`.
    runs
        Its recordings.
    passes
        Ways of all of them on one grid.
    numbers
        Of each receiver, by its name.
    pair
        Numbers of left and right together; None where the names do not tell them.
    warnings
        What cannot be concluded.
    """

    label: str
    lens: bool | None
    receivers: tuple[str, ...]
    runs: tuple[Run, ...]
    passes: Passes
    numbers: dict[str, dict[str, Any]]
    pair: dict[str, Any] | None
    warnings: tuple[str, ...]

    def curve(self, receiver: int, direction: int | None = None) -> Curve:
        """Mean and spread of a receiver: of the rising ways (0), the falling (1), or of both."""
        ways = self.passes.of(receiver)
        chosen = slice(None) if direction is None else slice(direction, direction + 1)
        size = self.passes.angle_deg.size
        return curve(ways.volts[:, chosen, :, 0].reshape(-1, size), ways.clipped[:, chosen, :, 0].reshape(-1, size))


@dataclass(frozen=True)
class Group:
    """Sensors side by side: mean and standard deviation of their mean curves, and of their swings.

    ``mean_V`` and ``sd_V`` are (g,) by the name of the receiver; ``sd_V`` is NaN for a single sensor.
    """

    labels: tuple[str, ...]
    angle_deg: FloatArray
    mean_V: dict[str, FloatArray]
    sd_V: dict[str, FloatArray]
    swing_V: dict[str, float]
    sd_swing_V: dict[str, float]


def analysed(recordings: Sequence[Signals], settings: Settings, motions: dict[int, Motion] | None = None) -> Analysed:
    """Response and numbers of one sensor.

    ``motions`` keeps what was found in an angle, by the identity of its array, for the other sensors on the same stage.

    Raises
    ------
    DataError
        Where a recording holds no whole cycle, none is left, or its recordings have other receivers.
    """
    first = recordings[0]
    for other in recordings[1:]:
        if other.receivers != first.receivers:
            limit = f"has receivers {', '.join(other.receivers)}; {first.source} has {', '.join(first.receivers)}"
            raise DataError(f"{other.source} ({other.label})", limit=limit, remedy="name them alike with --channel")
    known = {} if motions is None else motions
    runs = tuple(_run(signals, settings, known) for signals in recordings)
    ranges = [common_range(run.signals.angle_deg, run.motion, run.used) for run in runs]
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    if low >= high:
        limit = f"has no angle that all its ways reach ({low:.3g}° to {high:.3g}°)"
        raise DataError(f"sensor {first.label}", limit=limit, remedy="analyse its recordings apart")
    grid = grid_deg(low, high, settings.step_deg or nice_step(high - low))
    found = _passes(runs[0], grid)
    for run in runs[1:]:
        found = found.joined(_passes(run, grid))
    noise = _noise(runs)
    numbers = {name: _numbers(found.of(n), noise[n], runs, n) for n, name in enumerate(first.receivers)}
    sides = pair(first.receivers)
    both = None if sides is None else pair_numbers(found, sides, noise, settings.dark_V)
    told = [warning for run in runs for warning in (*run.motion.warnings, *run.warnings)]
    told += [] if first.lens is False else sign_warnings(numbers, sides, first.receivers)
    told += _cautions(first.receivers, numbers, found, runs)
    return Analysed(first.label, first.lens, first.receivers, runs, found, numbers, both, tuple(told))


def _run(signals: Signals, settings: Settings, known: dict[int, Motion]) -> Run:
    motion = known.get(id(signals.angle_deg)) or find_motion(signals.time_s, signals.angle_deg)
    known[id(signals.angle_deg)] = motion
    count = len(motion.cycles)
    if count <= settings.drop_cycles:
        limit = f"holds {count} whole cycle{'s' * (count != 1)}, and the first {settings.drop_cycles} are left out"
        raise DataError(signals.source or signals.label, limit=limit, remedy="use --drop 0, or record more cycles")
    moving = np.zeros(signals.time_s.size, dtype=bool)
    for ramp in motion.ramps:
        moving[ramp.start + 1 : ramp.stop - 1] = True  # its ends belong to holds, which repeat a value
    marked = np.column_stack([clipped(column, moving, settings.rails_V) for column in signals.volts.T])
    if signals.clipped is not None:
        marked |= signals.clipped
    used = tuple(range(settings.drop_cycles, count))
    return Run(signals, motion, used, marked, tuple(_clip_words(signals, marked)))


def _clip_words(signals: Signals, marked: NDArray[np.bool_]) -> list[str]:
    told = []
    for name, column, flags in zip(signals.receivers, signals.volts.T, marked.T, strict=True):
        if flags.any():
            ends = sorted({float(value) for value in (column[flags].min(), column[flags].max())})
            at = " and ".join(f"{value:.4g} V" for value in ends)
            share = 100.0 * flags.mean()
            told.append(
                f"{name}: {int(flags.sum())} samples ({share:.2g} %) are clipped at {at}; angles at which a "
                "cycle is clipped have no mean, and the numbers are those of the rest"
            )
    return told


def _passes(run: Run, grid: FloatArray) -> Passes:
    signals = run.signals
    return passes(signals.angle_deg, signals.volts, run.motion, run.used, grid, run.clipped)


def _noise(runs: Sequence[Run]) -> list[float]:
    """Standard deviation of a reading of each receiver, about a straight line within each hold.

    Without holds, from second differences of neighbouring samples.
    """
    squares, freedom = np.zeros(len(runs[0].signals.receivers)), np.zeros(len(runs[0].signals.receivers))
    for run in runs:
        for start, stop in run.motion.holds:
            begin = start + math.ceil(_SETTLE * (stop - start))
            if stop - begin >= _LEAST_HOLD:
                part = run.signals.volts[begin:stop]
                good = np.isfinite(part).all(axis=0) & ~run.clipped[begin:stop].any(axis=0)
                squares += np.where(good, _about_line(run.signals.time_s[begin:stop], part), 0.0)
                freedom += np.where(good, part.shape[0] - 2, 0)
    second = np.vstack([np.diff(run.signals.volts, 2, axis=0) for run in runs])
    with np.errstate(invalid="ignore", divide="ignore"):
        held = np.sqrt(squares / freedom)
        other = np.sqrt(np.nanmean(second**2, axis=0) / 6.0)
    return [float(value) for value in np.where(freedom > 0, held, other)]


def _about_line(time_s: FloatArray, volts: FloatArray) -> FloatArray:
    """Sum of squares of each column about its straight line over time."""
    away = (time_s - time_s.mean())[:, None]
    rest = volts - volts.mean(axis=0)
    total = float((away**2).sum())
    slope = (away * rest).sum(axis=0) / total if total > 0.0 else 0.0
    return np.asarray(((rest - slope * away) ** 2).sum(axis=0))


def _numbers(found: Passes, noise_V: float, runs: Sequence[Run], place: int) -> dict[str, Any]:
    marked = [run.clipped[:, place] for run in runs]
    hidden = np.asarray(found.clipped[..., 0].any(axis=(0, 1)))
    return {
        **receiver_numbers(found, noise_V),
        "clipped_samples": int(sum(flags.sum() for flags in marked)),
        "clipped_angles_deg": _intervals(found.angle_deg, hidden),
    }


def _intervals(angle_deg: FloatArray, hidden: NDArray[np.bool_]) -> list[list[float]]:
    """First and last angle of each stretch that is hidden."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], hidden.astype(np.int8), [0]])))
    return [[float(angle_deg[a]), float(angle_deg[b - 1])] for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _rest_words(runs: Sequence[Run]) -> list[str]:
    """Whether the angle rests elsewhere than at 0, where numbers near zero are not what they are called."""
    for run in runs:
        motion = run.motion
        if (
            abs(motion.rest_deg) > _TENTH * (motion.high_deg - motion.low_deg)
            and not motion.low_deg < 0 < motion.high_deg
        ):
            return [
                f"the angle rests at {motion.rest_deg:.4g}° and never passes 0, so there are no numbers near zero; "
                f"--zero-deg {motion.rest_deg:.4g} counts from there"
            ]
    return []


def _reach_words(found: Passes, runs: Sequence[Run]) -> list[str]:
    """Whether some ways go much farther than others, so that only part of the range is common to all."""
    low, high = min(run.motion.low_deg for run in runs), max(run.motion.high_deg for run in runs)
    first, last = float(found.angle_deg[0]), float(found.angle_deg[-1])
    if last - first > (1.0 - _TENTH) * (high - low):
        return []
    return [
        f"the angle goes from {low:.3g}° to {high:.3g}°, but every way that is used only from {first:.3g}° to "
        f"{last:.3g}°: curves and numbers are of that part"
    ]


def _drift_words(name: str, own: dict[str, Any], runs: Sequence[Run]) -> list[str]:
    """Whether a drift alone parts both ways by as much as half of the hysteresis: they lie up to half a cycle apart."""
    drift, u = own["drift_V_per_min"], own["u_drift_V_per_min"]
    lasts = [run.motion.cycles[place].end_s - run.motion.cycles[place].start_s for run in runs for place in run.used]
    apart = abs(drift) / 60.0 * 0.5 * float(np.median(lasts))
    if not (abs(drift) > 3.0 * u and apart > 0.5 * own["hysteresis_V"] > 0.5 * _ROUNDING_V):
        return []
    return [
        f"{name}: a drift of {drift:+.2g} V/min parts rising and falling ways by up to {apart:.2g} V, which is in the "
        f"hysteresis of {own['hysteresis_V']:.2g} V"
    ]


def _cautions(
    receivers: tuple[str, ...], numbers: dict[str, dict[str, Any]], found: Passes, runs: Sequence[Run]
) -> list[str]:
    """What the numbers of a sensor cannot say."""
    told = _rest_words(runs) + _reach_words(found, runs)
    if found.cycles < 3:
        count = "one cycle is" if found.cycles == 1 else "two cycles are"
        told.append(f"{count} used: how well they repeat, and how they drift, cannot be told")
    for name in receivers:
        own = numbers[name]
        size, u = own["hysteresis_V"], own["u_hysteresis_V"]
        if abs(own["swing_V"]) <= max(3.0 * own["u_swing_V"], _ROUNDING_V):
            told.append(f"{name}: does not answer to the angle beyond its noise (swing {own['swing_V']:.2g} V)")
        if math.isfinite(u) and 1e-9 * own["range_V"] < size <= 3.0 * u:
            told.append(
                f"{name}: the hysteresis of {size:.2g} V is within 3 of its uncertainties ({u:.2g} V); it is a bound"
            )
        told += _drift_words(name, own, runs)
        if not np.isfinite(found.of(receivers.index(name)).volts).any():
            told.append(f"{name}: has no reading in the cycles that are used")
    return told


def beside(sensors: Sequence[Analysed]) -> Group | None:
    """Mean and spread over sensors; None where their receivers or angles have nothing in common."""
    names = [name for name in sensors[0].receivers if all(name in one.receivers for one in sensors)]
    grids = [{round(float(angle), 9) for angle in one.passes.angle_deg} for one in sensors]
    common = np.array(sorted(set.intersection(*grids)))
    if not names or common.size < 2:
        return None
    means: dict[str, FloatArray] = {}
    spreads: dict[str, FloatArray] = {}
    for name in names:
        rows = np.array([_at(one, name, common) for one in sensors])
        means[name] = rows.mean(axis=0)
        spreads[name] = rows.std(axis=0, ddof=1) if len(rows) > 1 else np.full(common.size, np.nan)
    swings = {name: np.array([one.numbers[name]["swing_V"] for one in sensors]) for name in names}
    return Group(
        labels=tuple(one.label for one in sensors),
        angle_deg=common,
        mean_V=means,
        sd_V=spreads,
        swing_V={name: float(values.mean()) for name, values in swings.items()},
        sd_swing_V={
            name: float(values.std(ddof=1)) if values.size > 1 else math.nan for name, values in swings.items()
        },
    )


def _at(one: Analysed, name: str, angles: FloatArray) -> FloatArray:
    places = np.searchsorted(one.passes.angle_deg, angles - 1e-6)
    return one.curve(one.receivers.index(name)).mean_V[places]
