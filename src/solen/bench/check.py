"""A check of a rig at rest before a run: wiring, emitters, saturation, noise, ambient light and trimmers.

Every emitter is switched on in turn and every input is read. An input that responds to no emitter, or to a different
emitter from the one in the rig file, is wired wrongly; an input at a limit of its range is saturated. The voltage drop
that light causes at a receiver shows how to adjust the receiver's trimmer: in a bent sensor one receiver gets up to
twice the light that it gets at rest.

`check` returns a `RigCheck`; `jog` returns a `Jogged`.
"""

import math
from collections.abc import Iterator
from dataclasses import field
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from solen.analysis.load_cell import LoadCell
from solen.analysis.noise import noise_of, pooled_noise
from solen.arrays import FloatArray
from solen.bench.clock import Clock, SimulatedClock, WallClock
from solen.bench.homing import Confirm, knows_zero, make_known
from solen.bench.interrupts import ended_by_signals
from solen.bench.live import InputReadings, LiveReadings, sampler_of, stage_of
from solen.bench.rig import Rig, SensorOf, load_rig
from solen.bench.rig_instruments import StageOf
from solen.errors import BenchError, SpecError
from solen.ranks import Caution, do_not_use, note, prefixed, warning
from solen.results import HIDDEN, Result, in_unit, reported
from solen.spec.strict import Options

ANSWERS_SD, ANSWERS = 6.0, 0.0004
"""Minimum response of an input to an emitter, in standard errors of the mean and as a fraction of the range."""
SHORTED = 0.005
"""A level below this fraction of the range indicates a short circuit."""
BOTTOM = 0.05
"""A receiver is saturated if its level is below this fraction of the level with the emitters off."""
GROWS = 1.5
"""Minimum factor by which a receiver's light increases in a bent sensor; the shipped designs have 1.5 to 2.1."""
DESIRED_SIGNAL, MIN_SIGNAL, MAX_SIGNAL = 0.4, 0.12, (1.0 - BOTTOM) / GROWS
"""Desired, minimum and maximum drop that light should cause at rest, as fractions of the level with the emitters off.

Below the minimum, little of the range is used; above the maximum, the receiver saturates in any motion.
"""
ROOM = 0.1
"""Fraction of a signal by which ambient light may vary."""
PIECE_S = 0.8
"""Duration in s of the segments from which noise is computed: the hold time of the paper's protocol."""
LOOK_S = 0.1
Finite = Annotated[float, Field(allow_inf_nan=False)]


class CheckOptions(Options):
    """Options of a rig check."""

    seconds: Annotated[float, Field(ge=0.5, le=600)] = 2.0
    """Duration of the check in s."""


class InputCheck(Result):
    """One receiver at rest.

    Attributes
    ----------
    input
        Input number in the rig.
    off_V, on_V
        Level with the receiver's emitter off, and on.
    signal_V
        Drop caused by the emitter.
    noise_V
        Standard deviation of a reading, as in `solen bench analyse`.
    room_V
        Standard deviation of the level with all emitters off, caused by varying ambient light and by noise.
    load_factor
        Recommended factor for the load resistance that the trimmer sets; null if the load is right, or if there is no
        signal.
    """

    input: int
    off_V: float
    on_V: float
    signal_V: float
    noise_V: float
    room_V: float
    load_factor: float | None


class CellCheck(Result):
    """The load cell at rest.

    Attributes
    ----------
    input
        Input number in the rig.
    level_V, noise_V
        Mean level, and the standard deviation of a reading.
    noise_N
        Standard deviation of a reading, converted to a force.
    """

    input: int
    level_V: float
    noise_V: float
    noise_N: float


class RigCheck(Result):
    """Result of the check of a rig at rest.

    Attributes
    ----------
    rig
        Name of the rig.
    unit
        Unit of the receiver readings; it replaces V in the keys.
    periods
        Number of recorded periods.
    sensors
        Right and left receiver of each sensor.
    answers_V
        Drop that each emitter causes at each input: one row for each emitter.
    simulated
        Whether the rig is simulated.
    load_cell
        The rig's load cell; null if it has none.
    faults
        Problems, one line each.
    """

    rig: str
    unit: str
    periods: int
    sensors: dict[str, dict[str, InputCheck]]
    answers_V: tuple[tuple[float, ...], ...]
    simulated: bool
    load_cell: CellCheck | None
    faults: tuple[Caution, ...] = field(metadata=HIDDEN)

    @reported
    def warnings(self) -> tuple[Caution, ...]:
        """The problems."""
        return self.faults

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data; in keys that end in V, the unit of the receiver readings replaces V."""
        return in_unit(super().to_dict(), self.unit)


def of_noise(value: float, unit: str) -> str:
    """Format a small value for a reader: in mV, or in the unit of the receivers."""
    return f"{1e3 * value:.3g} mV" if unit == "V" else f"{value:.3g} {unit}"


def clock_for(rig: Rig) -> Clock:
    """Return the clock for a check of a rig."""
    return SimulatedClock() if rig.sampler.driver == "simulated" else WallClock()


def check(rig_file: Path, options: CheckOptions = CheckOptions()) -> RigCheck:
    """Check a rig at rest.

    Raises
    ------
    BenchError, SpecError
        If the rig file or an instrument is faulty, or no data arrive.
    """
    rig = load_rig(rig_file)
    clock = clock_for(rig)
    with ended_by_signals(), sampler_of(rig, rig_file.parent, clock) as sampler:
        live, parts = LiveReadings(sampler, rig), []
        until = clock.now_s() + options.seconds
        while clock.now_s() < until:
            clock.sleep(LOOK_S)
            if (levels := live.read()) is not None:
                parts.append(levels)
        name = sampler.name
    if not parts:
        raise BenchError(name, limit="has said nothing", remedy="check the cable and the power")
    return judged(rig, InputReadings.joined(parts))


def judged(rig: Rig, levels: InputReadings) -> RigCheck:
    """Return the problems that the rig's levels at rest reveal."""
    signal = levels.signal
    mean, error = signal.mean(axis=0), signal.std(axis=0) / math.sqrt(max(len(signal), 1))
    answers = np.abs(mean) > np.maximum(ANSWERS_SD * error, ANSWERS * (levels.high_V - levels.low_V))
    inputs = {
        sensor.name: {name: _input(rig, sensor, name, levels) for name in sensor.read_on} for sensor in rig.sensor
    }
    faults = [
        line for sensor in rig.sensor for line in _faults(rig, sensor, inputs[sensor.name], levels, mean, answers)
    ]
    if dark := [str(number) for number, seen in enumerate(answers.any(axis=1).tolist(), 1) if not seen]:
        wire = "check its wire, its transistor and its supply"
        faults.append(do_not_use(f"no input responds to emitter {' and '.join(dark)}; {wire}"))
    rows = tuple(tuple(row) for row in mean.tolist())
    cell = None if rig.load_cell is None else _cell(rig.load_cell, levels)
    faults += [] if cell is None else _cell_faults(cell, levels)
    return RigCheck(rig.name, rig.unit, len(signal), inputs, rows, rig.simulated, cell, tuple(faults))


def _cell(stated: LoadCell, levels: InputReadings) -> CellCheck:
    """Check the load cell; its level is the mean of the readings with the emitters on and off."""
    place = (stated.input or 1) - 1
    level = levels.off[:, 0, place] - 0.5 * levels.signal[:, 0, place]
    noise_V = _noise(levels.time_s, level)
    return CellCheck(place + 1, float(level.mean()), noise_V, abs(stated.sensitivity_N_per_V) * noise_V)


def _cell_faults(cell: CellCheck, levels: InputReadings) -> list[Caution]:
    near_V = SHORTED * (levels.high_V - levels.low_V)
    if levels.low_V + near_V < cell.level_V < levels.high_V - near_V:
        return []
    end = "is at a limit of the input's range: check its wire, its amplifier and its zero"
    return [prefixed(f"load cell (input {cell.input})", do_not_use(end))]


def _input(rig: Rig, sensor: SensorOf, side: str, levels: InputReadings) -> InputCheck:
    number = sensor.read_on[side]
    emitter = _brightest(sensor, number, levels.signal.mean(axis=0))
    on, off = (float(values[:, emitter - 1, number - 1].mean()) for values in (levels.on, levels.off))
    return InputCheck(
        input=number,
        off_V=off,
        on_V=on,
        signal_V=off - on,
        noise_V=_noise(levels.time_s, levels.signal[:, emitter - 1, number - 1]),
        room_V=float(levels.off[:, emitter - 1, number - 1].std()),
        load_factor=_load_factor(sensor, off, off - on) if rig.unit == "V" else None,
    )


def _brightest(sensor: SensorOf, number: int, mean: FloatArray) -> int:
    """Return the emitter of a sensor to which an input responds most; most sensors have only one."""
    return max(sensor.lit_by.values(), key=lambda emitter: abs(float(mean[emitter - 1, number - 1])))


def _load_factor(sensor: SensorOf, off_V: float, signal_V: float) -> float | None:
    """Return the load factor that brings a receiver to the desired drop.

    Without a lens, a receiver's light hardly changes as the sensor moves.
    """
    if signal_V <= ANSWERS * off_V or MIN_SIGNAL <= signal_V / off_V <= (MAX_SIGNAL if sensor.lens else 1.0 - BOTTOM):
        return None
    return DESIRED_SIGNAL * off_V / signal_V


def _noise(time_s: FloatArray, signal: FloatArray) -> float:
    pieces = max(1, round((time_s[-1] - time_s[0]) / PIECE_S))
    edges = np.linspace(0, len(time_s), pieces + 1).astype(int).tolist()
    return float(pooled_noise([noise_of(time_s, signal[:, None], pairwise(edges))])[0])


def _faults(
    rig: Rig,
    sensor: SensorOf,
    inputs: dict[str, InputCheck],
    levels: InputReadings,
    mean: FloatArray,
    answers: FloatArray,
) -> Iterator[Caution]:
    """Return the problems of a sensor; each starts with the receiver's name and a colon."""
    short_V, circuit = SHORTED * (levels.high_V - levels.low_V), rig.unit == "V"
    for side, own in inputs.items():
        what = f"{sensor.name} {side} (input {own.input})"
        mine, emitter = answers[:, own.input - 1], _brightest(sensor, own.input, mean)
        strongest = int(np.argmax(np.where(mine, np.abs(mean[:, own.input - 1]), 0.0))) + 1
        if circuit and own.on_V < short_V and own.off_V < short_V:
            yield prefixed(
                what, do_not_use("is near 0 V with its emitter on and off: a short circuit, or far too much light")
            )
        elif not mine.any():
            yield prefixed(what, do_not_use("responds to no emitter; check its wire and its receiver"))
        elif strongest not in sensor.lit_by.values():
            wires = f"responds to emitter {strongest}, not to {emitter}; check the rig file and the wires"
            yield prefixed(what, do_not_use(wires))
        elif circuit and mean[emitter - 1, own.input - 1] < 0.0:
            yield prefixed(what, do_not_use("rises when its emitter is on: its load and its receiver are swapped"))
        else:
            yield from (prefixed(what, line) for line in _settings(own, levels, emitter - 1, rig))


def _settings(own: InputCheck, levels: InputReadings, emitter: int, rig: Rig) -> Iterator[Caution]:
    """Return possible improvements to the settings of a working receiver."""
    clipped = float(levels.clipped[:, emitter, own.input - 1].mean())
    if clipped > 0.0:
        upper = levels.high_V - own.off_V < own.on_V - levels.low_V
        phase, end = ("off", "upper") if upper else ("on", "lower")
        yield warning(
            f"with its emitter {phase} it is at the {end} limit of the range in {100 * clipped:.3g} % of the "
            "readings; values beyond the limit are cut off"
        )
    ends = None if rig.daq is not None else rig.board.straight_v
    if ends is not None and not ends[0] <= own.on_V <= own.off_V <= ends[1]:
        yield warning(f"its levels extend beyond {ends[0]:g} to {ends[1]:g}, where the converter is not linear")
    if rig.unit == "V" and own.on_V < BOTTOM * own.off_V:
        yield warning("is saturated with its emitter on; turn its trimmer to a smaller load")
    elif own.load_factor is not None and own.load_factor < 1.0:
        bent = f"{GROWS:g} times the light, as in a bent sensor, would saturate it; turn its trimmer to a smaller load"
        yield warning(bent)
    elif own.load_factor is not None:
        yield note(f"light pulls it down by less than {100 * MIN_SIGNAL:.0f} %; a larger load uses more of the range")
    if own.room_V > ROOM * abs(own.signal_V) and own.room_V > 3.0 * own.noise_V:
        varies = f"varies by {of_noise(own.room_V, rig.unit)} with the emitters off; shade it, or switch lamps off"
        yield warning(varies)


class JogOptions(Options):
    """Options of a manual move: its target, its velocity and its stage."""

    to: Finite | None = None
    """Target position in deg or mm."""
    by: Finite | None = None
    """Relative move in deg or mm."""
    velocity: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    """Velocity in deg/s or mm/s."""
    motion: str | None = None
    """Motion whose stage is to be moved; required if the rig has several stages."""


class Jogged(Result):
    """Result of a manual move of the stage.

    Attributes
    ----------
    stage
        Name of the stage.
    begun_deg, stands_deg
        Position before and after; null if unknown, and for a linear stage.
    begun_mm, stands_mm
        Position before and after of a linear stage.
    """

    stage: str
    begun_deg: float | None = None
    stands_deg: float | None = None
    begun_mm: float | None = None
    stands_mm: float | None = None


def jog(rig_file: Path, options: JogOptions = JogOptions(), *, confirm: Confirm | None = None) -> Jogged:
    """Move the stage of a rig; query its position if neither ``to`` nor ``by`` is given.

    An interrupted move is stopped.

    Raises
    ------
    BenchError, SpecError
        If the options, the rig file or the stage are faulty, or if the target is outside the rig's travel.
    """
    if options.to is not None and options.by is not None:
        raise SpecError("--to", value=options.to, limit="cannot be combined with --by", remedy="use one of the two")
    rig, clock = load_rig(rig_file), WallClock()
    if rig.stages:
        rig = rig.as_one(_named_stage(rig, options.motion))
    elif options.motion is not None:
        raise SpecError("--motion", value=options.motion, limit="cannot be used: the rig has only one stage")
    with ended_by_signals(), stage_of(rig, clock) as stage:
        if options.to is not None or options.by is not None:
            make_known(stage, rig.stage.home, rig.stage.zero, confirm)
        begun = stage.position() if knows_zero(stage) else math.nan
        target = options.to if options.by is None else begun + options.by
        if target is not None:
            _check_way(rig, stage.name, target)
            patience = getattr(stage, "patience_s", 10.0)
            way = abs(target - begun) if math.isfinite(begun) else 0.0
            due = clock.now_s() + way / options.velocity + patience
            stage.begin_move(target, options.velocity)
            while not stage.on_target():
                if clock.now_s() > due:
                    raise BenchError(
                        stage.name, limit=f"has not arrived at {target:g}", remedy="check that it is free to move"
                    )
                clock.sleep(0.02)
        places = {f"begun_{stage.unit}": begun, f"stands_{stage.unit}": begun if target is None else stage.position()}
        return Jogged(stage.name, **{key: at for key, at in places.items() if math.isfinite(at)})


def _named_stage(rig: Rig, motion: str | None) -> StageOf:
    if motion not in rig.stages:
        limit = f"must be one of {', '.join(rig.stages)}: the rig has a stage for each motion"
        raise SpecError("--motion", value=motion, limit=limit)
    return rig.stages[motion]


def _check_way(rig: Rig, name: str, target: float) -> None:
    if not math.isfinite(target):
        raise SpecError("--by", limit="its position is unknown", remedy="use --to")
    if rig.stage.travel is not None and not rig.stage.travel[0] <= target <= rig.stage.travel[1]:
        low, high = rig.stage.travel
        raise BenchError(name, value=target, limit=f"is outside the travel of the rig, {low:g} to {high:g}")
