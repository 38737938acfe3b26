"""Commands that check a rig, show its readings or move its stage, without a run."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from solen.bench import check as bench
from solen.bench import watch as watching
from solen.bench.homing import Confirm
from solen.pipeline.options import FLAT
from solen.results import Outcome


def check(*, rig: Path, options: Annotated[bench.CheckOptions, FLAT] = bench.CheckOptions()) -> Outcome[bench.RigCheck]:
    """Check a rig before a run: wires, emitters, rails, noise, room light, trimmers. Nothing moves.

    Parameters
    ----------
    rig
        The instruments, and which sensors are wired to them.
    """
    return Outcome(bench.check(rig, options))


def jog(
    rig: Path, options: bench.JogOptions = bench.JogOptions(), *, confirm: Confirm | None = None
) -> Outcome[bench.Jogged]:
    """Move the stage of a rig, or report its position."""
    return Outcome(bench.jog(rig, options, confirm=confirm))


def watch(
    rig: Path, options: watching.WatchOptions, show: Callable[[watching.Seen], object]
) -> Outcome[watching.Watched]:
    """Show readings of a rig's receivers until Ctrl-C."""
    return Outcome(watching.watch(rig, options, show))
