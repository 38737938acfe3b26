"""The commands before a run: `solen bench check`, `solen bench watch` and `solen bench jog`."""

import sys
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from solen.bench.check import InputCheck, JogOptions, RigCheck, StageMove, noise_text
from solen.bench.watch import LiveReading, WatchOptions, WatchSummary
from solen.cli.app import SHOWN, lines
from solen.cli.bench.record import block, confirmation
from solen.pipeline.bench import look as pipeline
from solen.pipeline.bench.look import check as check
from solen.pipeline.options import FLAT
from solen.results import Outcome

if TYPE_CHECKING:
    from rich.table import Table

HISTORY = 60
"""Number of readings in the history of a live plot."""


def jog(*, rig: Path, options: Annotated[JogOptions, FLAT] = JogOptions()) -> Outcome[StageMove]:
    """Move the stage of a rig within its travel; without --to and --by, show its position.

    Parameters
    ----------
    rig
        Rig file that describes the stage.
    """
    return pipeline.jog(rig, options, confirm=confirmation())


def watch(*, rig: Path, options: Annotated[WatchOptions, FLAT] = WatchOptions()) -> Outcome[WatchSummary]:
    """Show live readings of the receivers: a plot in a terminal, otherwise CSV lines. Ctrl-C stops.

    Parameters
    ----------
    rig
        Rig file: the instruments, and the sensors that are wired to them.
    """
    with _display() as show:
        return pipeline.watch(rig, options, show)


@lines.register
def _(checked: RigCheck) -> Iterator[str]:
    yield f"{checked.rig}: {checked.periods} periods{', simulated' if checked.simulated else ''}"
    for name, receivers in checked.sensors.items():
        for side, receiver in receivers.items():
            yield f"  {name} {side:5} (input {receiver.input}): {_levels(receiver, checked.unit)}"
    if (cell := checked.load_cell) is not None:
        yield f"  load cell (input {cell.input}): {cell.level_V:.5g} V, noise {1e3 * cell.noise_N:.3g} mN"
    if not checked.faults:
        yield "no problems"


def _levels(receiver: InputCheck, unit: str) -> str:
    percent = f" ({100 * receiver.signal_V / receiver.off_V:.0f} %)" if receiver.off_V else ""
    advice = ""
    if receiver.load_factor is not None:
        advice = f"; multiply the resistance of its trimmer by {receiver.load_factor:.2g}"
    return (
        f"{receiver.off_V:.5g} {unit} off, {receiver.on_V:.5g} {unit} on; "
        f"signal {receiver.signal_V:.5g} {unit}{percent}, noise {noise_text(receiver.noise_V, unit)}, "
        f"off varies by {noise_text(receiver.room_V, unit)}{advice}"
    )


@lines.register
def _(move: StageMove) -> Iterator[str]:
    begin, end = _position(move.begun_deg, move.begun_mm), _position(move.stands_deg, move.stands_mm)
    yield f"{move.stage} is at {end}" + ("" if begin == end else f"; it was at {begin}")


def _position(deg: float | None, mm: float | None) -> str:
    if deg is not None:
        return f"{deg:+.4g}°"
    return "an unknown position" if mm is None else f"{mm:+.4g} mm"


@lines.register
def _(summary: WatchSummary) -> Iterator[str]:
    yield f"{summary.looks} readings in {summary.duration_s:.1f} s{', simulated' if summary.simulated else ''}"


@contextmanager
def _display() -> Iterator[Callable[[LiveReading], None]]:
    """Yield a function that shows a reading: in a live plot, as a CSV line, or not at all with ``--quiet``."""
    if SHOWN.quiet or SHOWN.as_json:
        yield lambda _: None
        return
    if not sys.stdout.isatty():
        yield _CsvLines().show
        return
    from rich.live import Live

    history: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=HISTORY))
    with Live(refresh_per_second=10) as live:
        yield lambda reading: live.update(_plot(reading, history))


class _CsvLines:
    """CSV lines on stdout, preceded by a header."""

    def __init__(self) -> None:
        self._has_header = False

    def show(self, reading: LiveReading) -> None:
        if not self._has_header:
            columns = (f"{name} {side}/{reading.unit}" for name, sides in reading.signal_V.items() for side in sides)
            print(f"time/s,{','.join(columns)}", flush=True)
        self._has_header = True
        values = (f"{value:.7g}" for sides in reading.signal_V.values() for value in sides.values())
        print(f"{reading.t_s:.3f},{','.join(values)}", flush=True)


def _plot(reading: LiveReading, history: dict[str, "deque[float]"]) -> "Table":
    from rich.table import Table

    titles = f"signal / {reading.unit}", f"off / {reading.unit}", f"last {HISTORY} readings"
    table = Table("receiver", *titles, title=f"{reading.t_s:.1f} s", expand=False)
    for name, signals in reading.signal_V.items():
        for side, signal in signals.items():
            past = history[f"{name} {side}"]
            past.append(signal)
            table.add_row(f"{name} {side}", f"{signal:.5g}", f"{reading.off_V[name][side]:.5g}", sparkline(past))
    return table


def sparkline(values: "deque[float]") -> str:
    """Return values as block characters, scaled from the lowest to the highest."""
    low, high = min(values), max(values)
    heights = (0.0 if high == low else (value - low) / (high - low) for value in values)
    return "".join(map(block, heights))
