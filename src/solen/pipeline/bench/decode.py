"""Voltages to angles by a saved calibration: a recorded file, lines as they come, or a run under way."""

import math
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from solen import files
from solen.analysis.calibration import Decoded, Decoder, Headings, Tracker
from solen.analysis.calibration import file as saved
from solen.analysis.calibration.checks import merged, part_of
from solen.analysis.calibration.heading import WINDOW_S
from solen.arrays import FloatArray
from solen.errors import DataError, OutputError, SpecError
from solen.pipeline.bench import decode_sources as sources
from solen.pipeline.bench.decode_sources import Batch, Stream, Wanted
from solen.pipeline.bench.whatmoved import motion_and_circuit

COLUMNS = (
    "time_s",
    "angle_deg",
    "low68_deg",
    "high68_deg",
    "low95_deg",
    "high95_deg",
    "direction",
    "probability",
    "heading",
    "rises",
    "flags",
    "other",
)
AGAINST = ("readings", "rms_deg", "worst_deg", "bias_deg", "within_68", "within_95")
"""What is told of decoded angles against those that the source itself has."""
STDIN = "-"
JOURNAL = ".journal"
_MILLI = 100.0  # times the calibration's largest voltage, from which on a reading was not in volts
_PIECE = 4096

Say = Callable[[str], None]


@dataclass(frozen=True)
class Asked:
    """What is asked for.

    Attributes
    ----------
    calibration, source
        The file, and a file, a journal or ``-`` for standard input.
    wanted
        Columns and sensor of the source.
    follow
        Follow a journal as it grows.
    design, motion
        What the source is a recording of, where it does not say.
    gain_percent
        Standard deviation of a common factor of the light.
    rails_V
        Lowest and highest voltage of the recorder.
    window_s
        Time over which an angle must rise or fall to be said to.
    """

    calibration: Path
    source: str
    wanted: Wanted = field(default_factory=Wanted)
    follow: bool = False
    design: Path | None = None
    motion: str | None = None
    gain_percent: float = 0.0
    rails_V: tuple[float, float] | None = None
    window_s: float = WINDOW_S


def decode(
    asked: Asked,
    *,
    out: Path | None = None,
    lines: TextIO | None = None,
    say: Say | None = None,
    text: Iterable[str] | None = None,
) -> dict[str, Any]:
    """Decode a source; what was found is counted, and its readings go to a file, to ``lines``, to both or nowhere.

    Ctrl-C ends a stream as its own end does.

    Parameters
    ----------
    asked
        The source and the calibration.
    out, lines
        A .csv file, and where rows are written as they come.
    say
        Told each warning as soon as it is known.
    text
        Lines of the standard input; by default those of `sys.stdin`.

    Raises
    ------
    DataError, SpecError, OutputError
        In one line, where a file, an option or an output is not what it should be.
    """
    _check(asked, out)
    known = saved.load(asked.calibration)
    decoder = _decoder(known, asked)
    stream = _stream(asked, known, sys.stdin if text is None else text)
    warnings = [*stream.warnings, *_warnings(asked, known, stream)]
    for line in warnings:
        if say is not None:
            say(line)
    run = _Run(decoder, asked)
    with nullcontext() if out is None else files.streamed(out) as file:
        for target in (file, lines):
            if target is not None:
                print(",".join(COLUMNS), file=target, flush=True)
        interrupted = _all(run, stream, [one for one in (file, lines) if one is not None])
    if not run.counts["readings"]:
        raise DataError(asked.source, limit="holds no reading", remedy="check its columns")
    return run.summary() | {
        "calibration": {"file": str(asked.calibration), "sensor": known.sensor, "simulated": known.simulated},
        "sensor": stream.sensor,
        "simulated": known.simulated or stream.simulated,
        "interrupted": interrupted,
        "sources": [] if stream.provenance is None else [stream.provenance.as_dict()],
        "warnings": [*warnings, *run.warnings()],
        **({} if out is None else {"out": str(out)}),
    }


def _all(run: "_Run", stream: Stream, targets: list[TextIO]) -> bool:
    """Decode all batches; whether somebody stopped it."""
    try:
        for batch in stream.batches:
            for piece in _pieces(batch):
                rows = run.of(piece)
                for target in targets:
                    target.write(rows)
                    target.flush()
    except KeyboardInterrupt:
        return True
    return False


def _pieces(batch: Batch) -> Iterator[Batch]:
    """A batch in pieces that fit the memory."""
    for begin in range(0, len(batch.time_s), _PIECE):
        part = slice(begin, begin + _PIECE)
        clipped = None if batch.clipped is None else batch.clipped[part]
        angle = None if batch.angle_deg is None else batch.angle_deg[part]
        yield Batch(batch.time_s[part], batch.volts[part], clipped, angle)


def _check(asked: Asked, out: Path | None) -> None:
    if out is not None and out.suffix.lower() != ".csv":
        raise OutputError(str(out), limit="decoded angles go to a .csv", remedy="rename it")
    if out is not None and str(out) == asked.source:
        raise OutputError(str(out), limit="is the source itself", remedy="name another file")
    for name, value in (("--gain-percent", asked.gain_percent), ("--window-ms", 1e3 * asked.window_s)):
        if not 0.0 <= value < math.inf:
            raise SpecError(name, value=value, limit="must be at least 0")
    if asked.rails_V is not None and not asked.rails_V[0] < asked.rails_V[1]:
        low, high = asked.rails_V
        raise SpecError("--rails", value=f"{low} {high}", limit="must be the lower and the higher voltage")
    if asked.follow and not asked.source.endswith(JOURNAL):
        raise SpecError("--follow", value=asked.source, limit=f"is for the {JOURNAL} of a run", remedy="leave it out")


def _decoder(known: saved.CalibrationFile, asked: Asked) -> Decoder:
    if asked.gain_percent and known.dark_v is None:
        limit = "needs the voltage without light, which the calibration does not know"
        raise SpecError("--gain-percent", value=asked.gain_percent, limit=limit, remedy="calibrate with --dark-v")
    return Decoder(known.calibration, gain_percent=asked.gain_percent, dark_V=known.dark_v or 0.0)


def _stream(asked: Asked, known: saved.CalibrationFile, text: Iterable[str]) -> Stream:
    if asked.source == STDIN:
        return sources.lines(text, asked.wanted)
    path = Path(asked.source)
    if path.suffix == JOURNAL:
        return sources.journal(path, asked.wanted, known.sensor, follow=asked.follow)
    return sources.recorded(path, asked.wanted, known.sensor)


def _warnings(asked: Asked, known: saved.CalibrationFile, stream: Stream) -> list[str]:
    """Whether the calibration is for what is decoded, in one sentence for what differs and one for what nobody says."""
    motion, circuit = motion_and_circuit(
        stream.sensor or known.sensor, stream.provenance, asked.design, asked.motion, stream.ambient
    )
    other, unknown = saved.differences(known, motion, circuit)
    moved = bool(other)
    if len(known.prints) == 1 and stream.sensor is not None and _last(stream.sensor) != _last(known.sensor):
        other.insert(0, f"sensor {stream.sensor} instead of {known.sensor}")
    told = []
    if other:
        told.append(f"this calibration is not for what is decoded: {'; '.join(other)}")
    if unknown and not moved:
        told.append(
            f"whether the calibration is for this motion cannot be checked: nothing says the {', '.join(unknown)}; "
            "--design or --motion does"
        )
    if known.simulated and not stream.simulated and stream.provenance is not None:
        told.append("the calibration is simulated, and the recording is not")
    return told


def _last(name: str) -> str:
    """Name of a sensor without that of its file."""
    return name.rpartition(".")[2]


class _Run:
    """Readings of one stream, decoded and counted."""

    def __init__(self, decoder: Decoder, asked: Asked) -> None:
        self._decoder, self._asked = decoder, asked
        self._tracker = Tracker(asked.window_s)
        curves = decoder.calibration.curves_V
        self._largest = float(np.abs(curves).max())
        self._middle = curves.mean(axis=(0, 1))
        self._rails = decoder.calibration.rails_V
        self._low, self._high = math.inf, -math.inf
        self._times = [math.nan, math.nan]
        self._true: list[tuple[FloatArray, Decoded]] = []
        self.counts = dict.fromkeys(("readings", "missing", "outside", "ambiguous", "clipped", "at_end"), 0)

    def of(self, batch: Batch) -> str:
        """Rows of a batch."""
        good = np.asarray(np.isfinite(batch.volts).all(axis=1))
        self._check_scale(batch.volts[good])
        decoded = self._decoder.decode(batch.volts[good], self._marks(batch, good))
        noise = self._decoder.noise_deg(decoded.angle_deg)
        headings = self._tracker.of(batch.time_s[good], decoded.angle_deg, noise)
        self._count(batch, good, decoded)
        return "".join(_rows(batch.time_s, good, decoded, headings))

    def _check_scale(self, volts: FloatArray) -> None:
        """`DataError` where readings are some thousand times what was calibrated."""
        largest = float(np.median(np.abs(volts).max(axis=1))) if len(volts) else 0.0
        if largest > _MILLI * self._largest:
            limit = f"reads {largest:.4g} V, and the calibration knows up to {self._largest:.3g} V: are they mV?"
            remedy = "state the unit in the header, as in left_mV"
            raise DataError(self._asked.source, limit=limit, remedy=remedy)

    def _marks(self, batch: Batch, good: NDArray[np.bool_]) -> NDArray[np.int8]:
        """1 where a reading stands at the upper end of what is shown, −1 at the lower."""
        volts = batch.volts[good]
        marks = np.zeros(volts.shape, dtype=np.int8)
        if batch.clipped is not None:
            marks[batch.clipped[good]] = 1
            marks *= np.where(volts >= self._middle, 1, -1).astype(np.int8)
        rails = self._rails if self._asked.rails_V is None else np.array([self._asked.rails_V] * 2)
        marks[volts >= np.nan_to_num(rails[:, 1], nan=np.inf)] = 1
        marks[volts <= np.nan_to_num(rails[:, 0], nan=-np.inf)] = -1
        return marks

    def _count(self, batch: Batch, good: NDArray[np.bool_], decoded: Decoded) -> None:
        self.counts["readings"] += int(good.sum())
        self.counts["missing"] += int((~good).sum())
        for name in ("outside", "ambiguous", "clipped", "at_end"):
            self.counts[name] += int(getattr(decoded, name).sum())
        if good.any():
            inside = decoded.angle_deg[~decoded.outside]
            self._low = min(self._low, float(inside.min(initial=math.inf)))
            self._high = max(self._high, float(inside.max(initial=-math.inf)))
            times = batch.time_s[good]
            self._times = [self._times[0] if math.isfinite(self._times[0]) else float(times[0]), float(times[-1])]
        if batch.angle_deg is not None:
            self._true.append((batch.angle_deg[good], decoded))

    def summary(self) -> dict[str, Any]:
        """What was found."""
        first, last = self._times
        return {
            **self.counts,
            "from_s": first,
            "to_s": last,
            "lowest_deg": self._low if math.isfinite(self._low) else None,
            "highest_deg": self._high if math.isfinite(self._high) else None,
            "against_angle": self._against(),
        }

    def _against(self) -> dict[str, Any] | None:
        """Errors against the angle that the source itself has, within the calibrated range."""
        if not self._true:
            return None
        ends = self._decoder.range_deg
        inside = [(true >= ends[0]) & (true <= ends[1]) for true, _ in self._true]
        parts = [
            part_of("", true[kept], decoded.picked(np.flatnonzero(kept)))
            for (true, decoded), kept in zip(self._true, inside, strict=True)
            if kept.any()
        ]
        if not parts:
            return None
        whole = asdict(merged("", parts))
        return {name: whole[name] for name in AGAINST}

    def warnings(self) -> list[str]:
        """What cannot be concluded from what was decoded."""
        told, readings = [], max(self.counts["readings"], 1)
        for name, words in (
            ("outside", "lie outside of the calibrated curve, and their angles mean nothing"),
            ("ambiguous", "have several angles that explain them"),
            ("clipped", "are clipped: one receiver alone tells their angle"),
            ("missing", "miss a voltage"),
        ):
            share = 100.0 * self.counts[name] / readings
            if self.counts[name] and (name == "missing" or share >= 0.5):
                told.append(f"{self.counts[name]} readings ({share:.2g} %) {words}")
        return told


def _rows(time_s: FloatArray, good: NDArray[np.bool_], decoded: Decoded, headings: Headings) -> Iterator[str]:
    """A line for each reading, in the order of `COLUMNS`."""
    others: dict[int, list[str]] = {}
    for row, (low, high), share in zip(
        decoded.other.tolist(), decoded.other_deg.tolist(), decoded.other_probability.tolist(), strict=True
    ):
        others.setdefault(row, []).append(f"{low:.5f}..{high:.5f} ({share:.2f})")
    columns = (
        decoded.angle_deg.tolist(),
        decoded.low_deg.tolist(),
        decoded.high_deg.tolist(),
        decoded.right.tolist(),
        headings.words(),
        headings.rises.tolist(),
        _flags(decoded),
    )
    found = enumerate(zip(*columns, strict=True))
    for stamp, held in zip(time_s.tolist(), good.tolist(), strict=True):
        when = f"{stamp:.6f}" if math.isfinite(stamp) else ""
        if not held:
            yield f"{when},,,,,,,,,,missing,\n"
            continue
        number, (angle, low, high, right, heading, rises, flags) = next(found)
        side, share = ("right", right) if right >= 0.5 else ("left", 1.0 - right)
        yield (
            f"{when},{angle:.5f},{low[0]:.5f},{high[0]:.5f},{low[1]:.5f},{high[1]:.5f},"
            f"{side},{share:.3f},{heading},{rises:.3f},{flags},{' '.join(others.get(number, ()))}\n"
        )


def _flags(decoded: Decoded) -> list[str]:
    names = ("outside", "ambiguous", "clipped", "at_end")
    marks = np.column_stack([getattr(decoded, name) for name in names])
    words = [" ".join(name for name, on in zip(names, row, strict=True) if on) for row in _kinds()]
    return [words[one] for one in (marks @ (1 << np.arange(len(names)))).tolist()]


def _kinds() -> list[list[bool]]:
    return [[bool(number >> place & 1) for place in range(4)] for number in range(16)]
