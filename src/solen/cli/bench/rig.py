"""The commands of the bench: files to start from, a run, a run that was left, and what was recorded."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from solen.cli.app import Json, show

if TYPE_CHECKING:
    from solen.bench.run import Tick


def new(folder: Path, /, *, as_json: Json = False) -> None:
    """Write two protocols, two simulated rigs and their design into a folder.

    Parameters
    ----------
    folder
        Where rotation.toml, bending.toml, rig.toml (with a board), rig-daq.toml (with a data acquisition) and
        sensor.toml go.
    """
    from solen.pipeline.bench import rig as pipeline

    found = pipeline.new(folder)
    show(found, as_json, lambda: [f"wrote {name}" for name in found["files"]])


def run(
    protocol: Path,
    /,
    *,
    rig: Path,
    out: Path,
    name: str | None = None,
    seed: int | None = None,
    resume: Annotated[bool, Parameter(negative=())] = False,
    real_time: Annotated[bool, Parameter(negative=())] = False,
    as_json: Json = False,
) -> None:
    """Run a protocol and leave a recording; Ctrl-C switches the emitters off and stops the stage.

    Parameters
    ----------
    protocol
        What the stage does.
    rig
        The instruments, and which sensors are wired to them.
    out
        Folder of the recording.
    name
        Name of the recording; by default that of the protocol's file.
    seed
        Seed of a simulated rig, instead of its file's: other prints, other noise.
    resume
        Take up a run that was stopped or killed, after its last whole cycle.
    real_time
        Let a simulated rig take as long as a real one.
    """
    from solen.pipeline.bench import rig as pipeline

    asked = pipeline.Asked(protocol, rig, out, name, seed, resume, real_time)
    with _live() as (watch, say):
        found = pipeline.run(asked, watch=watch, say=say)
    show(found, as_json, lambda: _told(found))


def recover(journal: Path, /, *, as_json: Json = False) -> None:
    """Close the journal of a run that was stopped or killed into a recording.

    Parameters
    ----------
    journal
        The .journal file that it left.
    """
    from solen.pipeline.bench import rig as pipeline

    found = pipeline.recover(journal)
    show(found, as_json, lambda: _told(found))


def recordings(
    folder: Path = Path(), /, *, look: Annotated[bool, Parameter(negative=())] = False, as_json: Json = False
) -> None:
    """List the recordings of a folder.

    Parameters
    ----------
    folder
        The folder; by default this one.
    look
        Look for recordings that were put there by hand.
    """
    from solen.pipeline.bench import rig as pipeline

    found = pipeline.recordings(folder, look=look)
    show(found, as_json, lambda: _listed(found))


def _told(found: dict[str, Any]) -> list[str]:
    lost = {name: number for name, number in found.get("losses", {}).items() if number}
    return [
        f"{found['outcome']}: {found['cycles']} cycles, {found['duration_s']:.1f} s, {found['periods']} periods"
        + (" (simulated)" if found["simulated"] else ""),
        *(f"  {name:12} {readings} readings" for name, readings in found["sensors"].items()),
        *([f"warning: lost {', '.join(f'{number} {name}' for name, number in lost.items())}"] if lost else []),
        *(f"warning: {remark}" for remark in found["remarks"]),
        *([f"warning: the last {found['lost_bytes']} bytes were not whole"] if found["lost_bytes"] else []),
        f"recording: {found['recording']}",
    ]


def _listed(found: dict[str, Any]) -> list[str]:
    lines = [
        f"{row['date']}  {row['file']:24} {row['protocol']}, {row['duration_s']:.0f} s, {len(row['sensors'])} sensors, "
        f"{row['outcome']}{', simulated' if row['simulated'] else ''}{'' if row['there'] else ', MISSING'}"
        for row in found["recordings"]
    ]
    lines += [f"left: {name}; solen bench recover, or solen bench run --resume" for name in found["left"]]
    lines += [f"warning: {name} is no recording of solen bench run" for name in found["strange"]]
    return lines or [f"no recordings in {found['folder']}"]


@contextmanager
def _live() -> Iterator[tuple[Callable[["Tick"], None] | None, Callable[[str], None]]]:
    """A line on stderr that follows the run, where that is a terminal."""
    if not sys.stderr.isatty():
        yield None, lambda _: None
        return
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    def shown(text: str) -> Text:
        return Text(text, no_wrap=True, overflow="ellipsis")

    with Live(shown("beginning"), console=Console(stderr=True), transient=True, refresh_per_second=10) as live:
        yield (lambda tick: live.update(shown(_line(tick)))), (lambda text: live.update(shown(text)))


def _line(tick: "Tick") -> str:
    """One line: where the run is, and how bright each input is while its emitters are on."""
    levels = ""
    if tick.counts is not None:
        on = tick.counts[:, 0, :].min(axis=0)
        off = tick.counts[:, 1, :].max(axis=0)
        share = (off.astype(float) - on) / max(float(off.max()), 1.0)
        levels = " ".join(
            f"{number}:{'▁▂▃▄▅▆▇█'[min(7, int(8 * max(0.0, one)))]}" for number, one in enumerate(share, 1)
        )
    return f"cycle {tick.cycle}/{tick.cycles}  {tick.t_s:7.1f} s  at {tick.position:+7.3f}  {levels}"
