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
UNINFORMATIVE = 0.8
"""Ratio of the posterior to the prior uncertainty above which a recording adds no information."""
ALIKE = 0.05
"""Relative difference below which two gains count as equal."""
NARROW_DEG = 2.0
"""Range of angles below which a wider range is advised."""


def words(diagnosis: Diagnosis) -> list[str]:
    """Return the results of a diagnosis, one line for each parameter; ± denotes half of the 95 % interval."""
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
    """Return a number with half of its 95 % interval, both rounded to the precision of the half interval."""
    if estimate.value is None or estimate.low is None or estimate.high is None:
        return "not determined"
    return _pm(estimate.value, 0.5 * (estimate.high - estimate.low), estimate.unit)


def _pm(value: float, half: float, unit: str) -> str:
    digits = 3 if half <= 0.0 or not math.isfinite(half) else max(0, 1 - math.floor(math.log10(half)))
    digits = min(digits, 9)
    return f"{value:.{digits}f} ± {half:.{digits}f}" + (unit if unit == "°" else f" {unit}" if unit else "")


def _decentre(diagnosis: Diagnosis) -> Iterator[str]:
    one = diagnosis.estimates["emitter_offset_mm"]
    if one.value is None or one.low is None or one.high is None:
        yield f"the emitter's decentre cannot be determined from this recording{_because(diagnosis, OFFSET)}"
        return
    side = "right" if one.value >= 0.0 else "left"
    half = 0.5 * (one.high - one.low)
    line = f"emitter {_pm(abs(one.value), half, 'mm')} to the {side}"
    yield line + (", possibly centred" if abs(one.value) < half else "")


def _chip(diagnosis: Diagnosis) -> Iterator[str]:
    one = diagnosis.estimates["chip_width_mm"]
    if one.value is None or one.high is None or one.low is None:
        yield f"the chip's width cannot be determined from this recording{_because(diagnosis, SPREAD)}"
    elif one.low <= 0.0 or one.u_value is None:
        yield f"chip at most {one.high:.2g} mm wide; it may be a point"
    else:
        yield f"chip {pm(one)} wide" + _beside_design(one)


def _beside_design(estimate: ParameterEstimate) -> str:
    """Return the comparison of an estimate with the value in the design, if that value is outside the estimate's interval."""
    if (
        estimate.design_value is None
        or estimate.low is None
        or estimate.high is None
        or estimate.low <= estimate.design_value <= estimate.high
    ):
        return ""
    return f" (design value {estimate.design_value:g} {estimate.unit})"


def _zero(diagnosis: Diagnosis) -> Iterator[str]:
    one = diagnosis.estimates["angle_zero_deg"]
    if one.u_value is not None and one.u_prior is not None and one.u_value > UNINFORMATIVE * one.u_prior:
        yield (f"the recording adds no information about the zero angle, whose prior uncertainty is {one.u_prior:g}°")
    elif one.low is not None and one.high is not None and one.low <= 0.0 <= one.high:
        yield f"the zero angle is correct to within {max(-one.low, one.high):.2g}°"
    elif one.value is not None:
        turn = "left" if one.value > 0.0 else "right"
        half = 0.5 * ((one.high or 0.0) - (one.low or 0.0))
        yield f"at 0° the sensor leans {_pm(abs(one.value), half, '°')} to the {turn}"


def _loss(diagnosis: Diagnosis) -> Iterator[str]:
    one = diagnosis.estimates["loss_per_mm"]
    if one.value is None:
        others = "the gain" if len(diagnosis.sides) == 1 else "both gains"
        yield (
            f"this recording cannot separate the loss in the material from {others}: only their product is "
            "determined, and the gains apply to the loss in the design"
        )
    else:
        yield f"loss exceeds the design value by {pm(one)}"


def _others(diagnosis: Diagnosis) -> Iterator[str]:
    for key in diagnosis.fitted.model.response.changes:
        one = diagnosis.estimates[key]
        if one.u_value is not None and one.u_prior is not None and one.u_value > UNINFORMATIVE * one.u_prior:
            yield (
                f"the recording adds no information about {key}, which is assumed to be the "
                f"design value ± {one.u_prior:g}"
            )
        else:
            yield f"{key} differs from the design value by {pm(one)}"


def _gains(diagnosis: Diagnosis) -> Iterator[str]:
    for side in diagnosis.sides:
        gain, offset = diagnosis.estimates[f"gain_{side}_V"], diagnosis.estimates[f"offset_{side}_V"]
        yield f"{side} receiver: gain {pm(gain)} for all of the emitted light, offset {pm(offset)}"
    if "gain_ratio" in diagnosis.estimates:
        yield f"ratio of right gain to left gain {pm(diagnosis.estimates['gain_ratio'])}"
    for one, other, correlation in diagnosis.poor:
        yield (
            f"{NAMES.get(one, one)} and {NAMES.get(other, other)} are poorly separated (correlation {correlation:+.3f})"
        )


def _because(diagnosis: Diagnosis, name: str) -> str:
    others = ", ".join(NAMES.get(other, other) for other in diagnosis.held.get(name, ()))
    return f", because it is correlated with {others}" if others else ": the curves hardly depend on it"


def _shift(diagnosis: Diagnosis) -> Iterator[str]:
    one = diagnosis.estimates["emitter_offset_mm"]
    if one.value is None or one.low is None or one.high is None:
        return
    if one.low <= 0.0 <= one.high:
        yield f"the emitter needs no shift: it is centred to within {1e3 * max(-one.low, one.high):.2g} µm"
    else:
        side = "left" if one.value > 0.0 else "right"
        half = 0.5e3 * (one.high - one.low)
        yield f"moving the emitter by {_pm(abs(1e3 * one.value), half, 'µm')} to the {side} would centre the response"


def _trim(diagnosis: Diagnosis) -> Iterator[str]:
    one = diagnosis.estimates.get("gain_ratio")
    if one is None or one.value is None or abs(one.value - 1.0) < ALIKE:
        return
    side, ratio = ("right", one.value) if one.value > 1.0 else ("left", 1.0 / one.value)
    yield f"dividing the {side} receiver's load resistance by {ratio:.3g} would make both gains equal"


def _record(diagnosis: Diagnosis) -> Iterator[str]:
    if LOSS in diagnosis.held:
        yield (
            "measurements on guides of several lengths (solen resin cutback) determine the loss, and with it the gains"
        )
    if OFFSET in diagnosis.held or SPREAD in diagnosis.held:
        yield (
            "a recording with the lens, or over a wider range of angles, would determine the decentre and chip width"
        )
    angle = diagnosis.cycles.angle_deg
    reach = float(angle[-1] - angle[0])
    if reach < NARROW_DEG and not {OFFSET, SPREAD} & set(diagnosis.held):
        yield f"the range of {reach:.2g}° is small: a wider range would narrow every interval"
    if len(diagnosis.cycles.volts) < 3:
        yield "more cycles would narrow the intervals, which are wide with fewer than three"
