"""Commands that check a rig, show its readings or move its stage, without a run."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from solen.bench import check as bench
from solen.bench import watch as live
from solen.bench.homing import Confirm
from solen.pipeline.options import FLAT
from solen.results import Outcome


def check(*, rig: Path, options: Annotated[bench.CheckOptions, FLAT] = bench.CheckOptions()) -> Outcome[bench.RigCheck]:
    """Check a rig before a run: wiring, emitters, clipping, noise, ambient light, trimmers. Nothing moves.

    Parameters
    ----------
    rig
        Rig file: the instruments, and the sensors that are wired to them.
    """
    return Outcome(bench.check(rig, options))


def jog(
    rig: Path, options: bench.JogOptions = bench.JogOptions(), *, confirm: Confirm | None = None
) -> Outcome[bench.StageMove]:
    """Move the stage of a rig, or return its position."""
    return Outcome(bench.jog(rig, options, confirm=confirm))


def watch(
    rig: Path, options: live.WatchOptions, show: Callable[[live.LiveReading], object]
) -> Outcome[live.WatchSummary]:
    """Show readings of a rig's receivers until Ctrl-C."""
    return Outcome(live.watch(rig, options, show))
