"""What the commands do that look at a rig, or move its stage, without a run."""

from collections.abc import Callable
from pathlib import Path

from solen.bench import check as bench
from solen.bench import watch as watching
from solen.bench.homing import Confirm
from solen.results import Outcome


def check(rig: Path, options: bench.CheckOptions = bench.CheckOptions()) -> Outcome[bench.RigCheck]:
    """Look a rig over while it stands still."""
    return Outcome(bench.check(rig, options))


def jog(
    rig: Path, options: bench.JogOptions = bench.JogOptions(), *, confirm: Confirm | None = None
) -> Outcome[bench.Jogged]:
    """Move the stage of a rig, or ask it where it stands."""
    return Outcome(bench.jog(rig, options, confirm=confirm))


def watch(
    rig: Path, options: watching.WatchOptions, show: Callable[[watching.Seen], object]
) -> Outcome[watching.Watched]:
    """Show what the receivers of a rig read, until Ctrl-C."""
    return Outcome(watching.watch(rig, options, show))
