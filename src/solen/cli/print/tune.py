"""The command that tunes a lens from print to print."""

from collections.abc import Iterator

from solen.cli.app import lines, simulated
from solen.explore import TunedPrint
from solen.explore.tuning_log import Residual, TunedResponse
from solen.pipeline.print.tune import tune as tune


@lines.register
def _(tuned: TunedPrint) -> Iterator[str]:
    common, (low, high) = tuned.common, tuned.drawn_range_um
    yield f"{simulated(tuned)}print {tuned.number} of {tuned.design}, drawn by {tuned.drawn_by} ({tuned.process})"
    yield f"deviation from the design {tuned.rms_um:.3g} ± {tuned.u_rms_um:.2g} µm RMS"
    yield (
        f"common to all prints (number: {common.prints}): overgrowth {common.overgrowth_um:+.3g} ± "
        f"{common.u_overgrowth_um:.2g} µm, size {common.size_percent:+.2g} ± {common.u_size_percent:.2g} %, form "
        f"{common.form_um:.2g} µm RMS; prints differ by about {common.repeat_um:.2g} µm"
    )
    decision = "the drawing is kept" if tuned.kept else f"corrected: {', '.join(tuned.corrected)}"
    yield (
        f"{decision}; the drawing moves the lens by {low:+.3g} to {high:+.3g} µm and the walls by "
        f"{tuned.wall_um:+.3g} µm, and scales the part by {tuned.scale:.5g}"
    )
    yield f"the same drawing printed again: {_residual(tuned.unchanged)}"
    yield f"the next print, of the {'kept' if tuned.kept else 'corrected'} drawing: {_residual(tuned.predicted)}"
    if (traced := tuned.response) is not None:
        dimension = "in space" if traced.dimension == "extruded" else "in the plane"
        responses = (("designed", traced.designed), ("this print", traced.before), ("next", traced.after))
        for name, response in responses:
            yield f"response {dimension}, {name}: {_response(response)}"
    if len(tuned.history) > 1:
        steps = (f"{step.rms_um:.3g}" for step in tuned.history)
        yield f"deviations of all prints: {', '.join(steps)} µm RMS"


def _residual(residual: Residual) -> str:
    low, high = residual.interval95_rms_um
    return f"{residual.rms_um:.3g} ± {residual.u_rms_um:.2g} µm RMS predicted, 95 % interval {low:.2g} to {high:.2g}"


def _response(response: TunedResponse) -> str:
    slope = f"slope of the contrast at 0 deg {response.slope_per_deg:+.3g} ± {response.u_slope_per_deg:.1g} per degree"
    if response.null_deg is None or response.u_null_deg is None:
        return f"{slope}, no null"
    return f"{slope}, null at {response.null_deg:+.3f} ± {response.u_null_deg:.2g} deg"
