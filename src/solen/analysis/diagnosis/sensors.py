"""Diagnosis of a study's sensors: the design of each sensor, its traced response, and the fit.

A recording from a bench contains its designs; for other recordings, an option specifies the design. Sensors of the same
design share its traced response.

Public names: `diagnosed_sensors` and `SensorDiagnoses`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from solen.analysis.calibration.conditions import header_of
from solen.analysis.diagnosis.curve_model import INDEX, ZERO, LoadLines
from solen.analysis.diagnosis.design_response import Response
from solen.analysis.diagnosis.diagnose import (
    INDEX_U,
    MARGIN_DEG,
    ZERO_U_DEG,
    Diagnosis,
    ParameterEstimate,
    diagnosed,
    model_V,
    sides_of,
)
from solen.analysis.diagnosis.least_squares import Misfit
from solen.analysis.diagnosis.summary import advice, words
from solen.analysis.sensor_response import SensorResponse
from solen.analysis.study import Study
from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.progress import Progress, part_of
from solen.ranks import Caution, prefixed, warning
from solen.readout import circuit_of, face_areas_mm2
from solen.recording import Provenance
from solen.results import HIDDEN, Result
from solen.sensor import Sensor
from solen.spec import Design, load, loads
from solen.spec.strict import Finite, Options, refused

MAX_OUTSIDE_DEG = 0.5
"""Angle by which a recording may exceed the motion of its design without a warning."""
MAX_PLANAR_MISFIT = 0.002
"""Misfit, as a fraction of the swing, above which the model in the plane (2-D) is reported as a possible cause."""
FITTED = ("emitter.offset_mm", "emitter.width_mm", "material.absorption_per_mm")
"""Keys that are always fitted."""


class DiagnosisOptions(Options):
    """Selection of the sensors to diagnose, and their priors."""

    design: Path | None = None
    """Design of the sensor; default: the design contained in a recording made with solen bench."""
    sensor: tuple[str, ...] = ()
    """Labels of the sensors to diagnose; default: all."""
    spread: tuple[str, ...] = ()
    """Parameter that varies between prints, with its standard uncertainty, KEY=U, as in --spread
    emitter.distance_mm=0.02; default: material.index=0.003.
    """
    zero_u_deg: Finite = Field(ZERO_U_DEG, gt=0, le=MARGIN_DEG)
    """Standard uncertainty of the angle at which the sensor is straight."""
    brighter: Literal["lower", "higher"] = "lower"
    """Whether more light gives a lower or a higher voltage."""

    @model_validator(mode="after")
    def _check_spread(self) -> Self:
        for text in self.spread:
            key, _, value = (part.strip() for part in text.partition("="))
            if key in FITTED:
                raise refused("spread", "is fitted anyway", value=key, remedy="omit it")
            try:
                positive = 0.0 < float(value) < float("inf")
            except ValueError:
                remedy = "write it as in --spread emitter.distance_mm=0.02"
                raise refused("spread", "must be KEY=U", value=text, remedy=remedy) from None
            if not positive:
                raise refused("spread", "must be greater than 0", value=text)
        return self

    @property
    def spreads(self) -> dict[str, float]:
        """Standard uncertainties keyed by parameter; by default only that of the refractive index."""
        parts = [text.partition("=") for text in self.spread]
        return {INDEX: INDEX_U} | {key.strip(): float(value) for key, _, value in parts}


class FittedCurve(Result):
    """Mean curve of a receiver, the model curve, and their difference, at angles (n,)."""

    angle_deg: FloatArray
    mean_V: FloatArray
    model_V: FloatArray
    residual_V: FloatArray


class SensorDiagnosis(Result):
    """Diagnosis of a sensor.

    Attributes
    ----------
    diagnosis
        The fit and its estimates.
    lens
        Whether the sensor has a lens; None if unknown.
    design
        Name of the design.
    drawn
        True values of the parameters of a simulated sensor; None for a measured sensor.
    words, advice
        Results in words, one line for each parameter, and advice.
    parameters
        Every parameter, keyed by name.
    not_determined
        Parameters that the recording does not determine, each with the parameters correlated with it.
    correlated, correlations
        Names of the fitted parameters, and their correlations (a, a).
    cycles_used
        Number of cycles used for the intervals.
    misfit
        Deviation of the mean curves from the model.
    receivers
        Curves of each receiver.
    warnings
        Warnings.
    """

    diagnosis: Diagnosis = field(metadata=HIDDEN)
    lens: bool | None
    design: str
    drawn: Mapping[str, float] | None
    words: list[str]
    advice: list[str]
    parameters: dict[str, ParameterEstimate]
    not_determined: dict[str, tuple[str, ...]]
    correlated: tuple[str, ...]
    correlations: FloatArray
    cycles_used: int
    misfit: Misfit
    receivers: dict[str, FittedCurve]
    warnings: tuple[Caution, ...] = field(metadata=HIDDEN)


class SensorDiagnoses(Result):
    """Diagnoses of a study's sensors.

    Attributes
    ----------
    sensors
        Diagnosis of each sensor, keyed by label.
    prior
        Standard uncertainties of the priors, keyed by parameter.
    simulated
        Whether any recording is simulated.
    sources
        The recordings.
    warnings
        Warnings.
    """

    sensors: dict[str, SensorDiagnosis]
    prior: dict[str, float]
    simulated: bool
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]


@dataclass(frozen=True)
class _Recorded:
    """Design stored in a sensor's recording, and the random deviations of a simulated sensor."""

    design: Design | None = None
    drawn: Mapping[str, float] = field(default_factory=dict)
    simulated: bool = False


def diagnosed_sensors(
    study: Study, options: DiagnosisOptions | None = None, progress: Progress | None = None
) -> SensorDiagnoses:
    """Diagnose each sensor; sensors with the same design and lens share a traced response.

    Parameters
    ----------
    study
        The analysed recordings.
    options
        Sensors to diagnose, their design, and priors.
    progress
        Called with the completed fraction of the tracing, up to 1.

    Raises
    ------
    DataError, SpecError, DesignError
        If a sensor has no design, a key cannot be traced, or the curves do not respond like the design.
    """
    options = options or DiagnosisOptions()
    sensors = _selected(study, options)
    specified = None if options.design is None else load(options.design)
    recorded = [_recorded(sensor) for sensor in sensors]
    designs = [_design(sensor, specified, entry.design) for sensor, entry in zip(sensors, recorded, strict=True)]
    low = min(float(sensor.passes.angle_deg[0]) for sensor in sensors) - MARGIN_DEG
    high = max(float(sensor.passes.angle_deg[-1]) for sensor in sensors) + MARGIN_DEG
    kinds = [(design, sensor.lens is not False) for sensor, design in zip(sensors, designs, strict=True)]
    distinct = [kind for n, kind in enumerate(kinds) if kind not in kinds[:n]]
    responses = [
        _response(*kind, low, high, options.spreads, part_of(progress, n, len(distinct)))
        for n, kind in enumerate(distinct)
    ]
    diagnoses = {
        sensor.label: _diagnosis(sensor, kind[0], entry, responses[distinct.index(kind)], options)
        for sensor, kind, entry in zip(sensors, kinds, recorded, strict=True)
    }
    warnings = [
        prefixed(label if len(diagnoses) > 1 else "", caution)
        for label, diagnosis in diagnoses.items()
        for caution in diagnosis.warnings
    ]
    return SensorDiagnoses(
        diagnoses,
        {"angle_zero_deg": options.zero_u_deg} | options.spreads,
        study.simulated or any(entry.simulated for entry in recorded),
        study.sources,
        tuple(dict.fromkeys([*study.warnings, *warnings])),
    )


def _selected(study: Study, options: DiagnosisOptions) -> list[SensorResponse]:
    for name in options.sensor:
        if name not in study.sensors:
            remedy = f"choose from {', '.join(study.sensors)}"
            raise SpecError("--sensor", value=name, limit="no sensor has this name", remedy=remedy)
    return [sensor for sensor in study.sensors.values() if not options.sensor or sensor.label in options.sensor]


def _recorded(sensor: SensorResponse) -> _Recorded:
    """Return the design and the deviations stored in the first recording of a sensor."""
    provenance = sensor.runs[0].signals.provenance
    header = header_of(provenance)
    name = provenance.metadata.get("sensor", sensor.label.rpartition(".")[2])
    entries = (entry for entry in header.get("sensors", ()) if entry.get("name") == name)
    entry: dict[str, Any] = next(entries, {})
    text = header.get("designs", {}).get(entry.get("design"))
    design = None if text is None else loads(text, what=f"{provenance.file}: {entry['design']}")
    drawn = {key: float(value) for key, value in entry.get("drawn", {}).items()}
    return _Recorded(design, drawn, bool(header.get("simulated", False)))


def _design(sensor: SensorResponse, specified: Design | None, recorded: Design | None) -> Design:
    """Return the design of a sensor; raise `DataError` without a design, or if the motion differs."""
    if specified is None:
        if recorded is None:
            remedy = "name the design file of the sensor with --design"
            raise DataError(f"recording of {sensor.label}", limit="contains no design", remedy=remedy)
        return recorded
    for key in ("kind", "pivot", "moves") if recorded is not None else ():
        text, recorded_text = (
            _text(getattr(design.motion, key)) for design in (specified, recorded) if design is not None
        )
        if text != recorded_text:
            limit = f"the recording of {sensor.label} was made with {recorded_text}"
            remedy = "use a design with the motion of the recording, or omit --design"
            raise DataError(f"--design: motion.{key}", value=text, limit=limit, remedy=remedy)
    return specified


def _text(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _response(
    design: Design, lens: bool, low: float, high: float, spreads: Mapping[str, float], progress: Progress | None
) -> Response:
    sensor = Sensor.of(design) if lens else Sensor.of(design).without_lens
    traced = {key: u for key, u in spreads.items() if lens or not key.startswith("lens.")}
    return Response.of(sensor, low, high, traced, progress)


def _diagnosis(
    sensor: SensorResponse, design: Design, recorded: _Recorded, response: Response, options: DiagnosisOptions
) -> SensorDiagnosis:
    rising = options.brighter == "higher"
    load_lines = None if rising else _load_lines(sensor, design, recorded)
    warnings = list(_motion_warnings(sensor, design))
    if load_lines is None:
        reason = "with --brighter higher" if rising else "without a [readout] table in the design"
        change = "rise" if rising else "fall"
        warnings.append(warning(f"{reason}, voltages are assumed to {change} in proportion to the light"))
    diagnosis = diagnosed(sensor, response, {ZERO: options.zero_u_deg} | options.spreads, load_lines, rising=rising)
    fitted = diagnosis.fitted
    return SensorDiagnosis(
        diagnosis=diagnosis,
        lens=sensor.lens,
        design=design.name,
        drawn=recorded.drawn or None,
        words=words(diagnosis),
        advice=advice(diagnosis),
        parameters=diagnosis.estimates,
        not_determined=diagnosis.undetermined,
        correlated=tuple(fitted.names),
        correlations=diagnosis.correlations,
        cycles_used=len(diagnosis.cycles.volts),
        misfit=fitted.misfit,
        receivers=_curves(diagnosis),
        warnings=(*warnings, *_cautions(diagnosis, design)),
    )


def _curves(diagnosis: Diagnosis) -> dict[str, FittedCurve]:
    columns = (diagnosis.cycles.mean_V, model_V(diagnosis), diagnosis.fitted.residual_V)
    return {
        side: FittedCurve(diagnosis.cycles.angle_deg, *(column[:, n] for column in columns))
        for n, side in enumerate(diagnosis.sides)
    }


def _load_lines(sensor: SensorResponse, design: Design, recorded: _Recorded) -> LoadLines | None:
    """Return the load lines of the receivers, if the design contains a readout or the recording is from a bench."""
    if recorded.design is None and "readout" not in design.model_fields_set:
        return None
    traced = Sensor.of(design)
    circuit = circuit_of(traced.design, face_areas_mm2(traced.design, traced.body()))
    supply_V, ambient_V = circuit.supply_V, sensor.runs[0].signals.ambient_V
    drops_V = [max(supply_V - ambient_V.get(side, supply_V), 0.0) for side in sides_of(sensor.receivers)]
    return LoadLines.of(circuit, tuple(drops_V))


def _motion_warnings(sensor: SensorResponse, design: Design) -> Iterator[Caution]:
    low, high = float(sensor.passes.angle_deg[0]), float(sensor.passes.angle_deg[-1])
    motion = design.motion
    if low < motion.from_deg - MAX_OUTSIDE_DEG or high > motion.to_deg + MAX_OUTSIDE_DEG:
        yield warning(
            f"the recording covers {low:.3g}° to {high:.3g}°, but the motion of the design covers "
            f"{motion.from_deg:g}° to {motion.to_deg:g}°; check that the motion is the same"
        )


def _cautions(diagnosis: Diagnosis, design: Design) -> Iterator[Caution]:
    """Yield warnings about the limits of a diagnosis."""
    misfit = diagnosis.fitted.misfit
    if misfit.significant:
        rms = ", ".join(f"{1e3 * rms:.2g} mV {side}" for side, rms in zip(diagnosis.sides, misfit.rms_V, strict=True))
        yield warning(
            f"the model deviates from the mean curves by more than the scatter of the cycles (RMS {rms}, "
            f"{100.0 * misfit.share:.2g} % of the swing); the intervals include this misfit"
        )
    if misfit.significant and misfit.share > MAX_PLANAR_MISFIT and design.trace.dimension == "2d":
        yield warning(
            "the model is in the plane (2-D), but the light of the emitter spreads in space: set "
            'trace.dimension = "extruded", with emitter.pattern and emitter.height_mm'
        )
    for key, change in diagnosis.fitted.model.response.changes.items():
        deviation = diagnosis.fitted.value(key)
        if abs(deviation) > change.step:
            yield warning(
                f"the estimate of {key} differs by {deviation:+.2g} from the design, but the response is traced only "
                f"to ±{change.step:.2g} and extrapolated linearly outside, which affects all parameters; diagnose "
                "again with a design that has this value"
            )
    if len(diagnosis.cycles.volts) == 1:
        yield warning("only one cycle: the intervals assume white noise and do not include drift and hysteresis")
    for side, fraction in diagnosis.omitted.items():
        if fraction > 0.0:
            text = f"{100.0 * fraction:.2g} % of the angles are clipped or missing in a cycle and are omitted"
            yield prefixed(side, warning(text))
    if len(diagnosis.sides) == 1:
        yield warning(
            f"only the {diagnosis.sides[0]} receiver is recognised: decentre and chip width follow from it alone"
        )
