"""The command that predicts the printed lens of a design."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.fabricate.process import PrintedDesign, PrintedLayers
from solen.fabricate.process.printed_layers import LayerDeviation
from solen.pipeline.print.predict import predict as predict
from solen.sensor.print_loss import EmitterLoss, PrintLoss


@lines.register
def _(prediction: PrintedDesign) -> Iterator[str]:
    deviation, (x, z) = prediction.deviation, prediction.deviation.largest_at_mm
    first = next(iter(prediction.contributions_um), None)
    origin = "" if first is None else f", mostly from {first} ({prediction.contributions_um[first]:.2g} µm)"
    yield f"simulated: {prediction.name}, printed {prediction.orientation} ({prediction.process})"
    yield f"profile: {prediction.profile_at}"
    yield (
        f"deviation from the designed lens {deviation.rms_um:.3g} µm RMS, mean {deviation.mean_um:+.3g}, largest "
        f"{deviation.largest_um:+.3g} at x = {x:.3g}, z = {z:.3g} mm (positive: additional material)"
    )
    yield f"uncertainty ± {prediction.u_rms_um:.2g} µm{origin}"
    yield f"shape, after a shift by {prediction.shape.shift_z_um:+.3g} µm along z: {prediction.shape.rms_um:.3g} µm RMS"
    if (phase := prediction.phase) is not None:
        x, z = phase.phase_px
        yield (
            f"best position in the pixel {x:g} {z:g}: shape {phase.shape_um:.3g} µm RMS, at a corner "
            f"{phase.on_a_corner_um:.3g}, at the worst {phase.worst_um:.3g}; solen print layers --phase-px {x:g} {z:g}"
        )
    ripple = prediction.ripple
    rms = "" if ripple.rms_um is None else f", {ripple.rms_um:.2g} µm RMS"
    yield f"layer ripple along the {ripple.along}: {ripple.peak_to_valley_um:.2g} µm peak to valley{rms}"
    if (walls := prediction.walls) is not None:
        yield (
            f"{walls.layers} layers; growth of straight walls {walls.first_um:+.3g} µm at the first layer, "
            f"{walls.middle_um:+.3g} at mid-height, {walls.last_um:+.3g} at the last"
        )
    if prediction.response is not None:
        yield from _response(prediction.response)
    if prediction.compensation is not None:
        yield from _compensation(prediction)
    if (part := prediction.part) is not None:
        excess = 100.0 * (part.printed_mm3 / part.designed_mm3 - 1.0)
        yield f"solid: {part.printed_mm3:.2f} mm3, {excess:+.2g} % relative to the designed {part.designed_mm3:.2f} mm3"


@lines.register
def _(prediction: PrintedLayers) -> Iterator[str]:
    yield f"simulated: {prediction.name}, {prediction.shape}, {prediction.layers} layers ({prediction.process})"
    yield f"deviation from the designed face {prediction.rms_um:.3g} µm RMS (positive: additional material)"
    yield from map(_layer, prediction.deviations)
    if prediction.compensated_rms_um is not None and prediction.drawn_range_um is not None:
        low, high = prediction.drawn_range_um
        rounds = len(prediction.rounds_um or ()) - 1
        yield (
            f"compensated: {prediction.compensated_rms_um:.2g} µm RMS after {rounds} rounds; the drawing moves the "
            f"face by {low:+.3g} to {high:+.3g} µm along z"
        )
        yield from map(_layer, prediction.compensated_deviations)
    if prediction.responses:
        angles = ", ".join(f"{angle:g}" for angle in prediction.responses[0].angle_deg)
        yield f"contrast at {angles} deg, and light of both receivers"
    for response in prediction.responses:
        values = "  ".join(
            f"{value:.3f} ± {u:.1g}" for value, u in zip(response.contrast, response.u_contrast, strict=True)
        )
        yield f"  {response.name:<24}  {values}  {response.light:.3f} ± {response.u_light:.1g}"
    if prediction.remaining:
        yield "contrast relative to that of the printed cylinder"
    for name, ratios in prediction.remaining.items():
        pairs = zip(ratios, prediction.u_remaining[name], strict=True)
        yield f"  {name:<24}  {'  '.join(f'{ratio:.3f} ± {u:.1g}' for ratio, u in pairs)}"


def _layer(layer: LayerDeviation) -> str:
    return (
        f"  layer {layer.layer}, {layer.height_mm:.4g} mm above the plate: {layer.rms_um:.3g} ± {layer.u_rms_um:.2g} "
        f"µm RMS, mean {layer.mean_um:+.3g}, largest {layer.largest_um:+.3g} at |x| = {layer.largest_x_mm:.3g} mm"
    )


def _response(response: PrintLoss) -> Iterator[str]:
    width_mm = response.own.width_mm
    yield _loss("a point emitter" if width_mm == 0.0 else f"the emitter, {width_mm:g} mm wide", response.own)
    if response.chip is not None:
        yield _loss(f"an emitter {response.chip.width_mm:g} mm wide", response.chip)


def _loss(emitter: str, loss: EmitterLoss) -> str:
    if loss.slope_lost_percent is None or loss.largest_change is None or loss.light_lost_percent is None:
        return f"contrast with {emitter}: undefined, too little light at the receivers"
    return (
        f"contrast with {emitter}: slope at 0 deg {loss.slope_designed_per_deg:.3g} per degree as designed, "
        f"{loss.slope_printed_per_deg:.3g} as printed ({-loss.slope_lost_percent:+.2g} %); largest change "
        f"{loss.largest_change:+.3g} at {loss.largest_change_at_deg:g} deg; light {-loss.light_lost_percent:+.2g} %"
    )


def _compensation(prediction: PrintedDesign) -> Iterator[str]:
    if (compensation := prediction.compensation) is None:
        return
    (low, high), printed = compensation.drawn_range_um, compensation.printed
    yield (
        f"compensated: {prediction.deviation.rms_um:.3g} µm RMS before, {printed.rms_um:.2g} after "
        f"{len(compensation.rounds_um)} rounds (largest {printed.largest_um:+.2g}); the drawing moves the lens by "
        f"{low:+.3g} to {high:+.3g} µm and the walls by {compensation.wall_um:+.3g} µm, and scales the part by "
        f"{compensation.scale:.5g}"
    )
    if prediction.compensated_response is not None:
        loss = prediction.compensated_response.real
        yield _loss(f"an emitter {loss.width_mm:g} mm wide, compensated", loss)
