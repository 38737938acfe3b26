"""The command that predicts the printed lens of a design."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.fabricate.process import PrintedDesign, PrintedLayers
from solen.fabricate.process.printed_layers import LayerDeviation
from solen.pipeline.print.predict import predict as predict
from solen.sensor.print_loss import EmitterLoss, PrintLoss


@lines.register
def _(prediction: PrintedDesign) -> Iterator[str]:
    off, (x, z) = prediction.deviation, prediction.deviation.largest_at_mm
    first = next(iter(prediction.contributions_um), None)
    most = "" if first is None else f", mostly from {first} ({prediction.contributions_um[first]:.2g} µm)"
    yield f"simulated: {prediction.name}, printed {prediction.orientation} ({prediction.process})"
    yield f"profile: {prediction.profile_at}"
    yield (
        f"deviation from the designed lens {off.rms_um:.3g} µm rms, mean {off.mean_um:+.3g}, largest "
        f"{off.largest_um:+.3g} at x = {x:.3g}, z = {z:.3g} mm (positive: more material)"
    )
    yield f"uncertainty ± {prediction.u_rms_um:.2g} µm{most}"
    yield f"shape alone, moved by {prediction.shape.shift_z_um:+.3g} µm along z: {prediction.shape.rms_um:.3g} µm rms"
    if (phase := prediction.phase) is not None:
        x, z = phase.phase_px
        yield (
            f"vertex at {x:g} {z:g} of its pixel: shape alone {phase.shape_um:.3g} µm rms, on a corner "
            f"{phase.on_a_corner_um:.3g}, at worst {phase.worst_um:.3g}; solen print layers --phase-px {x:g} {z:g}"
        )
    ripple = prediction.ripple
    rms = "" if ripple.rms_um is None else f", {ripple.rms_um:.2g} µm rms"
    yield f"ripple of the layers along the {ripple.along}: {ripple.peak_to_valley_um:.2g} µm peak to valley{rms}"
    if (walls := prediction.walls) is not None:
        yield (
            f"{walls.layers} layers; straight walls exceed their image by {walls.first_um:+.3g} "
            f"µm at the first, {walls.middle_um:+.3g} at mid-height, {walls.last_um:+.3g} at the "
            "last"
        )
    if prediction.response is not None:
        yield from _response(prediction.response)
    if prediction.compensation is not None:
        yield from _compensation(prediction)
    if (part := prediction.part) is not None:
        more = 100.0 * (part.printed_mm3 / part.designed_mm3 - 1.0)
        yield f"solid: {part.printed_mm3:.2f} mm3, {more:+.2g} % of the designed {part.designed_mm3:.2f} mm3"


@lines.register
def _(prediction: PrintedLayers) -> Iterator[str]:
    yield f"simulated: {prediction.name}, {prediction.shape}, {prediction.layers} layers ({prediction.process})"
    yield f"deviation from the designed face {prediction.rms_um:.3g} µm rms (positive: more material)"
    yield from map(_layer, prediction.deviations)
    if prediction.compensated_rms_um is not None and prediction.drawn_range_um is not None:
        low, high = prediction.drawn_range_um
        rounds = len(prediction.rounds_um or ()) - 1
        yield (
            f"compensated: {prediction.compensated_rms_um:.2g} µm rms after {rounds} rounds; the drawing moves the "
            f"face by {low:+.3g} to {high:+.3g} µm along z"
        )
        yield from map(_layer, prediction.compensated_deviations)
    if prediction.responses:
        angles = ", ".join(f"{angle:g}" for angle in prediction.responses[0].angle_deg)
        yield f"contrast at {angles} deg; light of both receivers"
    for response in prediction.responses:
        values = "  ".join(
            f"{value:.3f} ± {u:.1g}" for value, u in zip(response.contrast, response.u_contrast, strict=True)
        )
        yield f"  {response.name:<24}  {values}  {response.light:.3f} ± {response.u_light:.1g}"
    if prediction.remaining:
        yield "contrast relative to that of the printed cylinder"
    for name, shares in prediction.remaining.items():
        pairs = zip(shares, prediction.u_remaining[name], strict=True)
        yield f"  {name:<24}  {'  '.join(f'{share:.3f} ± {u:.1g}' for share, u in pairs)}"


def _layer(one: LayerDeviation) -> str:
    return (
        f"  layer {one.layer}, {one.height_mm:.4g} mm above the plate: {one.rms_um:.3g} ± {one.u_rms_um:.2g} µm rms, "
        f"mean {one.mean_um:+.3g}, largest {one.largest_um:+.3g} at |x| = {one.largest_x_mm:.3g} mm"
    )


def _response(response: PrintLoss) -> Iterator[str]:
    width_mm = response.own.width_mm
    yield _loss("a point emitter" if width_mm == 0.0 else f"the emitter of {width_mm:g} mm", response.own)
    if response.chip is not None:
        yield _loss(f"a chip of {response.chip.width_mm:g} mm", response.chip)


def _loss(emitter: str, loss: EmitterLoss) -> str:
    if loss.slope_lost_percent is None or loss.largest_change is None or loss.light_lost_percent is None:
        return f"contrast with {emitter}: none, too little light arrives"
    return (
        f"contrast with {emitter}: {loss.slope_designed_per_deg:.3g} per degree about 0 designed, "
        f"{loss.slope_printed_per_deg:.3g} printed ({-loss.slope_lost_percent:+.2g} %); largest change "
        f"{loss.largest_change:+.3g} at {loss.largest_change_at_deg:g} deg; light {-loss.light_lost_percent:+.2g} %"
    )


def _compensation(prediction: PrintedDesign) -> Iterator[str]:
    if (made := prediction.compensation) is None:
        return
    low, high = made.drawn_range_um
    yield (
        f"compensated: {prediction.deviation.rms_um:.3g} µm rms before, {made.printed.rms_um:.2g} after "
        f"{len(made.rounds_um)} rounds (largest {made.printed.largest_um:+.2g}); the drawing moves the lens by "
        f"{low:+.3g} to {high:+.3g} µm and the walls by {made.wall_um:+.3g} µm, and scales all by {made.scale:.5g}"
    )
    if prediction.compensated_response is not None:
        loss = prediction.compensated_response.real
        yield _loss(f"an emitter of {loss.width_mm:g} mm, compensated", loss)
