"""Options of tracing, as they were typed, and what they must be for what is traced."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from solen.errors import OutputError, SpecError
from solen.pipeline.outputs import check_choice
from solen.scene import Scene
from solen.sensor import TraceOptions
from solen.trace.dataset import check_installed

MOST_PATHS = 100_000
"""Rays whose ways are written out at most."""
MOST_BINS = 10_000
"""Bins of a histogram at most."""
LARGEST_SEED = 2**63 - 1


@dataclass(frozen=True)
class Sampling:
    """How `trace_design` chooses and follows rays, as said on the command line; None is what was not said."""

    method: str = "fan"
    seed: str | None = None
    tolerance: float | None = None
    precision: str | None = None
    histogram: str | None = None

    def options(self, mode: str, draws: bool = False) -> TraceOptions:
        """What `Sensor.trace` is told; `SpecError` for what is wrong, or has no effect in this mode."""
        if self.tolerance is not None:
            raise SpecError("--tolerance", value=self.tolerance, limit="is of --sampling adaptive", remedy="add that")
        sampling: Literal["fan", "sobol"] = "sobol" if self.method == "sobol" else "fan"
        precision: Literal["double", "single"] = "single" if self.precision == "single" else "double"
        if self.seed is not None and sampling == "fan" and mode != "roulette" and not draws:
            limit = f"nothing is drawn in mode {mode} with a fan"
            raise SpecError("--seed", value=self.seed, limit=limit, remedy="add --sampling sobol or --mode roulette")
        found = TraceOptions(sampling=sampling, precision=precision)
        if self.seed is not None:
            found["seed"] = _whole("--seed", self.seed, 0, LARGEST_SEED)
        if self.histogram is not None:
            found["position_bins"] = found["angle_bins"] = _whole("--histogram", self.histogram, 1, MOST_BINS)
        return found

    def check(self) -> None:
        """`SpecError` for a choice that there is not, or one that adaptive integration does not have."""
        check_choice("--sampling", self.method, ("fan", "sobol", "adaptive"))
        check_choice("--precision", self.precision or "double", ("double", "single"))
        if self.method != "adaptive":
            return
        others = {"--seed": self.seed, "--precision": self.precision, "--histogram": self.histogram}
        for name, value in others.items():
            if value is not None:
                limit = "has no meaning with --sampling adaptive"
                raise SpecError(name, value=value, limit=limit, remedy="leave one of them out")


def check_paths(scene: Scene) -> None:
    """`SpecError` where the ways of a scene's rays cannot be written."""
    if scene.rays > MOST_PATHS:
        raise SpecError("--paths", value=f"{scene.rays} rays", limit=f"writes at most {MOST_PATHS} of them")
    if scene.extrusion is not None:
        limit = "writes ways in the plane, and these rays are in space"
        raise SpecError("--paths", limit=limit, remedy="leave it out, or trace the plane")


def check_netcdf(target: Path) -> None:
    """`OutputError` where a netCDF file cannot be written by that name, or by this installation."""
    if target.suffix.lower() != ".nc":
        raise OutputError(str(target), limit="a netCDF file ends in .nc", remedy="rename it")
    check_installed()


def _whole(name: str, text: str, least: int, most: int) -> int:
    """Number of a text of digits."""
    value = int(text) if text.isdecimal() and len(text) < 30 else -1
    if not least <= value <= most:
        raise SpecError(name, value=text, limit=f"must be a whole number from {least} to {most}")
    return value
