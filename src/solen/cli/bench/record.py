"""The commands of the bench: example files, runs, recovery of interrupted runs, and lists of recordings."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from solen.bench.catalogue import RecordingList
from solen.bench.interrupts import Ended, ignore_signals
from solen.bench.netcdf import RecordedRun
from solen.bench.record import RecordOptions
from solen.bench.run import Tick
from solen.cli.app import SHOWN, lines
from solen.pipeline.bench import record as pipeline
from solen.pipeline.bench.record import new as new
from solen.pipeline.bench.record import recordings as recordings
from solen.pipeline.bench.record import recover as recover
from solen.pipeline.options import FLAT
from solen.results import Outcome

BLOCKS = "▁▂▃▄▅▆▇█"


def run(
    protocol: Path, /, *, rig: Path, out: Path, options: Annotated[RecordOptions, FLAT] = RecordOptions()
) -> Outcome[RecordedRun]:
    """Run a protocol and record it; Ctrl-C or a termination signal switches the emitters off and stops the stage.

    Parameters
    ----------
    protocol
        Protocol file: the motion of the stage.
    rig
        Rig file: the instruments, and the sensors that are wired to them.
    out
        Folder of the recording.
    """
    with _live() as (watch, report, confirm):
        try:
            return pipeline.run(protocol, rig, out, options, watch=watch, report=report, confirm=confirm)
        except Ended:
            ignore_signals()  # the files that are kept have yet to be reported
            raise


@lines.register
def _(result: pipeline.BenchFolder) -> Iterator[str]:
    yield f"next: solen bench run {result.protocol} --rig rig.toml --out recordings, in {result.folder}"


@lines.register
def _(recorded: RecordedRun) -> Iterator[str]:
    simulated = " (simulated)" if recorded.simulated else ""
    counts = f"{recorded.cycles} cycles, {recorded.duration_s:.1f} s, {recorded.periods} periods"
    yield f"{recorded.outcome}: {counts}{simulated}"
    yield from (f"  {name:12} {readings} readings" for name, readings in recorded.sensors.items())


@lines.register
def _(recording_list: RecordingList) -> Iterator[str]:
    for entry in recording_list.recordings:
        flags = f"{', simulated' if entry.simulated else ''}{'' if entry.there else ', MISSING'}"
        size = f"{entry.duration_s:.0f} s, {len(entry.sensors)} sensors"
        yield f"{entry.date}  {entry.file:24} {entry.protocol}, {size}, {entry.outcome}{flags}"
    yield from (
        f"not closed: {name}; use solen bench recover, or solen bench run --resume" for name in recording_list.journals
    )
    if not (recording_list.recordings or recording_list.journals or recording_list.not_recordings):
        yield f"no recordings in {recording_list.folder}"


@contextmanager
def _live() -> Iterator[tuple[Callable[[Tick], None] | None, Callable[[str], None], Callable[[str], bool] | None]]:
    """Yield functions that show a status line on stderr, if it is a terminal, and that ask the operator a question."""
    ask = confirmation()
    if SHOWN.quiet or not sys.stderr.isatty():
        yield None, lambda _: None, ask
        return
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    def status(text: str) -> Text:
        return Text(text, no_wrap=True, overflow="ellipsis")

    with Live(status("starting"), console=Console(stderr=True), transient=True, refresh_per_second=10) as live:

        def pause_and_ask(question: str) -> bool:
            live.stop()
            try:
                return ask is not None and ask(question)
            finally:
                live.start()

        yield (
            lambda tick: live.update(status(_line(tick))),
            lambda text: live.update(status(text)),
            None if ask is None else pause_and_ask,
        )


def confirmation() -> Callable[[str], bool] | None:
    """Return a function that asks the operator at the terminal; None without a terminal."""
    return _ask if sys.stdin.isatty() and sys.stderr.isatty() else None


def _ask(question: str) -> bool:
    """Return whether the operator answers yes; any other answer is treated as no."""
    sys.stderr.write(f"{question} [y/N] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().casefold() in {"y", "yes"}


def block(height: float) -> str:
    """Return a block character with a height from 0 to 1."""
    return BLOCKS[min(7, int(8 * max(0.0, height)))]


def _line(tick: Tick) -> str:
    """Return the status line: progress of the run, and the brightness at each input while its emitters are on."""
    levels = " ".join(f"{number}:{block(level)}" for number, level in enumerate(tick.levels, 1))
    positions = " ".join(f"{position:+7.3f}" for position in tick.position.values())
    return f"cycle {tick.cycle}/{tick.cycles}  {tick.t_s:7.1f} s  at {positions}  {levels}"
