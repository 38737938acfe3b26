"""The commands before a run: `solen bench check`, `solen bench watch` and `solen bench jog`."""

import sys
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from solen.bench.check import InputCheck, Jogged, JogOptions, RigCheck, of_noise
from solen.bench.watch import Seen, Watched, WatchOptions
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


def jog(*, rig: Path, options: Annotated[JogOptions, FLAT] = JogOptions()) -> Outcome[Jogged]:
    """Move the stage of a rig within its travel; without --to and --by, show its position.

    Parameters
    ----------
    rig
        The rig file that describes the stage.
    """
    return pipeline.jog(rig, options, confirm=confirmation())


def watch(*, rig: Path, options: Annotated[WatchOptions, FLAT] = WatchOptions()) -> Outcome[Watched]:
    """Show live readings of the receivers: a plot in a terminal, CSV lines elsewhere. Ctrl-C stops.

    Parameters
    ----------
    rig
        The instruments, and which sensors are wired to them.
    """
    with _shown() as show:
        return pipeline.watch(rig, options, show)


@lines.register
def _(checked: RigCheck) -> Iterator[str]:
    yield f"{checked.rig}: {checked.periods} periods{', simulated' if checked.simulated else ''}"
    for name, receivers in checked.sensors.items():
        for side, own in receivers.items():
            yield f"  {name} {side:5} (input {own.input}): {_levels(own, checked.unit)}"
    if (cell := checked.load_cell) is not None:
        yield f"  load cell (input {cell.input}): {cell.level_V:.5g} V, noise {1e3 * cell.noise_N:.3g} mN"
    if not checked.faults:
        yield "no problems"


def _levels(own: InputCheck, unit: str) -> str:
    turn = "" if own.load_factor is None else f"; multiply the resistance of its trimmer by {own.load_factor:.2g}"
    share = f" ({100 * own.signal_V / own.off_V:.0f} %)" if own.off_V else ""
    return (
        f"{own.off_V:.5g} {unit} off, {own.on_V:.5g} {unit} on; signal {own.signal_V:.5g} {unit}{share}, "
        f"noise {of_noise(own.noise_V, unit)}, "
        f"off varies by {of_noise(own.room_V, unit)}{turn}"
    )


@lines.register
def _(moved: Jogged) -> Iterator[str]:
    begun, stands = _place(moved.begun_deg, moved.begun_mm), _place(moved.stands_deg, moved.stands_mm)
    yield f"{moved.stage} is at {stands}" + ("" if begun == stands else f"; it was at {begun}")


def _place(deg: float | None, mm: float | None) -> str:
    if deg is not None:
        return f"{deg:+.4g}°"
    return "an unknown position" if mm is None else f"{mm:+.4g} mm"


@lines.register
def _(watched: Watched) -> Iterator[str]:
    yield f"{watched.looks} readings in {watched.duration_s:.1f} s{', simulated' if watched.simulated else ''}"


@contextmanager
def _shown() -> Iterator[Callable[[Seen], None]]:
    """Show a live plot if stdout is a terminal; otherwise lines on stdout, or nothing with ``--quiet``."""
    if SHOWN.quiet or SHOWN.as_json:
        yield lambda _: None
        return
    if not sys.stdout.isatty():
        yield _Rows().show
        return
    from rich.live import Live

    history: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=HISTORY))
    with Live(refresh_per_second=10) as live:
        yield lambda seen: live.update(_plot(seen, history))


class _Rows:
    """CSV lines, preceded by a header."""

    def __init__(self) -> None:
        self._begun = False

    def show(self, seen: Seen) -> None:
        if not self._begun:
            names = ",".join(f"{name} {side}/{seen.unit}" for name, both in seen.signal_V.items() for side in both)
            print(f"time/s,{names}", flush=True)
        self._begun = True
        values = ",".join(f"{value:.7g}" for both in seen.signal_V.values() for value in both.values())
        print(f"{seen.t_s:.3f},{values}", flush=True)


def _plot(seen: Seen, history: dict[str, "deque[float]"]) -> "Table":
    from rich.table import Table

    titles = f"signal / {seen.unit}", f"off / {seen.unit}", f"last {HISTORY} looks"
    table = Table("receiver", *titles, title=f"{seen.t_s:.1f} s", expand=False)
    for name, signals in seen.signal_V.items():
        for side, signal in signals.items():
            past = history[f"{name} {side}"]
            past.append(signal)
            table.add_row(f"{name} {side}", f"{signal:.5g}", f"{seen.off_V[name][side]:.5g}", sparkline(past))
    return table


def sparkline(values: "deque[float]") -> str:
    """Return values as block characters, scaled from the lowest to the highest."""
    low, high = min(values), max(values)
    steps = (0.0 if high == low else (value - low) / (high - low) for value in values)
    return "".join(map(block, steps))
