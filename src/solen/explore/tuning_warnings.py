"""Warnings about errors that a correction of the drawing cannot remove.

Public names: `image_warnings` and `prediction_warnings`.
"""

from solen.explore.print_model import PrintModel
from solen.explore.tuning_log import Residual, TuningLog
from solen.fabricate.process import walls_um
from solen.metrology import LensInspection
from solen.ranks import Caution, do_not_use, note, warning

MIN_GAIN_RATIO = 0.95
"""Ratio of the predicted deviations after and before a correction above which the correction brings no gain."""
MIN_PROBABILITY = 0.95
_MIN_TAPER_UM = 1.0


def image_warnings(inspection: LensInspection, model: PrintModel) -> list[Caution]:
    """Return warnings about errors of the image or the part that no drawing can correct."""
    return [*_defocus(inspection, model), *_side(inspection), *_design(inspection), *_scale(inspection), *_face(model)]


def prediction_warnings(
    log: TuningLog, corrected: Residual, unchanged: Residual, *, walls_moved: bool
) -> list[Caution]:
    """Return warnings about the next drawing and the previous prediction."""
    last = log.prints[-1]
    kept = f"; {log.name(last.correction.number)} is kept, and no new drawing is made" if last.keeps else ""
    return [*([] if walls_moved else _gain(corrected, unchanged, kept)), *_wrong_prediction(log)]


def _defocus(inspection: LensInspection, model: PrintModel) -> list[Caution]:
    blur_um, printed_um = inspection.edge.blur_px * inspection.image.um_per_px, model.settings.edge_um
    if blur_um <= printed_um:
        return []
    return [
        warning(
            f"the edge in the image is blurred by {blur_um:.3g} µm, more than the {printed_um:.3g} µm of the "
            "printer: the image is out of focus or the wall is inclined. No drawing can correct "
            "this, and two faces may be measured as one; focus on the upper rim"
        )
    ]


def _side(inspection: LensInspection) -> list[Caution]:
    if inspection.mirrored is not None:
        return []
    return [
        warning(
            "it is unknown which face the image shows: only the symmetric part is corrected, since a "
            "correction would double the remainder if the image were mirrored; specify --seen-from"
        )
    ]


def _design(inspection: LensInspection) -> list[Caution]:
    tuned = min(inspection.designs.values(), key=lambda match: abs(match.rms_um - inspection.deviation.rms_um))
    best = next(iter(inspection.designs.values()))
    if best is tuned or best.probability < MIN_PROBABILITY:
        return []
    return [
        do_not_use(
            f"the outline matches {best.name} (probability {best.probability:.2g} among those compared) "
            f"better than {inspection.design}: a correction would turn one lens into another; check "
            "which file was printed"
        )
    ]


def _scale(inspection: LensInspection) -> list[Caution]:
    if inspection.scale.u_um_per_px is not None:
        return []
    return [
        warning(
            "the uncertainty of the scale is unknown, so an error of the scale cannot be distinguished "
            "from shrinkage: overgrowth and form are corrected, but size is not, and the predicted "
            "deviation includes a scale error of 3 %; specify --u-um-per-px"
        )
    ]


def _face(model: PrintModel) -> list[Caution]:
    layers = max(1, round(1e3 * model.plain.thickness_mm / model.settings.layer_um))
    _, displacement = walls_um(model.settings, layers)
    middle = float(displacement[layers // 2])
    ends = [float(displacement[layer]) - middle for layer in (0, -1)]
    if max(map(abs, ends)) < _MIN_TAPER_UM:
        return []
    return [
        note(
            f"according to the model, walls at the first and the last layer are displaced by {ends[0]:+.2g} µm "
            f"and {ends[1]:+.2g} µm relative to those at half the thickness, where the emitter is; the "
            "correction applies to the face in the image"
        )
    ]


def _gain(corrected: Residual, unchanged: Residual, kept: str) -> list[Caution]:
    if corrected.rms_um < MIN_GAIN_RATIO * unchanged.rms_um:
        return []
    return [
        warning(
            f"a further correction brings no gain: the predicted deviation is {corrected.rms_um:.2g} µm RMS, "
            f"compared with {unchanged.rms_um:.2g} µm if the same drawing is printed again. The "
            f"remainder varies from print to print or is not resolved{kept}"
        )
    ]


def _wrong_prediction(log: TuningLog) -> list[Caution]:
    """Return a warning if a print contradicts its prediction."""
    last = log.prints[-1]
    predicted = log.predicted_of(last.number)
    if predicted is None:
        return []
    low, high = predicted.interval95_rms_um
    if low - 2.0 * last.u_rms_um <= last.rms_um <= high + 2.0 * last.u_rms_um:
        return []
    return [
        warning(
            f"the measured deviation is {last.rms_um:.3g} ± {last.u_rms_um:.2g} µm RMS, but {low:.2g} to "
            f"{high:.2g} µm were predicted: the printer, the resin, the cleaning or the scale of "
            "the image has changed, or --repeat-um is too small"
        )
    ]
