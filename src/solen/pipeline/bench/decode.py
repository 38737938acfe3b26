"""Angles from voltages through a saved calibration: from a recording, from lines as they arrive, or during a run."""

import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, TextIO, TypeVar

from solen import files
from solen.analysis import SignalOptions
from solen.analysis.calibration import DecodeOptions, Decoding, StreamDecoder
from solen.analysis.calibration.csv_lines import STDIN
from solen.analysis.calibration.file import CalibrationFile, load
from solen.analysis.calibration.streams import (
    Batch,
    Stream,
    check_live,
    chosen_sensor,
    line_stream,
    recorded_stream,
)
from solen.analysis.network.file import NetworkCalibration, is_network_file, load_network
from solen.analysis.network.recorded import chosen_network, places_of
from solen.analysis.network.stream_decoder import (
    NetworkDecoding,
    NetworkStream,
    Turns,
    line_turns,
    recorded_turns,
    scale_of,
    unused,
)
from solen.arrays import in_pieces
from solen.bench.clock import WallClock
from solen.bench.follow import JournalFollower
from solen.bench.journal import SUFFIX
from solen.bench.journal_content import signal_unit
from solen.bench.outlets import Outlet, Paced, outlet
from solen.errors import SpecError
from solen.pipeline.outputs import check_table
from solen.recording import Provenance
from solen.results import Outcome

_PIECE = 4096
_POLL_S = 0.05
T = TypeVar("T")


def decode(
    calibration: Path,
    source: str,
    /,
    options: DecodeOptions | None = None,
    signals: SignalOptions | None = None,
    *,
    out: Path | None = None,
    rows: TextIO | None = None,
    warn: Callable[[str], None] | None = None,
    text: Iterable[str] | None = None,
    send: str | None = None,
    force: bool = False,
) -> Outcome[Decoding | NetworkDecoding]:
    """Decode angles from voltages by a saved calibration; Ctrl-C ends a stream.

    Parameters
    ----------
    calibration
        The calibration file.
    source
        A recording, the journal of a run, or ``-`` for lines of CSV.
    options, signals
        Options of decoding, and the roles of the columns.
    out, rows
        A .csv file, and a stream to which angles are written as they are decoded.
    warn
        Called with each warning that is known before the first reading.
    text
        Lines to read instead of standard input.
    send
        Additional destination of rows, an outlet of `solen.bench.outlets`; rows of a recording are sent in real time.
    force
        Replace ``out`` if it exists.

    Raises
    ------
    DataError, SpecError, OutputError
        If a file, an option or an output is invalid.
    """
    options, signals = options or DecodeOptions(), signals or SignalOptions()
    check_table(out, "a table of angles", source, force=force)
    if options.follow and not source.endswith(SUFFIX):
        raise SpecError("--follow", value=source, limit=f"applies only to the {SUFFIX} of a run", remedy="leave it out")
    decoder: StreamDecoder | NetworkStream
    pieces: Iterator[Any]
    given = sys.stdin if text is None else text
    if is_network_file(calibration):
        decoder, pieces = _of_network(calibration, source, options, signals, given)
    else:
        known = load(calibration)
        stream = _stream(source, options, signals, known, given)
        decoder = StreamDecoder(known, str(calibration), stream, options, signals.rails, source)
        pieces = (piece for batch in stream.batches for piece in in_pieces(batch, len(batch.time_s), _PIECE))
    if warn is not None:
        for line in decoder.warnings:
            warn(line)
    with (
        contextlib.nullcontext() if send is None else outlet(send) as sent,
        contextlib.nullcontext() if out is None else files.streamed(out) as file,
    ):
        live = source == STDIN or options.follow
        paced = sent if sent is None or live else Paced(sent, WallClock())
        interrupted = _write_rows(decoder, pieces, file, [one for one in (file, rows, paced) if one is not None])
        files_of = {} if out is None else {"out": out}
        return Outcome(decoder.result(interrupted=interrupted), files_of)


def _of_network(
    calibration: Path, source: str, options: DecodeOptions, signals: SignalOptions, text: Iterable[str]
) -> tuple[NetworkStream, Iterator[Turns]]:
    """Return a network's decoder, and its readings in successive blocks."""
    unused(options, ("sensor", "follow"))
    unused(signals)
    known, path = load_network(calibration), Path(source)
    if source == STDIN:
        lines, warnings = line_turns(text, known)
        return NetworkStream(known, str(calibration), source, None, warnings), lines
    if path.suffix != SUFFIX:
        turns, provenance, warnings = recorded_turns(path, known, options.sensor)
        pieces = in_pieces(turns, len(turns.time_s), _PIECE)
        return NetworkStream(known, str(calibration), source, provenance, warnings), pieces
    following = JournalFollower(path)
    grown = _turns(following, known, options.sensor, path.name, follow=options.follow)
    return NetworkStream(known, str(calibration), source, _provenance(following, path)), grown


def _turns(
    following: JournalFollower, known: NetworkCalibration, sensor: str | None, file: str, *, follow: bool
) -> Iterator[Turns]:
    """Yield the readings in a run's journal, in the order of a calibration; with ``follow``, until the run ends."""
    entry = chosen_network(following.header, sensor or known.sensor, file)
    scale = scale_of(file, signal_unit(following.header), known)
    lit = places_of("emitter", known.emitters, list(entry["emitters"]), file)
    read = places_of("receiver", known.receivers, list(entry["inputs"]), file)
    for one in _grown(following, lambda: following.network_readings(entry["name"]), follow=follow):
        yield Turns(one.time_s, scale * one.volts[:, lit][:, :, read], clipped=one.clipped[:, lit][:, :, read])


def _stream(
    source: str, options: DecodeOptions, signals: SignalOptions, known: CalibrationFile, text: Iterable[str]
) -> Stream:
    if source == STDIN:
        check_live(signals)
        return line_stream(text, signals)
    path = Path(source)
    if path.suffix == SUFFIX:
        check_live(signals, subtracted=True)
        return _journal(path, options, known.sensor)
    return recorded_stream(path, signals, options.sensor, known.sensor, known.stimulus_of)


def _write_rows(
    decoder: StreamDecoder | NetworkStream, pieces: Iterator[Any], file: TextIO | None, targets: list[TextIO | Outlet]
) -> bool:
    """Decode all blocks of a stream; return whether Ctrl-C stopped it."""
    for target in targets:
        print(decoder.heading if target is file else decoder.header, end="", file=target, flush=True)
    try:
        for piece in pieces:
            rows = decoder.rows(piece)
            for target in targets:
                print(rows, end="", file=target, flush=True)
    except KeyboardInterrupt:
        return True
    return False


def _journal(path: Path, options: DecodeOptions, calibrated: str) -> Stream:
    """Return the readings in a run's journal with ambient light subtracted; with ``follow``, until the run ends."""
    following = JournalFollower(path)
    names = [str(one["name"]) for one in following.header["sensors"]]
    name = chosen_sensor(names, options.sensor, calibrated, path.name)
    fresh = _grown(following, lambda: following.readings(name), follow=options.follow)
    batches = (Batch(one.time_s, one.volts, one.clipped) for one in fresh)
    return Stream(batches, name, "subtracted", _provenance(following, path), unit=signal_unit(following.header))


def _provenance(following: JournalFollower, path: Path) -> Provenance:
    """Return the provenance of readings from a run's journal."""
    header = json.dumps({key: value for key, value in following.header.items() if key != "streams"})
    simulated = bool(following.header.get("simulated"))
    return Provenance(path.name, format="journal", metadata={"header": header}, simulated=simulated)


def _grown(following: JournalFollower, fresh: Callable[[], Iterator[T]], *, follow: bool) -> Iterator[T]:
    """Yield the content added to a journal at each call of ``fresh``; with ``follow``, until the run ends."""
    while True:
        yield from fresh()
        if following.ended or not follow:
            return
        with contextlib.suppress(InterruptedError):
            time.sleep(_POLL_S)
