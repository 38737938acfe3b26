"""Warnings about faults that a correction of the drawing cannot remove.

Public names: `of_image` and `of_prediction`.
"""

from solen.explore.print_model import PrintModel
from solen.explore.tuning_log import Residual, TuningLog
from solen.fabricate.process import walls_um
from solen.metrology import LensInspection
from solen.ranks import Caution, do_not_use, note, warning

WORTH = 0.95
"""A correction is worthwhile if its predicted deviation is below this fraction of that of the unchanged drawing."""
SURE = 0.95
_TAPER_UM = 1.0


def of_image(inspection: LensInspection, model: PrintModel) -> list[Caution]:
    """Return warnings about faults of the image or the part that no drawing can correct."""
    return [*_defocus(inspection, model), *_side(inspection), *_design(inspection), *_scale(inspection), *_face(model)]


def of_prediction(log: TuningLog, corrected: Residual, unchanged: Residual, *, moved: bool) -> list[Caution]:
    """Return warnings about the next drawing and the previous prediction."""
    last = log.prints[-1]
    kept = f"; {log.name(last.correction.number)} is kept, and no new drawing is made" if last.keeps else ""
    return [*([] if moved else _gain(corrected, unchanged, kept)), *_missed(log)]


def _defocus(inspection: LensInspection, model: PrintModel) -> list[Caution]:
    blur_um, printed_um = inspection.edge.blur_px * inspection.image.um_per_px, model.settings.edge_um
    if blur_um <= printed_um:
        return []
    return [
        warning(
            f"the edge is blurred over {blur_um:.3g} µm, more than the {printed_um:.3g} µm of the "
            "printer: the image is out of focus or the wall is inclined. No drawing can correct "
            "this, and two faces may be measured as one. Focus on the upper rim"
        )
    ]


def _side(inspection: LensInspection) -> list[Caution]:
    if inspection.mirrored is not None:
        return []
    return [
        warning(
            "it is unknown which face the image shows (--seen-from): only the symmetric part is "
            "corrected, since the remainder would be doubled if the image is mirrored"
        )
    ]


def _design(inspection: LensInspection) -> list[Caution]:
    own = min(inspection.designs.values(), key=lambda one: abs(one.rms_um - inspection.deviation.rms_um))
    best = next(iter(inspection.designs.values()))
    if best is own or best.probability < SURE:
        return []
    return [
        do_not_use(
            f"the outline matches {best.name} (probability {best.probability:.2g} among those compared) "
            f"better than {inspection.design}: a correction would turn one lens into another. Check "
            "which file was printed"
        )
    ]


def _scale(inspection: LensInspection) -> list[Caution]:
    if inspection.scale.u_um_per_px is not None:
        return []
    return [
        warning(
            "the uncertainty of the scale is not specified (--u-um-per-px): a wrong scale cannot "
            "be distinguished from shrinkage. Overgrowth and form are corrected, but size is not; "
            "the predicted residual includes an error of 3 % in the scale"
        )
    ]


def _face(model: PrintModel) -> list[Caution]:
    layers = max(1, round(1e3 * model.plain.thickness_mm / model.settings.layer_um))
    _, beyond = walls_um(model.settings, layers)
    middle = float(beyond[layers // 2])
    ends = [float(beyond[place]) - middle for place in (0, -1)]
    if max(map(abs, ends)) < _TAPER_UM:
        return []
    return [
        note(
            f"according to the model, walls are displaced by {ends[0]:+.2g} µm at the first layer "
            f"and {ends[1]:+.2g} µm at the last relative to half the thickness, where the emitter "
            "is; the face in the image is corrected"
        )
    ]


def _gain(corrected: Residual, unchanged: Residual, kept: str) -> list[Caution]:
    if corrected.rms_um < WORTH * unchanged.rms_um:
        return []
    return [
        warning(
            f"a further correction brings no gain: a deviation of {corrected.rms_um:.2g} µm (rms) "
            f"is predicted, and {unchanged.rms_um:.2g} µm for the same drawing printed again. The "
            f"remainder varies from print to print or is not resolved{kept}"
        )
    ]


def _missed(log: TuningLog) -> list[Caution]:
    """Return a warning if a print contradicts its prediction."""
    last = log.prints[-1]
    was = log.predicted_of(last.number)
    if was is None:
        return []
    low, high = was.interval95_rms_um
    if low - 2.0 * last.u_rms_um <= last.rms_um <= high + 2.0 * last.u_rms_um:
        return []
    return [
        warning(
            f"{last.rms_um:.3g} ± {last.u_rms_um:.2g} µm (rms) were measured, but {low:.2g} to "
            f"{high:.2g} µm were predicted: the printer, the resin, the cleaning or the scale of "
            "the image has changed, or --repeat-um is too small"
        )
    ]
