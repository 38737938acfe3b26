"""Angles from voltages with a saved calibration: of a recording, of lines as they arrive, or during a run."""

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
from solen.analysis.network.recorded import indices_of, network_entry
from solen.analysis.network.stream_decoder import (
    NetworkDecoding,
    NetworkStream,
    SwitchingCycles,
    check_options,
    cycles_of_lines,
    recorded_cycles,
    scale_of,
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

_MAX_ROWS = 4096  # decoded together
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
    """Decode voltages into angles with a saved calibration; Ctrl-C ends a stream.

    Parameters
    ----------
    calibration
        The calibration file.
    source
        A recording, the journal of a run, or ``-`` for lines of CSV.
    options, signals
        Decoding options, and the roles of the columns.
    out, rows
        A .csv file, and a stream to which angles are written as they are decoded.
    warn
        Called with each warning that precedes the first reading.
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
        limit = f"applies only to the {SUFFIX} of a run, not to {source}"
        raise SpecError("--follow", limit=limit, remedy="omit it")
    decoder: StreamDecoder | NetworkStream
    pieces: Iterator[Any]
    lines = sys.stdin if text is None else text
    if is_network_file(calibration):
        decoder, pieces = _of_network(calibration, source, options, signals, lines)
    else:
        loaded = load(calibration)
        stream = _stream(source, options, signals, loaded, lines)
        decoder = StreamDecoder(loaded, str(calibration), stream, options, signals.rails, source)
        pieces = (piece for batch in stream.batches for piece in in_pieces(batch, len(batch.time_s), _MAX_ROWS))
    if warn is not None:
        for caution in decoder.warnings:
            warn(caution)
    with (
        contextlib.nullcontext() if send is None else outlet(send) as receiver,
        contextlib.nullcontext() if out is None else files.streamed(out) as file,
    ):
        live = source == STDIN or options.follow
        paced = receiver if receiver is None or live else Paced(receiver, WallClock())
        targets = [target for target in (file, rows, paced) if target is not None]
        interrupted = _write_rows(decoder, pieces, file, targets)
        return Outcome(decoder.result(interrupted=interrupted), {} if out is None else {"out": out})


def _of_network(
    file: Path, source: str, options: DecodeOptions, signals: SignalOptions, text: Iterable[str]
) -> tuple[NetworkStream, Iterator[SwitchingCycles]]:
    """Return the decoder of a network, and the switching cycles of the source in successive pieces."""
    check_options(options, ("sensor", "follow"))
    check_options(signals)
    calibration, path = load_network(file), Path(source)
    if source == STDIN:
        lines, warnings = cycles_of_lines(text, calibration)
        return NetworkStream(calibration, str(file), source, None, warnings), lines
    if path.suffix != SUFFIX:
        cycles, provenance, warnings = recorded_cycles(path, calibration, options.sensor)
        pieces = in_pieces(cycles, len(cycles.time_s), _MAX_ROWS)
        return NetworkStream(calibration, str(file), source, provenance, warnings), pieces
    following = JournalFollower(path)
    journaled = _journal_cycles(following, calibration, options.sensor, path.name, follow=options.follow)
    return NetworkStream(calibration, str(file), source, _provenance(following, path)), journaled


def _journal_cycles(
    following: JournalFollower, calibration: NetworkCalibration, sensor: str | None, file: str, *, follow: bool
) -> Iterator[SwitchingCycles]:
    """Yield the switching cycles in a run's journal, in the order of a calibration."""
    entry = network_entry(following.header, sensor or calibration.sensor, file)
    scale = scale_of(file, signal_unit(following.header), calibration)
    emitters = indices_of("emitter", calibration.emitters, list(entry["emitters"]), file)
    receivers = indices_of("receiver", calibration.receivers, list(entry["inputs"]), file)
    for part in _added(following, lambda: following.network_readings(entry["name"]), follow=follow):
        signal, clipped = scale * part.volts[:, emitters][:, :, receivers], part.clipped[:, emitters][:, :, receivers]
        yield SwitchingCycles(part.time_s, signal, clipped=clipped)


def _stream(
    source: str, options: DecodeOptions, signals: SignalOptions, calibration: CalibrationFile, text: Iterable[str]
) -> Stream:
    if source == STDIN:
        check_live(signals)
        return line_stream(text, signals)
    path = Path(source)
    if path.suffix == SUFFIX:
        check_live(signals, subtracted=True)
        return _journal(path, options, calibration.sensor)
    return recorded_stream(path, signals, options.sensor, calibration.sensor, calibration.stimulus_of)


def _write_rows(
    decoder: StreamDecoder | NetworkStream, pieces: Iterator[Any], file: TextIO | None, targets: list[TextIO | Outlet]
) -> bool:
    """Decode all pieces of a stream; return whether Ctrl-C stopped it."""
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
    """Return the readings in a run's journal, with ambient light subtracted."""
    following = JournalFollower(path)
    names = [str(entry["name"]) for entry in following.header["sensors"]]
    name = chosen_sensor(names, options.sensor, calibrated, path.name)
    parts = _added(following, lambda: following.readings(name), follow=options.follow)
    batches = (Batch(part.time_s, part.volts, part.clipped) for part in parts)
    return Stream(batches, name, "subtracted", _provenance(following, path), unit=signal_unit(following.header))


def _provenance(following: JournalFollower, path: Path) -> Provenance:
    """Return the provenance of readings from a run's journal."""
    header = json.dumps({key: value for key, value in following.header.items() if key != "streams"})
    simulated = bool(following.header.get("simulated"))
    return Provenance(path.name, format="journal", metadata={"header": header}, simulated=simulated)


def _added(following: JournalFollower, read_new: Callable[[], Iterator[T]], *, follow: bool) -> Iterator[T]:
    """Yield the new content of a journal; with ``follow``, until the run ends."""
    while True:
        yield from read_new()
        if following.ended or not follow:
            return
        with contextlib.suppress(InterruptedError):
            time.sleep(_POLL_S)
