"""The command that measures a printed lens against its design."""

from collections.abc import Iterator

from solen.cli.app import lines, simulated
from solen.metrology.inspection import FacesInspection, LensInspection
from solen.metrology.print_fit import PrintFit
from solen.pipeline.print.inspect import inspect as inspect


@lines.register
def _(inspection: LensInspection) -> Iterator[str]:
    scale, deviation, edge = inspection.scale, inspection.deviation, inspection.edge
    start, end = inspection.measured_x_mm
    yield f"{simulated(inspection)}{inspection.sources[0].file}, {scale.um_per_px:.6g} µm per pixel ({scale.origin})"
    yield (
        f"{deviation.rms_um:.3g} ± {deviation.u_rms_um:.2g} µm RMS from {inspection.design}, over x = {start:.2f} to "
        f"{end:.2f} mm"
    )
    yield (
        f"largest {deviation.max_um:+.3g} ± {deviation.u_max_um:.2g} µm at x = {deviation.max_x_mm:.2f} mm "
        "(positive: outwards)"
    )
    yield (
        f"{edge.name} edge: {edge.points_used} points, blur {edge.blur_px:.2f} px, rotation "
        f"{inspection.rotation_deg:.2f} ± {inspection.u_rotation_deg:.1g} deg"
    )
    if inspection.points_rejected:
        yield "rejected points: " + ", ".join(
            f"{reason} {count}" for reason, count in inspection.points_rejected.items()
        )
    yield from _size(inspection.size)
    if len(inspection.designs) > 1:
        yield f"nearest of {len(inspection.designs)} designs: {inspection.nearest or 'none of these'}"
        for name, design in inspection.designs.items():
            yield (
                f"  {name}: probability {design.probability:.3g} among these designs; {design.size.form_um:.3g} µm RMS "
                f"after fitting size and overgrowth, {design.rms_um:.3g} before"
            )


@lines.register
def _(faces: FacesInspection) -> Iterator[str]:
    for name, face in (("last layer", faces.last_layer), ("first layer", faces.first_layer)):
        yield f"{name}:"
        yield from (f"  {line}" for line in lines(face))
    difference, u = faces.overgrowth_difference_um, faces.u_overgrowth_difference_um
    yield f"overgrowth of the last layer minus that of the first: {difference:+.3g} ± {u:.2g} µm"


def _size(size: PrintFit) -> Iterator[str]:
    yield (
        f"uniform overgrowth {size.overgrowth_um:+.3g} ± {size.u_overgrowth_um:.2g} µm, form {size.form_um:.2g} µm RMS"
    )
    yield (
        f"size {100.0 * (size.size_factor - 1.0):+.2f} ± {100.0 * size.u_size_factor:.2g} %: "
        f"shrinkage {size.shrinkage_percent:.2f} ± {size.u_shrinkage_percent:.2g} %, scale deviates "
        f"by {100.0 * (size.scale_factor - 1.0):+.2f} ± {100.0 * size.u_scale_factor:.2g} %"
    )
