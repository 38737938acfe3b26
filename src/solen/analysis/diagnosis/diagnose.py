"""Diagnosis of a sensor: a fit of its design's traced response to the mean curves of its recording.

All parameters that the recording determines are fitted. A parameter whose uncertainty exceeds its scale is fixed at the
design value; the correlations in the fit of all parameters show which others it cannot be separated from.

Public names: `cycles_of`, `diagnosed` and `Diagnosis`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from solen.analysis.diagnosis.curve_model import INDEX, LOSS, OFFSET, SPREAD, ZERO, Bend, Model
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
"""Usual standard uncertainties of the zero angle and of the refractive index of a print."""
BEYOND_DEG = 0.5
"""Range beyond the recorded angles in which the response is traced, to allow for a different zero of the angle."""
PARTNER = 0.9
"""Correlation above which an undetermined parameter cannot be separated from another parameter."""
HELD_FIRST = (LOSS, SPREAD, OFFSET)
POOREST = 0.98
"""Correlation with a gain above which a loss is not determined, because it would absorb any misfit of the model."""
POOR = 0.95
"""Correlation above which two parameters are poorly separated."""


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
        Estimate of every parameter, by name.
    held
        Parameters that the recording does not determine, each with the parameters correlated with it.
    poor
        Pairs of parameters that are poorly separated, with their correlation.
    correlations
        Correlations of the fitted parameters, (a, a), in the order of ``fitted.active``.
    left_out
        Fraction of the angles that are omitted, by receiver.
    """

    label: str
    cycles: Cycles
    fitted: Fitted
    estimates: dict[str, ParameterEstimate]
    held: dict[str, tuple[str, ...]]
    poor: tuple[tuple[str, str, float], ...]
    correlations: FloatArray
    left_out: dict[str, float]

    @property
    def sides(self) -> tuple[str, ...]:
        """Receivers that were fitted."""
        return self.fitted.model.sides


def sides_of(receivers: Iterable[str]) -> dict[str, int]:
    """Return the indices of the right and left receivers, one of which may be missing; raise `DataError` if both are missing."""
    sides: dict[str, int] = {}
    receivers = list(receivers)
    for place, name in enumerate(receivers):
        side = side_of(name)
        if side and side in sides:
            limit = f"{receivers[sides[side]]} and {name} are both recognised as the {side} receiver"
            raise DataError(
                "receivers", limit=limit, remedy="name one receiver on each side with --channel left=… right=…"
            )
        if side:
            sides[side] = place
    if not sides:
        limit = f"the receiver names {', '.join(receivers)} do not distinguish right from left"
        raise DataError("receivers", limit=limit, remedy="name them with --channel left=… right=…")
    return {side: sides[side] for side in SIDES if side in sides}


def cycles_of(passes: Passes, places: Sequence[int]) -> Cycles:
    """Return the curves of each cycle for the specified receivers: the mean of both directions, or the only direction."""
    hidden = np.where(passes.clipped, np.nan, passes.volts)[..., list(places)]
    there = np.isfinite(hidden).any(axis=(0, 2, 3), keepdims=True)
    both = np.where(there, 1.0, 0.0)
    ways = both.sum(axis=1)
    return Cycles(passes.angle_deg, np.where(both > 0.0, hidden, 0.0).sum(axis=1) / np.maximum(ways, 1.0))


def diagnosed(
    sensor: SensorResponse,
    response: Response,
    known: Mapping[str, float] | None = None,
    bend: Bend | None = None,
    *,
    rising: bool = False,
) -> Diagnosis:
    """Fit a sensor's mean curves and determine which parameters they identify.

    Parameters
    ----------
    sensor
        Response of a sensor whose receivers are named left and right.
    response
        Response of its design, over its angles and `BEYOND_DEG` more on both sides.
    known
        Standard uncertainties of priors: ``angle.zero_deg``, and the keys of the response's changes.
    bend
        Load line of the receivers in the order right, left, if their circuit is known.
    rising
        Whether more light gives a higher voltage.

    Raises
    ------
    DataError
        If too few angles remain, or a receiver does not respond like the design.
    """
    places = sides_of(sensor.receivers)
    cycles = cycles_of(sensor.passes, list(places.values()))
    if rising:
        cycles = Cycles(cycles.angle_deg, -cycles.volts)
    _check(sensor, cycles, places)
    spreads = {ZERO: ZERO_U_DEG, INDEX: INDEX_U} | dict(known or {})
    spacing = spacing_deg(sensor)
    model = Model.of(response, cycles.angle_deg, tuple(places), cycles.swing_V, spreads, bend, spacing)
    fitted, held = _determined(model, cycles)
    _check_signs(sensor, fitted, places)
    correlations = _correlations(fitted)
    left_out = {side: float(1.0 - cycles.valid[:, n].mean()) for n, side in enumerate(places)}
    estimates = _estimates(fitted, held)
    return Diagnosis(sensor.label, cycles, fitted, estimates, held, _poor(fitted, correlations), correlations, left_out)


def spacing_deg(sensor: SensorResponse) -> float:
    """Return the typical angle between samples of the coarsest recording."""
    found = []
    for run in sensor.runs:
        angle = run.signals.angle_deg
        parts = [np.abs(np.diff(angle[ramp.start : ramp.stop])) for ramp in run.motion.ramps]
        found.append(float(np.median(np.concatenate(parts))) if parts else 0.0)
    return max(found, default=0.0)


def _check(sensor: SensorResponse, cycles: Cycles, places: Mapping[str, int]) -> None:
    for n, side in enumerate(places):
        valid = int(cycles.valid[:, n].sum())
        if valid < MIN_ANGLES:
            limit = (
                f"has {valid} angles that every cycle reaches unclipped, but a diagnosis requires at least {MIN_ANGLES}"
            )
            remedy = "record a wider range or lower voltages, or use a smaller --step-deg"
            raise DataError(f"{sensor.label}: {side} receiver", limit=limit, remedy=remedy)


def _check_signs(sensor: SensorResponse, fitted: Fitted, places: Mapping[str, int]) -> None:
    """Raise `DataError` for a negative gain, because the sensor was then mounted or named the other way round."""
    for side in places:
        value, half = fitted.value(f"gain {side}"), fitted.half_width(f"gain {side}")
        if value + half < 0.0:
            limit = (
                "responds in the opposite direction to the design: its voltage rises where "
                "the design predicts more light"
            )
            remedy = "reverse the angle with --flip-angle, or specify --brighter higher"
            raise DataError(f"{sensor.label}: {side} receiver", limit=limit, remedy=remedy)


def _determined(model: Model, cycles: Cycles) -> tuple[Fitted, dict[str, tuple[str, ...]]]:
    """Fit the parameters that the curves determine, and return the fit and the names of the undetermined parameters."""
    active = list(range(len(model.parameters)))
    held: dict[str, tuple[str, ...]] = {}
    fitted = fit(model, cycles, active)
    while (name := _undetermined(fitted)) is not None:
        held[name] = _partners(fitted, name)
        active.remove(model.places[name])
        fitted = fit(model, cycles, active)
    return fitted, held


def _undetermined(fitted: Fitted) -> str | None:
    """Return the next parameter to fix because its uncertainty is too large to be useful, or None if there is none."""
    model = fitted.model
    free = [model.parameters[place] for place in fitted.active if math.isinf(model.parameters[place].known)]
    vague = [one.name for one in free if not fitted.u(one.name) <= one.scale]
    fitted_names = {one.name for one in free}
    if LOSS in fitted_names and any(name.startswith("gain") for name in _partners(fitted, LOSS, POOREST)):
        return LOSS
    for name in HELD_FIRST if vague else ():
        if name in fitted_names and (name in vague or any(v.startswith(("gain", "offset")) for v in vague)):
            return name
    return None


def _partners(fitted: Fitted, name: str, beyond: float = PARTNER) -> tuple[str, ...]:
    """Return the parameters correlated with the specified parameter, in the fit of all parameters."""
    names = [fitted.model.parameters[place].name for place in fitted.active]
    row = _correlations(fitted)[names.index(name)]
    return tuple(
        other for other, with_it in zip(names, row.tolist(), strict=True) if other != name and abs(with_it) > beyond
    )


def _correlations(fitted: Fitted) -> FloatArray:
    sd = np.sqrt(np.diag(fitted.covariance))
    return np.asarray(fitted.covariance / np.maximum(np.outer(sd, sd), 1e-300))


def _poor(fitted: Fitted, correlations: FloatArray) -> tuple[tuple[str, str, float], ...]:
    """Return the pairs of shape parameters that are poorly separated."""
    names = [fitted.model.parameters[place].name for place in fitted.active]
    found = []
    for i, name in enumerate(names):
        for j in range(i + 1, len(names)):
            gains = name.startswith("gain") and names[j].startswith("gain")  # their ratio is reported
            if abs(correlations[i, j]) > POOR and not gains and not names[j].startswith("offset"):
                found.append((name, names[j], float(correlations[i, j])))
    return tuple(found)


def _estimates(fitted: Fitted, held: Mapping[str, object]) -> dict[str, ParameterEstimate]:
    model = fitted.model
    parameter_estimates = {
        "emitter_offset_mm": _plain(fitted, OFFSET, "mm", held, model.response.offset_mm),
        "chip_width_mm": _width(fitted, held),
        "angle_zero_deg": _plain(fitted, ZERO, "deg", held),
        "loss_per_mm": _plain(fitted, LOSS, "1/mm", held),
    }
    for key in model.response.changes:
        parameter_estimates[key] = _plain(fitted, key, key.rpartition("_")[2] if "_" in key else "", held)
    for side in model.sides:
        parameter_estimates[f"gain_{side}_V"] = _plain(fitted, f"gain {side}", "V", held)
        parameter_estimates[f"offset_{side}_V"] = _plain(fitted, f"offset {side}", "V", held)
    if len(model.sides) == 2:
        parameter_estimates["gain_ratio"] = _ratio(fitted)
    return parameter_estimates


def _plain(
    fitted: Fitted, name: str, unit: str, held: Mapping[str, object], design: float | None = None
) -> ParameterEstimate:
    known = fitted.model.parameters[fitted.model.places[name]].known
    u_prior = None if math.isinf(known) else known
    if name in held:
        return ParameterEstimate(name, unit, design_value=design, u_prior=u_prior)
    value, half = fitted.value(name), fitted.half_width(name)
    narrow = fitted.half_width(name, 0.6827)
    return ParameterEstimate(name, unit, value, fitted.u(name), value - half, value + half, design, u_prior, narrow)


def _width(fitted: Fitted, held: Mapping[str, object]) -> ParameterEstimate:
    """Return the chip width from its square, whose interval is symmetric; the interval is truncated at 0."""
    design = fitted.model.response.width_mm
    if SPREAD in held:
        return ParameterEstimate("chip width", "mm", design_value=design)
    value, half, u = fitted.value(SPREAD), fitted.half_width(SPREAD), fitted.u(SPREAD)
    width = math.sqrt(max(value, 0.0))
    low, high = (math.sqrt(max(value + sign * half, 0.0)) for sign in (-1.0, 1.0))
    own_u = u / (2.0 * width) if value > 2.0 * u else None
    narrow = None if own_u is None else fitted.half_width(SPREAD, 0.6827) / (2.0 * width)
    return ParameterEstimate("chip width", "mm", width, own_u, low, high, design, None, narrow)


def _ratio(fitted: Fitted) -> ParameterEstimate:
    """Return the ratio of the right receiver's gain to the left receiver's."""
    places = [int(np.flatnonzero(fitted.active == fitted.model.places[f"gain {side}"])[0]) for side in SIDES]
    right, left = (fitted.value(f"gain {side}") for side in SIDES)
    block = fitted.covariance[np.ix_(places, places)]
    slope = np.array([1.0 / left, -right / left**2])
    u = float(np.sqrt(max(slope @ block @ slope, 0.0)))
    share = fitted.half_width("gain right") / fitted.u("gain right")
    ratio = right / left
    return ParameterEstimate("gain ratio", "", ratio, u, ratio - share * u, ratio + share * u, None, None, u)


def model_V(diagnosis: Diagnosis) -> FloatArray:
    """Return the fitted curves (n, r)."""
    return diagnosis.fitted.model.volts(diagnosis.fitted.values)
