"""Description of a diagnosis in words: each parameter with its interval, undetermined parameters, and advice.

Public names: `words` and `advice`.
"""

import math
from collections.abc import Iterator

from solen.analysis.diagnosis.curve_model import LOSS, OFFSET, SPREAD, ZERO
from solen.analysis.diagnosis.diagnose import Diagnosis, ParameterEstimate

NAMES = {
    OFFSET: "the emitter's decentre",
    SPREAD: "the chip's width",
    ZERO: "the zero angle",
    LOSS: "loss in the material",
    "material.index": "the index",
    "gain right": "the right receiver's gain",
    "gain left": "the left receiver's gain",
    "offset right": "the right receiver's offset",
    "offset left": "the left receiver's offset",
}
MAX_U_RATIO = 0.8
"""Ratio of the posterior to the prior uncertainty above which a recording is said to add no information."""
MAX_GAIN_DIFFERENCE = 0.05
"""Largest relative difference of two gains that are considered equal."""
MIN_RANGE_DEG = 2.0
"""Range of angles below which a wider range is advised."""


def words(diagnosis: Diagnosis) -> list[str]:
    """Return the results of a diagnosis, one line for each parameter; ± denotes the half-width of the 95 % interval."""
    return [
        *_decentre(diagnosis),
        *_chip(diagnosis),
        *_zero(diagnosis),
        *_loss(diagnosis),
        *_others(diagnosis),
        *_gains(diagnosis),
    ]


def advice(diagnosis: Diagnosis) -> list[str]:
    """Return advice, one line for each item."""
    return [*_shift(diagnosis), *_trim(diagnosis), *_record(diagnosis)]


def pm(estimate: ParameterEstimate) -> str:
    """Return a value with the half-width of its 95 % interval, both rounded to the precision of the half-width."""
    if estimate.value is None or estimate.low is None or estimate.high is None:
        return "not determined"
    return _pm(estimate.value, 0.5 * (estimate.high - estimate.low), estimate.unit)


def _pm(value: float, half: float, unit: str) -> str:
    digits = 3 if half <= 0.0 or not math.isfinite(half) else max(0, 1 - math.floor(math.log10(half)))
    digits = min(digits, 9)
    return f"{value:.{digits}f} ± {half:.{digits}f}" + (unit if unit == "°" else f" {unit}" if unit else "")


def _decentre(diagnosis: Diagnosis) -> Iterator[str]:
    decentre = diagnosis.estimates["emitter_offset_mm"]
    if decentre.value is None or decentre.low is None or decentre.high is None:
        yield f"the emitter's decentre cannot be determined from this recording{_reason(diagnosis, OFFSET)}"
        return
    side = "right" if decentre.value >= 0.0 else "left"
    half = 0.5 * (decentre.high - decentre.low)
    line = f"emitter {_pm(abs(decentre.value), half, 'mm')} to the {side}"
    yield line + (", possibly centred" if abs(decentre.value) < half else "")


def _chip(diagnosis: Diagnosis) -> Iterator[str]:
    width = diagnosis.estimates["chip_width_mm"]
    if width.value is None or width.high is None or width.low is None:
        yield f"the chip's width cannot be determined from this recording{_reason(diagnosis, SPREAD)}"
    elif width.low <= 0.0 or width.u_value is None:
        yield f"chip at most {width.high:.2g} mm wide; it may be a point"
    else:
        design = width.design_value
        differs = design is not None and not width.low <= design <= width.high
        yield f"chip {pm(width)} wide" + (f" (design value {design:g} {width.unit})" if differs else "")


def _is_uninformed(estimate: ParameterEstimate) -> bool:
    """Return whether the uncertainty of an estimate is hardly smaller than that of its prior."""
    u, u_prior = estimate.u_value, estimate.u_prior
    return u is not None and u_prior is not None and u > MAX_U_RATIO * u_prior


def _zero(diagnosis: Diagnosis) -> Iterator[str]:
    zero = diagnosis.estimates["angle_zero_deg"]
    if _is_uninformed(zero):
        yield f"the recording adds no information about the zero angle, whose prior uncertainty is {zero.u_prior:g}°"
    elif zero.low is not None and zero.high is not None and zero.low <= 0.0 <= zero.high:
        yield f"the zero angle is correct to within {max(-zero.low, zero.high):.2g}°"
    elif zero.value is not None:
        side = "left" if zero.value > 0.0 else "right"
        half = 0.5 * ((zero.high or 0.0) - (zero.low or 0.0))
        yield f"at 0° the sensor leans {_pm(abs(zero.value), half, '°')} to the {side}"


def _loss(diagnosis: Diagnosis) -> Iterator[str]:
    loss = diagnosis.estimates["loss_per_mm"]
    if loss.value is None:
        gains = "the gain" if len(diagnosis.sides) == 1 else "the gains"
        yield (
            f"the loss in the material and {gains} cannot be determined separately from this recording: {gains} "
            f"assume{'s' if len(diagnosis.sides) == 1 else ''} the loss of the design"
        )
    else:
        yield f"loss exceeds the design value by {pm(loss)}"


def _others(diagnosis: Diagnosis) -> Iterator[str]:
    for key in diagnosis.fitted.model.response.changes:
        estimate = diagnosis.estimates[key]
        if _is_uninformed(estimate):
            yield (
                f"the recording adds no information about {key}, which is assumed to be the design value "
                f"± {estimate.u_prior:g}"
            )
        else:
            yield f"{key} differs from the design value by {pm(estimate)}"


def _gains(diagnosis: Diagnosis) -> Iterator[str]:
    for side in diagnosis.sides:
        gain, offset = diagnosis.estimates[f"gain_{side}_V"], diagnosis.estimates[f"offset_{side}_V"]
        yield f"{side} receiver: gain {pm(gain)} for all of the emitted light, offset {pm(offset)}"
    if "gain_ratio" in diagnosis.estimates:
        yield f"ratio of right gain to left gain {pm(diagnosis.estimates['gain_ratio'])}"
    for first, second, correlation in diagnosis.correlated:
        names = f"{NAMES.get(first, first)} and {NAMES.get(second, second)}"
        yield f"{names} are strongly correlated (correlation {correlation:+.3f})"


def _reason(diagnosis: Diagnosis, name: str) -> str:
    others = ", ".join(NAMES.get(other, other) for other in diagnosis.undetermined.get(name, ()))
    return f", because it is strongly correlated with {others}" if others else ": the curves hardly depend on it"


def _shift(diagnosis: Diagnosis) -> Iterator[str]:
    decentre = diagnosis.estimates["emitter_offset_mm"]
    if decentre.value is None or decentre.low is None or decentre.high is None:
        return
    if decentre.low <= 0.0 <= decentre.high:
        limit_um = 1e3 * max(-decentre.low, decentre.high)
        yield f"the emitter need not be moved: it is centred to within {limit_um:.2g} µm"
    else:
        side = "left" if decentre.value > 0.0 else "right"
        shift = _pm(abs(1e3 * decentre.value), 0.5e3 * (decentre.high - decentre.low), "µm")
        yield f"moving the emitter by {shift} to the {side} would centre the response"


def _trim(diagnosis: Diagnosis) -> Iterator[str]:
    estimate = diagnosis.estimates.get("gain_ratio")
    if estimate is None or estimate.value is None or abs(estimate.value - 1.0) < MAX_GAIN_DIFFERENCE:
        return
    side, ratio = ("right", estimate.value) if estimate.value > 1.0 else ("left", 1.0 / estimate.value)
    yield f"dividing the {side} receiver's load resistance by {ratio:.3g} would make both gains equal"


def _record(diagnosis: Diagnosis) -> Iterator[str]:
    if LOSS in diagnosis.undetermined:
        yield "a cut-back measurement (solen resin cutback) would determine the loss, and with it the gains"
    if OFFSET in diagnosis.undetermined or SPREAD in diagnosis.undetermined:
        yield (
            "a recording with the lens, or over a wider range of angles, would determine the decentre and chip width"
        )
    angle = diagnosis.cycles.angle_deg
    reach = float(angle[-1] - angle[0])
    if reach < MIN_RANGE_DEG and not {OFFSET, SPREAD} & set(diagnosis.undetermined):
        yield f"the range of {reach:.2g}° is small: a wider range would narrow every interval"
    if len(diagnosis.cycles.volts) < 3:
        yield "more cycles would narrow the intervals, which are wide with fewer than three"
