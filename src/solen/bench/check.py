"""A check of a rig at rest before a run: wiring, emitters, saturation, noise, ambient light and trimmers.

Every emitter is switched on in turn, and every input is read. An input that responds to no emitter, or to an emitter
other than that in the rig file, is wired wrongly; an input at a limit of its range is saturated. The voltage drop that
light causes at a receiver shows how to adjust the receiver's trimmer: in a bent sensor one receiver gets up to twice
the light that it gets at rest.

`check` returns a `RigCheck`; `jog` returns a `StageMove`.
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
from solen.bench.homing import Confirm, ensure_zero, has_zero
from solen.bench.interrupts import ended_by_signals
from solen.bench.live import InputReadings, LiveReadings, sampler_of, stage_of
from solen.bench.rig import Rig, SensorTable, load_rig
from solen.bench.rig_instruments import StageTable
from solen.bench.roles import Stage
from solen.bench.run import MAX_DELAY_S
from solen.errors import BenchError, SpecError
from solen.ranks import Caution, do_not_use, note, prefixed, warning
from solen.results import HIDDEN, Result, in_unit, reported
from solen.spec.strict import Options

MIN_RESPONSE_SD, MIN_RESPONSE = 6.0, 0.0004
"""Minimum response of an input to an emitter, in standard errors of the mean and as a fraction of the range."""
SHORT_CIRCUIT = 0.005
"""A level below this fraction of the range indicates a short circuit."""
SATURATED = 0.05
"""A receiver is saturated if its level is below this fraction of the level with the emitters off."""
MIN_LIGHT_FACTOR = 1.5
"""Minimum factor by which a receiver's light increases in a bent sensor; the shipped designs have 1.5 to 2.1."""
DESIRED_SIGNAL, MIN_SIGNAL, MAX_SIGNAL = 0.4, 0.12, (1.0 - SATURATED) / MIN_LIGHT_FACTOR
"""Desired, minimum and maximum drop that light should cause at rest, as fractions of the level with the emitters off.

Below the minimum, little of the range is used; above the maximum, the receiver saturates in any motion.
"""
MAX_AMBIENT_VARIATION = 0.1
"""Largest standard deviation of the ambient light, as a fraction of the signal, without a warning."""
SEGMENT_S = 0.8
"""Duration in s of the segments from which noise is computed: the hold time of the paper's protocol."""
READ_INTERVAL_S = 0.1
Finite = Annotated[float, Field(allow_inf_nan=False)]


class CheckOptions(Options):
    """Options of a rig check."""

    seconds: Annotated[float, Field(ge=0.5, le=600)] = 2.0
    """Duration of the check in s."""


class InputCheck(Result):
    """Result of the check of one receiver at rest.

    Attributes
    ----------
    input
        Number of its input in the rig.
    off_V, on_V
        Level with its emitter off, and on.
    signal_V
        Drop caused by the emitter.
    noise_V
        Standard deviation of a reading, as in `solen bench analyse`.
    room_V
        Standard deviation of the level with all emitters off, due to varying ambient light and to noise.
    load_factor
        Factor by which to change the load resistance with the trimmer; null if the load is right, or if there is no
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
    """Result of the check of the load cell at rest.

    Attributes
    ----------
    input
        Number of its input in the rig.
    level_V, noise_V
        Mean level, and the standard deviation of a reading.
    noise_N
        Standard deviation of a reading, as a force.
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
        Receivers of each sensor, keyed by name.
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
        """The faults."""
        return self.faults

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data; in keys that end in V, the unit of the receiver readings replaces V."""
        return in_unit(super().to_dict(), self.unit)


def noise_text(value: float, unit: str) -> str:
    """Format a small value for display: in mV, or in the unit of the receivers."""
    return f"{1e3 * value:.3g} mV" if unit == "V" else f"{value:.3g} {unit}"


def clock_for(rig: Rig) -> Clock:
    """Return the clock for a check of a rig."""
    return SimulatedClock() if rig.sampler.driver == "simulated" else WallClock()


def check(rig_file: Path, options: CheckOptions = CheckOptions()) -> RigCheck:
    """Check a rig at rest.

    Raises
    ------
    BenchError, SpecError
        If the rig file is invalid, an instrument fails, or no data arrive.
    """
    rig = load_rig(rig_file)
    clock = clock_for(rig)
    with ended_by_signals(), sampler_of(rig, rig_file.parent, clock) as sampler:
        live, parts = LiveReadings(sampler, rig), []
        until = clock.now_s() + options.seconds
        while clock.now_s() < until:
            clock.sleep(READ_INTERVAL_S)
            if (levels := live.read()) is not None:
                parts.append(levels)
        name = sampler.name
    if not parts:
        limit = f"has sent no data within {options.seconds:g} s"
        raise BenchError(name, limit=limit, remedy="check the cable and the power")
    return rig_check(rig, InputReadings.joined(parts))


def rig_check(rig: Rig, levels: InputReadings) -> RigCheck:
    """Return the result of a check, with the problems that the levels at rest reveal."""
    signal = levels.signal
    mean, error = signal.mean(axis=0), signal.std(axis=0) / math.sqrt(max(len(signal), 1))
    responds = np.abs(mean) > np.maximum(MIN_RESPONSE_SD * error, MIN_RESPONSE * (levels.high_V - levels.low_V))
    inputs = {
        sensor.name: {name: _input(rig, sensor, name, levels) for name in sensor.input_numbers} for sensor in rig.sensor
    }
    faults = [
        fault for sensor in rig.sensor for fault in _faults(rig, sensor, inputs[sensor.name], levels, mean, responds)
    ]
    if dark := [str(number) for number, lit in enumerate(responds.any(axis=1).tolist(), 1) if not lit]:
        remedy = "check the wire, the transistor and the supply of each of these emitters"
        if len(dark) == 1:
            remedy = "check its wire, its transistor and its supply"
        faults.append(do_not_use(f"no input responds to emitter {' and '.join(dark)}; {remedy}"))
    rows = tuple(tuple(row) for row in mean.tolist())
    cell = None if rig.load_cell is None else _cell(rig.load_cell, levels)
    faults += [] if cell is None else _cell_faults(cell, levels)
    return RigCheck(rig.name, rig.unit, len(signal), inputs, rows, rig.simulated, cell, tuple(faults))


def _cell(cell: LoadCell, levels: InputReadings) -> CellCheck:
    """Check the load cell; its level is the mean of the readings with the emitters on and off."""
    index = (cell.input or 1) - 1
    level = levels.off[:, 0, index] - 0.5 * levels.signal[:, 0, index]
    noise_V = _noise(levels.time_s, level)
    return CellCheck(index + 1, float(level.mean()), noise_V, abs(cell.sensitivity_N_per_V) * noise_V)


def _cell_faults(cell: CellCheck, levels: InputReadings) -> list[Caution]:
    margin_V = SHORT_CIRCUIT * (levels.high_V - levels.low_V)
    if levels.low_V + margin_V < cell.level_V < levels.high_V - margin_V:
        return []
    fault = do_not_use("is at a limit of the input range; check its wire, its amplifier and its zero")
    return [prefixed(f"load cell (input {cell.input})", fault)]


def _input(rig: Rig, sensor: SensorTable, side: str, levels: InputReadings) -> InputCheck:
    number = sensor.input_numbers[side]
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


def _brightest(sensor: SensorTable, number: int, mean: FloatArray) -> int:
    """Return the emitter of a sensor to which an input responds most; most sensors have only one."""
    return max(sensor.emitter_numbers.values(), key=lambda emitter: abs(float(mean[emitter - 1, number - 1])))


def _load_factor(sensor: SensorTable, off_V: float, signal_V: float) -> float | None:
    """Return the factor for the load that gives a receiver the desired drop; None if no change is needed or possible.

    No change is possible without a signal. Without a lens, the light of a receiver hardly changes as the sensor moves,
    and a larger drop is acceptable.
    """
    largest = MAX_SIGNAL if sensor.lens else 1.0 - SATURATED
    if signal_V <= MIN_RESPONSE * off_V or MIN_SIGNAL <= signal_V / off_V <= largest:
        return None
    return DESIRED_SIGNAL * off_V / signal_V


def _noise(time_s: FloatArray, signal: FloatArray) -> float:
    segments = max(1, round((time_s[-1] - time_s[0]) / SEGMENT_S))
    edges = np.linspace(0, len(time_s), segments + 1).astype(int).tolist()
    return float(pooled_noise([noise_of(time_s, signal[:, None], pairwise(edges))])[0])


def _faults(
    rig: Rig,
    sensor: SensorTable,
    inputs: dict[str, InputCheck],
    levels: InputReadings,
    mean: FloatArray,
    responds: FloatArray,
) -> Iterator[Caution]:
    """Yield the problems of a sensor, each preceded by the name of the receiver and a colon."""
    for side, receiver in inputs.items():
        name = f"{sensor.name} {side} (input {receiver.input})"
        emitter = _brightest(sensor, receiver.input, mean)
        fault = _wiring_fault(rig, sensor, receiver, levels, mean, responds)
        if fault is not None:
            yield prefixed(name, do_not_use(fault))
        else:
            yield from (prefixed(name, line) for line in _settings(receiver, levels, emitter - 1, rig))


def _wiring_fault(
    rig: Rig, sensor: SensorTable, receiver: InputCheck, levels: InputReadings, mean: FloatArray, responds: FloatArray
) -> str | None:
    """Return the fault in the wiring of a receiver; None if it responds as it should."""
    drops, measures_volts = mean[:, receiver.input - 1], rig.unit == "V"
    emitter = _brightest(sensor, receiver.input, mean)
    responding = responds[:, receiver.input - 1]
    strongest = int(np.argmax(np.where(responding, np.abs(drops), 0.0))) + 1
    if measures_volts and max(receiver.on_V, receiver.off_V) < SHORT_CIRCUIT * (levels.high_V - levels.low_V):
        return "is near 0 V with its emitter on and off: a short circuit, or far too much light"
    if not responding.any():
        return "responds to no emitter; check its wire and its receiver"
    if strongest not in sensor.emitter_numbers.values():
        return f"responds to emitter {strongest}, not to {emitter}; check the rig file and the wires"
    if measures_volts and drops[emitter - 1] < 0.0:
        return "rises when its emitter is on: its load and its receiver are interchanged"
    return None


def _settings(receiver: InputCheck, levels: InputReadings, emitter: int, rig: Rig) -> Iterator[Caution]:
    """Yield the settings of a working receiver that should be improved."""
    clipped = float(levels.clipped[:, emitter, receiver.input - 1].mean())
    if clipped > 0.0:
        upper = levels.high_V - receiver.off_V < receiver.on_V - levels.low_V
        phase, end = ("off", "upper") if upper else ("on", "lower")
        yield warning(
            f"is clipped at the {end} limit of the range in {100 * clipped:.3g} % of the readings with its emitter "
            f"{phase}"
        )
    linear = None if rig.daq is not None else rig.board.linear_v
    if linear is not None and not linear[0] <= receiver.on_V <= receiver.off_V <= linear[1]:
        levels_text = f"is at {receiver.on_V:.3g} to {receiver.off_V:.3g} V"
        yield warning(f"{levels_text}, partly outside {linear[0]:g} to {linear[1]:g} V, the linear range of the ADC")
    if rig.unit == "V" and receiver.on_V < SATURATED * receiver.off_V:
        yield warning("is saturated with its emitter on; turn its trimmer to a smaller load")
    elif receiver.load_factor is not None and receiver.load_factor < 1.0:
        yield warning(
            f"would saturate at {MIN_LIGHT_FACTOR:g} times the light, as in a bent sensor; turn its trimmer to a "
            "smaller load"
        )
    elif receiver.load_factor is not None:
        drop = f"drops by less than {100 * MIN_SIGNAL:.0f} % when its emitter is on"
        yield note(f"{drop}; a larger load would use more of the range")
    if receiver.room_V > MAX_AMBIENT_VARIATION * abs(receiver.signal_V) and receiver.room_V > 3.0 * receiver.noise_V:
        variation = f"varies by {noise_text(receiver.room_V, rig.unit)} with the emitters off"
        yield warning(f"{variation}; shade it, or switch lamps off")


class JogOptions(Options):
    """Options of a manual move: target, velocity and stage."""

    to: Finite | None = None
    """Target position in deg or mm."""
    by: Finite | None = None
    """Distance to move in deg or mm, with its sign."""
    velocity: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    """Velocity in deg/s or mm/s."""
    motion: str | None = None
    """Motion whose stage moves; required if the rig has several stages."""


class StageMove(Result):
    """Result of a manual move of the stage.

    Attributes
    ----------
    stage
        Name of the stage.
    begun_deg, stands_deg
        Position before and after the move; None if unknown or if the stage is linear.
    begun_mm, stands_mm
        Position of a linear stage before and after the move; None if unknown or if the stage rotates.
    """

    stage: str
    begun_deg: float | None = None
    stands_deg: float | None = None
    begun_mm: float | None = None
    stands_mm: float | None = None


def jog(rig_file: Path, options: JogOptions = JogOptions(), *, confirm: Confirm | None = None) -> StageMove:
    """Move the stage of a rig; without ``to`` and ``by``, only query its position.

    If the call is interrupted, the stage is stopped.

    Raises
    ------
    BenchError, SpecError
        If the options or the rig file are invalid, the stage fails, or the target is outside the travel of the rig.
    """
    if options.to is not None and options.by is not None:
        raise SpecError("--to", value=options.to, limit="cannot be combined with --by", remedy="specify one of the two")
    rig, clock = load_rig(rig_file), WallClock()
    if rig.stages:
        rig = rig.with_single_stage(_named_stage(rig, options.motion))
    elif options.motion is not None:
        raise SpecError("--motion", value=options.motion, limit="the rig has only one stage", remedy="omit --motion")
    with ended_by_signals(), stage_of(rig, clock) as stage:
        if options.to is not None or options.by is not None:
            ensure_zero(stage, rig.stage.home, rig.stage.zero, confirm)
        begun = stage.position() if has_zero(stage) else math.nan
        target = options.to if options.by is None else begun + options.by
        if target is not None:
            _check_target(rig, stage.name, target)
            _move(stage, clock, begun, target, options.velocity)
        end = begun if target is None else stage.position()
        positions = {f"begun_{stage.unit}": begun, f"stands_{stage.unit}": end}
        return StageMove(stage.name, **{key: value for key, value in positions.items() if math.isfinite(value)})


def _move(stage: Stage, clock: Clock, begun: float, target: float, velocity: float) -> None:
    """Move a stage and wait until it arrives; raise `BenchError` after a time-out."""
    distance = abs(target - begun) if math.isfinite(begun) else 0.0
    due = clock.now_s() + distance / velocity + getattr(stage, "patience_s", MAX_DELAY_S)
    stage.begin_move(target, velocity)
    while not stage.on_target():
        if clock.now_s() > due:
            limit = f"has not arrived at {target:g} {stage.unit}"
            raise BenchError(stage.name, limit=limit, remedy="check that it is free to move")
        clock.sleep(0.02)


def _named_stage(rig: Rig, motion: str | None) -> StageTable:
    if motion not in rig.stages:
        raise SpecError("--motion", value=motion, limit=f"must be one of {', '.join(rig.stages)}")
    return rig.stages[motion]


def _check_target(rig: Rig, name: str, target: float) -> None:
    if not math.isfinite(target):
        raise SpecError("--by", limit="the position of the stage is unknown", remedy="use --to")
    if rig.stage.travel is not None and not rig.stage.travel[0] <= target <= rig.stage.travel[1]:
        low, high = rig.stage.travel
        limit = f"is outside the travel of the rig, {low:g} to {high:g}"
        raise BenchError(name, value=target, limit=limit, remedy="choose a position within the travel")
