"""Diagnosis of a sensor: a fit of its design's traced response to the mean curves of its recording.

All parameters that the recording determines are fitted. A parameter whose uncertainty exceeds its scale is fixed at the
design value; the last fit that included it shows with which other parameters it is strongly correlated.

Public names: `cycles_of`, `diagnosed` and `Diagnosis`.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from solen.analysis.diagnosis.curve_model import INDEX, LOSS, OFFSET, SPREAD, ZERO, LoadLines, Model
from solen.analysis.diagnosis.design_response import Response
from solen.analysis.diagnosis.least_squares import Cycles, Fitted, fit
from solen.analysis.response import Passes
from solen.analysis.sensor_response import SensorResponse
from solen.arrays import FloatArray
from solen.errors import DataError
from solen.recording.column_roles import side_of
from solen.results import HIDDEN, Result, reported
from solen.sensor.acceptance import SIDES

MIN_ANGLES = 12
ZERO_U_DEG, INDEX_U = 0.1, 0.003
"""Default standard uncertainties of the zero angle and of the refractive index of a print."""
MARGIN_DEG = 0.5
"""Range outside the recorded angles in which the response is traced, to allow for a different zero of the angle."""
MIN_CORRELATION = 0.9
"""Correlation above which a parameter is given as a reason why another is not determined."""
FIXED_FIRST = (LOSS, SPREAD, OFFSET)
"""Parameters that are fixed if the recording does not determine all parameters, in this order."""
MAX_LOSS_CORRELATION = 0.98
"""Correlation with a gain above which a loss is not determined, because it would absorb any misfit of the model."""
MAX_CORRELATION = 0.95
"""Correlation above which two parameters are reported as strongly correlated."""


class ParameterEstimate(Result, eq=True):
    """A parameter in a diagnosis.

    Attributes
    ----------
    name, unit
        Name of the parameter, and its unit.
    value, u_value
        Value and standard uncertainty; None if the recording does not determine the parameter.
    low, high
        Limits of the 95 % interval; None if there is no interval.
    design_value
        Value in the design; None if the design specifies no value.
    u_prior
        Standard uncertainty of the prior; None without a prior.
    half_width_68
        Half-width of the 68 % interval.
    """

    name: str = field(metadata=HIDDEN)
    unit: str
    value: float | None = None
    u_value: float | None = None
    low: float | None = field(default=None, metadata=HIDDEN)
    high: float | None = field(default=None, metadata=HIDDEN)
    design_value: float | None = None
    u_prior: float | None = None
    half_width_68: float | None = field(default=None, metadata=HIDDEN)

    @reported
    def interval95_value(self) -> tuple[float, float] | None:
        """95 % interval of the value."""
        return None if self.low is None or self.high is None else (self.low, self.high)

    @reported
    def determined(self) -> bool:
        """Whether the recording determines the parameter."""
        return self.value is not None


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Fit of a sensor.

    Attributes
    ----------
    label
        Label of the sensor.
    cycles
        Curves of the sensor's cycles.
    fitted
        The fit.
    estimates
        Estimate of every parameter, keyed by name.
    undetermined
        Parameters that the recording does not determine, each with the parameters correlated with it.
    correlated
        Pairs of strongly correlated parameters, with their correlation.
    correlations
        Correlations of the fitted parameters, (a, a), in the order of ``fitted.active``.
    omitted
        Fraction of the angles that are omitted, keyed by receiver.
    """

    label: str
    cycles: Cycles
    fitted: Fitted
    estimates: dict[str, ParameterEstimate]
    undetermined: dict[str, tuple[str, ...]]
    correlated: tuple[tuple[str, str, float], ...]
    correlations: FloatArray
    omitted: dict[str, float]

    @property
    def sides(self) -> tuple[str, ...]:
        """Receivers that were fitted."""
        return self.fitted.model.sides


def sides_of(receivers: Iterable[str]) -> dict[str, int]:
    """Return the indices of the right and left receivers, of which one may be missing.

    Raise `DataError` if two receivers are on the same side, or no name shows a side.
    """
    sides: dict[str, int] = {}
    receivers = list(receivers)
    for index, name in enumerate(receivers):
        side = side_of(name)
        if side and side in sides:
            limit = f"{receivers[sides[side]]} and {name} are both recognised as the {side} receiver"
            remedy = "name one receiver on each side with --channel left=… right=…"
            raise DataError("receivers", limit=limit, remedy=remedy)
        if side:
            sides[side] = index
    if not sides:
        limit = f"the receiver names {', '.join(receivers)} do not distinguish right from left"
        raise DataError("receivers", limit=limit, remedy="name them with --channel left=… right=…")
    return {side: sides[side] for side in SIDES if side in sides}


def cycles_of(passes: Passes, receivers: Sequence[int]) -> Cycles:
    """Return the curves of each cycle for some receivers: the mean of both directions, or the only direction."""
    volts = np.where(passes.clipped, np.nan, passes.volts)[..., list(receivers)]
    recorded = np.isfinite(volts).any(axis=(0, 2, 3), keepdims=True)
    directions = np.maximum(recorded.sum(axis=1), 1)
    return Cycles(passes.angle_deg, np.where(recorded, volts, 0.0).sum(axis=1) / directions)


def diagnosed(
    sensor: SensorResponse,
    response: Response,
    priors: Mapping[str, float] | None = None,
    load_lines: LoadLines | None = None,
    *,
    rising: bool = False,
) -> Diagnosis:
    """Fit a sensor's mean curves and determine which parameters they identify.

    Parameters
    ----------
    sensor
        Response of a sensor whose receivers are named left and right.
    response
        Response of its design, over its angles and `MARGIN_DEG` more on both sides.
    priors
        Standard uncertainties of the priors: of ``angle.zero_deg``, and of the keys of the response's changes.
    load_lines
        Load lines of the receivers in the order right, left, if their circuit is known.
    rising
        Whether more light gives a higher voltage.

    Raises
    ------
    DataError
        If too few angles remain, or a receiver does not respond like the design.
    """
    receivers = sides_of(sensor.receivers)
    cycles = cycles_of(sensor.passes, list(receivers.values()))
    if rising:
        cycles = Cycles(cycles.angle_deg, -cycles.volts)
    sides = tuple(receivers)
    _check(sensor, cycles, sides)
    spreads = {ZERO: ZERO_U_DEG, INDEX: INDEX_U} | dict(priors or {})
    spacing = spacing_deg(sensor)
    model = Model.of(response, cycles.angle_deg, sides, cycles.swing_V, spreads, load_lines, spacing)
    fitted, undetermined = _determined(model, cycles)
    _check_signs(sensor, fitted)
    correlations = _correlations(fitted)
    return Diagnosis(
        label=sensor.label,
        cycles=cycles,
        fitted=fitted,
        estimates=_estimates(fitted, undetermined),
        undetermined=undetermined,
        correlated=_correlated(fitted, correlations),
        correlations=correlations,
        omitted={side: float(1.0 - cycles.valid[:, n].mean()) for n, side in enumerate(sides)},
    )


def spacing_deg(sensor: SensorResponse) -> float:
    """Return the median angle between successive samples, for the recording in which it is largest."""
    spacings = []
    for run in sensor.runs:
        angle = run.signals.angle_deg
        parts = [np.abs(np.diff(angle[ramp.start : ramp.stop])) for ramp in run.motion.ramps]
        spacings.append(float(np.median(np.concatenate(parts))) if parts else 0.0)
    return max(spacings, default=0.0)


def _check(sensor: SensorResponse, cycles: Cycles, sides: Sequence[str]) -> None:
    for n, side in enumerate(sides):
        valid = int(cycles.valid[:, n].sum())
        if valid < MIN_ANGLES:
            limit = (
                f"has {valid} angles that every cycle reaches unclipped, but a diagnosis requires at least {MIN_ANGLES}"
            )
            remedy = "record a wider range of angles without clipping, or use a smaller --step-deg"
            raise DataError(f"{sensor.label}: {side} receiver", limit=limit, remedy=remedy)


def _check_signs(sensor: SensorResponse, fitted: Fitted) -> None:
    """Raise `DataError` for a negative gain: the angle, or the effect of light on the voltage, is then reversed."""
    for side in fitted.model.sides:
        value, half = fitted.value(f"gain {side}"), fitted.half_width(f"gain {side}")
        if value + half < 0.0:
            limit = (
                "responds in the opposite direction to the design: its voltage rises where "
                "the design predicts more light"
            )
            remedy = "reverse the angle with --flip-angle, or specify --brighter higher"
            raise DataError(f"{sensor.label}: {side} receiver", limit=limit, remedy=remedy)


def _determined(model: Model, cycles: Cycles) -> tuple[Fitted, dict[str, tuple[str, ...]]]:
    """Fit the parameters that the curves determine, and return the fit and the undetermined parameters.

    Each undetermined parameter is returned with the parameters correlated with it.
    """
    active = list(range(len(model.parameters)))
    undetermined: dict[str, tuple[str, ...]] = {}
    fitted = fit(model, cycles, active)
    while (name := _next_undetermined(fitted)) is not None:
        undetermined[name] = _correlated_with(fitted, name)
        active.remove(model.indices[name])
        fitted = fit(model, cycles, active)
    return fitted, undetermined


def _next_undetermined(fitted: Fitted) -> str | None:
    """Return the next parameter to fix because its uncertainty is too large to be useful, or None if there is none."""
    parameters = [fitted.model.parameters[index] for index in fitted.active]
    free = [parameter for parameter in parameters if math.isinf(parameter.u_prior)]
    uncertain = {parameter.name for parameter in free if not fitted.u(parameter.name) <= parameter.scale}
    names = {parameter.name for parameter in free}
    loss_partners = _correlated_with(fitted, LOSS, MAX_LOSS_CORRELATION) if LOSS in names else ()
    if any(name.startswith("gain") for name in loss_partners):
        return LOSS
    uncertain_circuit = any(name.startswith(("gain", "offset")) for name in uncertain)
    return next((name for name in FIXED_FIRST if name in uncertain or (uncertain_circuit and name in names)), None)


def _correlated_with(fitted: Fitted, name: str, minimum: float = MIN_CORRELATION) -> tuple[str, ...]:
    """Return the fitted parameters whose correlation with a parameter exceeds a minimum."""
    names = fitted.names
    row = np.abs(_correlations(fitted)[names.index(name)])
    return tuple(other for other, value in zip(names, row, strict=True) if other != name and value > minimum)


def _correlations(fitted: Fitted) -> FloatArray:
    sd = np.sqrt(np.diag(fitted.covariance))
    return np.asarray(fitted.covariance / np.maximum(np.outer(sd, sd), 1e-300))


def _correlated(fitted: Fitted, correlations: FloatArray) -> tuple[tuple[str, str, float], ...]:
    """Return the pairs of strongly correlated parameters, except for offsets and pairs of gains.

    Two gains are not reported as correlated, because their ratio is reported.
    """
    pairs = []
    for (i, first), (j, second) in combinations(enumerate(fitted.names), 2):
        gains = first.startswith("gain") and second.startswith("gain")
        if abs(correlations[i, j]) > MAX_CORRELATION and not gains and not second.startswith("offset"):
            pairs.append((first, second, float(correlations[i, j])))
    return tuple(pairs)


def _estimates(fitted: Fitted, undetermined: Collection[str]) -> dict[str, ParameterEstimate]:
    model = fitted.model
    estimates = {
        "emitter_offset_mm": _estimate(fitted, OFFSET, "mm", undetermined, model.response.offset_mm),
        "chip_width_mm": _width(fitted, undetermined),
        "angle_zero_deg": _estimate(fitted, ZERO, "deg", undetermined),
        "loss_per_mm": _estimate(fitted, LOSS, "1/mm", undetermined),
    }
    for key in model.response.changes:
        estimates[key] = _estimate(fitted, key, key.rpartition("_")[2] if "_" in key else "", undetermined)
    for side in model.sides:
        estimates[f"gain_{side}_V"] = _estimate(fitted, f"gain {side}", "V", undetermined)
        estimates[f"offset_{side}_V"] = _estimate(fitted, f"offset {side}", "V", undetermined)
    if len(model.sides) == 2:
        estimates["gain_ratio"] = _ratio(fitted)
    return estimates


def _estimate(
    fitted: Fitted, name: str, unit: str, undetermined: Collection[str], design: float | None = None
) -> ParameterEstimate:
    u = fitted.model.parameters[fitted.model.indices[name]].u_prior
    u_prior = None if math.isinf(u) else u
    if name in undetermined:
        return ParameterEstimate(name, unit, design_value=design, u_prior=u_prior)
    value, half = fitted.value(name), fitted.half_width(name)
    narrow = fitted.half_width(name, 0.6827)
    return ParameterEstimate(name, unit, value, fitted.u(name), value - half, value + half, design, u_prior, narrow)


def _width(fitted: Fitted, undetermined: Collection[str]) -> ParameterEstimate:
    """Return the chip width from its square, whose interval is symmetric; the interval is truncated at 0."""
    design = fitted.model.response.width_mm
    if SPREAD in undetermined:
        return ParameterEstimate("chip width", "mm", design_value=design)
    square, half, u_square = fitted.value(SPREAD), fitted.half_width(SPREAD), fitted.u(SPREAD)
    width = math.sqrt(max(square, 0.0))
    low, high = (math.sqrt(max(square + sign * half, 0.0)) for sign in (-1.0, 1.0))
    u = u_square / (2.0 * width) if square > 2.0 * u_square else None
    narrow = None if u is None else fitted.half_width(SPREAD, 0.6827) / (2.0 * width)
    return ParameterEstimate("chip width", "mm", width, u, low, high, design, None, narrow)


def _ratio(fitted: Fitted) -> ParameterEstimate:
    """Return the ratio of the right receiver's gain to the left receiver's."""
    rows = [fitted.names.index(f"gain {side}") for side in SIDES]
    right, left = (fitted.value(f"gain {side}") for side in SIDES)
    slope = np.array([1.0 / left, -right / left**2])
    u = float(np.sqrt(max(slope @ fitted.covariance[np.ix_(rows, rows)] @ slope, 0.0)))
    half = u * fitted.half_width("gain right") / fitted.u("gain right")
    ratio = right / left
    return ParameterEstimate("gain ratio", "", ratio, u, ratio - half, ratio + half, None, None, u)


def model_V(diagnosis: Diagnosis) -> FloatArray:
    """Return the fitted curves (n, r)."""
    return diagnosis.fitted.model.volts(diagnosis.fitted.values)
