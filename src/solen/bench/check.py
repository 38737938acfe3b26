"""A rig looked over before a run, standing still: wires, emitters, rails, noise, light of the room, trimmers.

The idea: every emitter is lit and every input read. An input that answers to no emitter, or to another one than the
rig file has it, is a wire; one that stands at an end of the range is a rail; how far light pulls a receiver down says
which way its trimmer should go, as in a bent sensor one receiver gets up to twice the light that it has at rest.

The interface: `check` gives a `RigCheck`; `jog` a `Jogged`.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from solen.arrays import FloatArray
from solen.bench.clock import Clock, SimulatedClock, WallClock
from solen.bench.glance import Glance, Glances, sampler_of, stage_of
from solen.bench.homing import Confirm, knows_zero, make_known
from solen.bench.interrupts import ended_by_signals
from solen.bench.rig import Rig, SensorOf, load_rig
from solen.errors import BenchError, SpecError
from solen.results import HIDDEN, Result, reported
from solen.spec.strict import Options

ANSWERS_SD, ANSWERS_V = 6.0, 0.002
"""An input answers to an emitter by so many standard errors of the mean, and so many volts."""
AT_RAIL = 0.005
"""Share of the range within which a level counts as at its end."""
WANTED, LEAST, MOST = 0.35, 0.12, 0.45
"""Share of the level with the emitters off that light should pull down at rest; less than the second or more than the
third is advised against: twice as much must not reach the bottom."""
ROOM = 0.1
"""Share of a signal by which light of the room may vary."""
LOOK_S = 0.1
Finite = Annotated[float, Field(allow_inf_nan=False)]


class CheckOptions(Options):
    """How long to look."""

    seconds: Annotated[float, Field(ge=0.5, le=600)] = 2.0
    """For how long emitters take turns."""


@dataclass(frozen=True, eq=False, repr=False)
class InputCheck(Result):
    """One receiver at rest.

    Attributes
    ----------
    input
        Its number in the rig.
    off_V, on_V
        Its level with its emitter off, and on.
    signal_V
        By how much its emitter pulls it down.
    noise_V
        Standard deviation of that from period to period.
    room_V
        Standard deviation of its level with all emitters off: light of the room that varies, and noise.
    factor
        By what the load that its trimmer sets should be multiplied; null where no signal says so.
    """

    input: int
    off_V: float
    on_V: float
    signal_V: float
    noise_V: float
    room_V: float
    factor: float | None


@dataclass(frozen=True, eq=False, repr=False)
class RigCheck(Result):
    """A rig at rest.

    Attributes
    ----------
    rig
        Its name.
    periods
        How many were looked at.
    sensors
        Of each sensor its receivers, right and left.
    answers_V
        By how much each emitter pulls each input down: a row for each emitter.
    simulated
        Whether the rig is.
    faults
        What is wrong, a line each.
    """

    rig: str
    periods: int
    sensors: dict[str, dict[str, InputCheck]]
    answers_V: tuple[tuple[float, ...], ...]
    simulated: bool
    faults: tuple[str, ...] = field(metadata=HIDDEN)

    @reported
    def warnings(self) -> tuple[str, ...]:
        """What is wrong."""
        return self.faults


def clock_for(rig: Rig) -> Clock:
    """Time of a look at a rig."""
    return SimulatedClock() if rig.sampler.driver == "simulated" else WallClock()


def check(rig_file: Path, options: CheckOptions = CheckOptions()) -> RigCheck:
    """Look a rig over while it stands still.

    Raises
    ------
    BenchError, SpecError
        Where the rig file or an instrument is at fault, or nothing comes.
    """
    rig = load_rig(rig_file)
    clock = clock_for(rig)
    with ended_by_signals(), sampler_of(rig, rig_file.parent, clock) as sampler:
        glances, parts = Glances(sampler, rig), []
        until = clock.now_s() + options.seconds
        while clock.now_s() < until:
            clock.sleep(LOOK_S)
            if (glance := glances.read()) is not None:
                parts.append(glance)
        name = sampler.name
    if not parts:
        raise BenchError(name, limit="has said nothing", remedy="check its cable and power")
    joined = [np.concatenate([getattr(part, phase) for part in parts]) for phase in ("on", "off")]
    return judged(rig, Glance(joined[0], joined[1], parts[0].low_V, parts[0].high_V))


def judged(rig: Rig, glance: Glance) -> RigCheck:
    """What a glance says of a rig."""
    signal = glance.signal
    mean, error = signal.mean(axis=0), signal.std(axis=0) / math.sqrt(max(len(signal), 1))
    answers = np.abs(mean) > np.maximum(ANSWERS_SD * error, ANSWERS_V)
    found = {one.name: {side: _input(one, side, glance) for side in ("right", "left")} for one in rig.sensor}
    faults = [line for one in rig.sensor for line in _faults(one, found[one.name], glance, mean, answers)]
    if dark := [str(number) for number, seen in enumerate(answers.any(axis=1).tolist(), 1) if not seen]:
        faults.append(f"no input sees emitter {' and '.join(dark)}; check its wire, its transistor and its supply")
    rows = tuple(tuple(row) for row in mean.tolist())
    return RigCheck(rig.name, len(signal), found, rows, rig.simulated, tuple(faults))


def _input(sensor: SensorOf, side: str, glance: Glance) -> InputCheck:
    number = getattr(sensor, side)
    on, off = (values[:, sensor.emitter - 1, number - 1] for values in (glance.on, glance.off))
    signal = float((off - on).mean())
    level = float(off.mean())
    return InputCheck(
        input=number,
        off_V=level,
        on_V=float(on.mean()),
        signal_V=signal,
        noise_V=_apart(off - on),
        room_V=float(off.std()),
        factor=WANTED * level / signal if signal > ANSWERS_V else None,
    )


def _apart(values: FloatArray) -> float:
    """Standard deviation from one to the next, without drift."""
    return float(np.std(np.diff(values)) / math.sqrt(2.0)) if len(values) > 2 else math.nan


def _faults(
    sensor: SensorOf, found: dict[str, InputCheck], glance: Glance, mean: FloatArray, answers: FloatArray
) -> Iterator[str]:
    """What is wrong with a sensor; what differs from one receiver to the next stands before the colon."""
    span = glance.high_V - glance.low_V
    for side, one in found.items():
        what = f"{sensor.name} {side} (input {one.input})"
        mine = answers[:, one.input - 1]
        strongest = int(np.argmax(np.where(mine, np.abs(mean[:, one.input - 1]), 0.0))) + 1
        if one.on_V < AT_RAIL * span and one.off_V < AT_RAIL * span:
            yield f"{what} at {one.off_V:.3g} V: stays there, lit or not; a short, or far too much light"
        elif not mine.any():
            yield f"{what} at {one.off_V:.3g} V: answers to no emitter; check its wire and its receiver"
        elif strongest != sensor.emitter:
            yield f"{what}, emitter {strongest} for {sensor.emitter}: answers to another one; check rig file and wires"
        elif mean[sensor.emitter - 1, one.input - 1] < 0.0:
            yield f"{what}: rises with its emitter on; load and receiver are swapped"
        else:
            yield from _trimmed(what, one, glance)


def _trimmed(what: str, one: InputCheck, glance: Glance) -> Iterator[str]:
    """What a receiver that works could do better."""
    share, span = one.signal_V / max(one.off_V, 1e-9), glance.high_V - glance.low_V
    if one.off_V > glance.high_V - AT_RAIL * span:
        yield f"{what}: stands at the upper end of the range with its emitter off; what lies beyond is cut off"
    if one.on_V < 0.05 * one.off_V:
        yield f"{what} at {one.on_V:.3g} V: is at the bottom with its emitter on"
    if share > MOST or share < LEAST:
        way = "less" if share > MOST else "more"
        numbers = f"pulled down by {100 * share:.0f} % at rest, about {one.factor:.2g} times its load"
        yield f"{what}, {numbers}: turn its trimmer to {way} load, or its emitter's"
    if one.room_V > ROOM * one.signal_V and one.room_V > 3.0 * one.noise_V:
        yield f"{what}, {1e3 * one.room_V:.0f} mV: varies with the emitters off; shade it, or switch lamps off"


class JogOptions(Options):
    """Where to, how fast."""

    to: Finite | None = None
    """Position to go to, in deg or mm."""
    by: Finite | None = None
    """How far to go from where it stands, in deg or mm."""
    velocity: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    """In deg/s or mm/s."""


@dataclass(frozen=True, eq=False, repr=False)
class Jogged(Result):
    """A stage that was moved by hand of the program.

    Attributes
    ----------
    stage
        Its name.
    begun_deg, stands_deg
        Where it stood, and where it stands; null where nobody knows, and of a stage that shifts.
    begun_mm, stands_mm
        Likewise, of a stage that shifts.
    """

    stage: str
    begun_deg: float | None = None
    stands_deg: float | None = None
    begun_mm: float | None = None
    stands_mm: float | None = None


def jog(rig_file: Path, options: JogOptions = JogOptions(), *, confirm: Confirm | None = None) -> Jogged:
    """Move the stage of a rig, or, with neither ``to`` nor ``by``, ask it where it stands; what ends the move stops it.

    Raises
    ------
    BenchError, SpecError
        Where options, rig file or stage are at fault, or the target lies beyond the rig's travel.
    """
    if options.to is not None and options.by is not None:
        raise SpecError("--to", value=options.to, limit="stands beside --by", remedy="give one of them")
    rig, clock = load_rig(rig_file), WallClock()
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
                    raise BenchError(stage.name, limit=f"has not arrived at {target:g}", remedy="is it free to move?")
                clock.sleep(0.02)
        places = {f"begun_{stage.unit}": begun, f"stands_{stage.unit}": begun if target is None else stage.position()}
        return Jogged(stage.name, **{key: at for key, at in places.items() if math.isfinite(at)})


def _check_way(rig: Rig, name: str, target: float) -> None:
    if not math.isfinite(target):
        raise SpecError("--by", limit="where it stands is not known", remedy="use --to")
    if rig.stage.travel is not None and not rig.stage.travel[0] <= target <= rig.stage.travel[1]:
        low, high = rig.stage.travel
        raise BenchError(name, value=target, limit=f"is beyond travel in the rig, {low:g} to {high:g}")
