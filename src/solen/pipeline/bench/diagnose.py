"""Recordings diagnosed: from files to what each sensor's emitter, chip and receivers are, by the design's response.

The design is read from the recording of a bench run, which carries it, or from a file. Sensors of one design share one
traced response.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from solen.analysis import Analysed
from solen.analysis.diagnosis import BEYOND_DEG, INDEX_U, ZERO_U_DEG, Bend, Diagnosis, Response, advice, diagnosed
from solen.analysis.diagnosis import words as words_of
from solen.analysis.diagnosis.diagnose import model_V, sides_of
from solen.analysis.diagnosis.model import INDEX, ZERO
from solen.arrays import Progress
from solen.errors import DataError, SpecError
from solen.pipeline.bench import analyse as recordings
from solen.pipeline.bench.analysis_data import as_plain
from solen.pipeline.bench.whatmoved import header_of
from solen.pipeline.outputs import check_choice, check_figure, check_out, leave
from solen.readout import circuit_of, face_areas_mm2
from solen.recording import Recording, read_parts
from solen.sensor import Sensor
from solen.spec import Design, load, loads

BRIGHTER = ("lower", "higher")
MOST_BEYOND_DEG = 0.5
"""A recording that goes farther than its design's motion by more is told."""
FITTED = ("emitter.offset_mm", "emitter.width_mm", "material.absorption_per_mm")
"""Keys that are fitted anyway."""


@dataclass(frozen=True)
class Asked:
    """What is asked.

    Attributes
    ----------
    recordings
        The files and how they are analysed.
    design
        The design's file; None for that which the recording carries.
    sensors
        Sensors to diagnose, by their labels; all where there is none.
    zero_u_deg
        Standard uncertainty of the angle's zero.
    spreads
        Standard uncertainties of numbers of the design, by their keys.
    brighter
        Whether a brighter light is a ``lower`` or a ``higher`` voltage.
    """

    recordings: recordings.Request
    design: Path | None = None
    sensors: tuple[str, ...] = ()
    zero_u_deg: float = ZERO_U_DEG
    spreads: Mapping[str, float] = field(default_factory=lambda: {INDEX: INDEX_U})
    brighter: str = "lower"


@dataclass(frozen=True)
class _Carried:
    """What the recording of a sensor carries of it.

    ``ambient_V`` is what each receiver shows without the emitter, by side.
    """

    design: Design | None = None
    name: str = ""
    simulated: bool = False
    drawn: Mapping[str, float] = field(default_factory=dict)
    ambient_V: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Found:
    """A sensor's diagnosis, and what it was made with."""

    sensor: Analysed
    diagnosis: Diagnosis
    design: Design
    carried: _Carried
    warnings: tuple[str, ...]


def diagnose(
    asked: Asked, *, out: Path | None = None, figure: Path | None = None, progress: Progress | None = None
) -> dict[str, Any]:
    """Diagnosis of each sensor, as plain data.

    Parameters
    ----------
    asked
        The files, the design, and what is known beforehand.
    out, figure
        Where to leave the result and its figure.
    progress
        Told how much of the tracing is done, from 0 to 1.

    Raises
    ------
    DataError, SpecError, DesignError, OutputError
        In one line, where a file, an option or an output is not what it should be.
    """
    _check(asked)
    check_out(out)
    check_figure(figure)
    study = recordings.study(asked.recordings)
    sensors = _chosen(asked, study.sensors)
    found = _diagnosed(asked, sensors, progress)
    simulated = study.simulated or any(one.carried.simulated for one in found)
    result = _result(asked, found, study, simulated)

    def drawn() -> Any:
        from solen.report.bench.diagnose import diagnosis_figure

        return diagnosis_figure([one.diagnosis for one in found], simulated=simulated)

    return leave(result, "diagnosis", out, figure, drawn)


def spreads_of(texts: Sequence[str]) -> dict[str, float]:
    """Standard uncertainties of ``KEY=U`` texts; the index's where nothing is said of it."""
    found = {INDEX: INDEX_U}
    for text in texts:
        key, _, value = text.partition("=")
        try:
            found[key.strip()] = float(value)
        except ValueError:
            remedy = "as in --spread emitter.distance_mm=0.02"
            raise SpecError("--spread", value=text, limit="must be KEY=U", remedy=remedy) from None
    return found


def _check(asked: Asked) -> None:
    if not asked.recordings.files:
        raise SpecError("diagnose", limit="needs a file", remedy="name one or more recordings")
    check_choice("--brighter", asked.brighter, BRIGHTER)
    if not 0.0 < asked.zero_u_deg <= BEYOND_DEG:
        limit = f"must be above 0 and at most {BEYOND_DEG:g}"
        raise SpecError("--zero-u-deg", value=asked.zero_u_deg, limit=limit, remedy="set the zero with --zero-deg")
    for key, u in asked.spreads.items():
        if key in FITTED:
            raise SpecError("--spread", value=key, limit="is fitted anyway", remedy="leave it out")
        if not 0.0 < u < math.inf:
            raise SpecError("--spread", value=f"{key}={u:g}", limit="must be above 0")


def _chosen(asked: Asked, sensors: tuple[Analysed, ...]) -> list[Analysed]:
    labels = [one.label for one in sensors]
    for name in asked.sensors:
        if name not in labels:
            raise SpecError("--sensor", value=name, limit=f"no sensor is called so; there are {', '.join(labels)}")
    return [one for one in sensors if not asked.sensors or one.label in asked.sensors]


def _diagnosed(asked: Asked, sensors: list[Analysed], progress: Progress | None) -> list[Found]:
    """Every sensor, those of one design and lens with one response."""
    carried = _carried(asked)
    stated = None if asked.design is None else load(asked.design)
    designs = [_design(one, stated, _of(one, carried)) for one in sensors]
    low = min(float(one.passes.angle_deg[0]) for one in sensors)
    high = max(float(one.passes.angle_deg[-1]) for one in sensors)
    responses: list[tuple[Design, bool, Response]] = []
    kinds = _kinds(sensors, designs)
    for design, lens in kinds:
        responses.append(
            (design, lens, _response(asked, design, lens, low, high, _part(progress, len(responses), kinds)))
        )
    found = []
    for sensor, design in zip(sensors, designs, strict=True):
        ours = next(one for other, lens, one in responses if other == design and lens == (sensor.lens is not False))
        found.append(_one(asked, sensor, design, _of(sensor, carried), ours))
    return found


def _part(progress: Progress | None, done: int, kinds: list[tuple[Design, bool]]) -> Progress | None:
    return None if progress is None else lambda share: progress((done + share) / len(kinds))


def _kinds(sensors: list[Analysed], designs: list[Design]) -> list[tuple[Design, bool]]:
    """Designs with and without their lens, each once."""
    kinds: list[tuple[Design, bool]] = []
    for sensor, design in zip(sensors, designs, strict=True):
        if (design, sensor.lens is not False) not in kinds:
            kinds.append((design, sensor.lens is not False))
    return kinds


def _response(asked: Asked, design: Design, lens: bool, low: float, high: float, progress: Progress | None) -> Response:
    sensor = Sensor.of(design) if lens else Sensor.of(design).without_lens
    spreads = {key: u for key, u in asked.spreads.items() if lens or not key.startswith("lens.")}
    return Response.of(sensor, low - BEYOND_DEG, high + BEYOND_DEG, spreads, progress)


def _one(asked: Asked, sensor: Analysed, design: Design, carried: _Carried, response: Response) -> Found:
    known = {ZERO: asked.zero_u_deg} | dict(asked.spreads)
    rising = asked.brighter == "higher"
    told = list(_motion_words(sensor, design))
    bend = None if rising else _bend(sensor, design, carried)
    if bend is None:
        told.append("voltages are taken to fall in proportion to the light: the design states no [readout]")
    diagnosis = diagnosed(sensor, response, known, bend, rising=rising)
    told += _cautions(diagnosis)
    return Found(sensor, diagnosis, design, carried, tuple(told))


def _carried(asked: Asked) -> dict[tuple[str, str], _Carried]:
    """What each recording carries of its sensor, by file and by the name of the part."""
    found = {}
    for path in asked.recordings.files:
        for group, recording in read_parts(path, sheet=asked.recordings.sheet, columns=asked.recordings.names):
            found[path.name, group] = _read(recording, group)
    return found


def _read(recording: Recording, group: str) -> _Carried:
    header = header_of(recording.provenance)
    name = recording.provenance.metadata.get("sensor", group)
    wires: dict[str, Any] = next((one for one in header.get("sensors", ()) if one.get("name") == name), {})
    text = header.get("designs", {}).get(wires.get("design"))
    design = None if text is None else loads(text, what=f"{recording.provenance.file}: {wires['design']}")
    drawn = {key: float(value) for key, value in wires.get("drawn", {}).items()}
    ambient = {}
    for side in ("right", "left"):
        channel = recording.find(f"{side}_ambient", f"ambient_{side}")
        if channel is not None and np.isfinite(channel.values).any():
            ambient[side] = float(np.nanmean(channel.values))
    return _Carried(design, wires.get("design", ""), bool(header.get("simulated", False)), drawn, ambient)


def _of(sensor: Analysed, carried: Mapping[tuple[str, str], _Carried]) -> _Carried:
    """What the recordings of a sensor carry of it: of the first one, where they are several."""
    for run in sensor.runs:
        for (file, group), one in carried.items():
            if file == run.signals.source and (not group or f".{sensor.label}".endswith(f".{group}")):
                return one
    return _Carried()


def _design(sensor: Analysed, stated: Design | None, carried: _Carried) -> Design:
    """The design of a sensor; `DataError` without one, or where the file's is another motion's."""
    if stated is None:
        if carried.design is None:
            limit = "carries no design"
            raise DataError(f"recording of {sensor.label}", limit=limit, remedy="name its design file with --design")
        return carried.design
    own = carried.design
    if own is not None:
        for key in ("kind", "pivot", "moves"):
            ours, theirs = getattr(stated.motion, key), getattr(own.motion, key)
            if ours != theirs:
                limit = f"the recording of {sensor.label} was made with {_plain(theirs)}"
                remedy = "state the motion of the recording, or leave --design out"
                raise DataError(f"--design: motion.{key}", value=_plain(ours), limit=limit, remedy=remedy)
    return stated


def _plain(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _bend(sensor: Analysed, design: Design, carried: _Carried) -> Bend | None:
    """Load line of the receivers, where the design states its readout or the recording is a bench run's."""
    if carried.design is None and "readout" not in design.model_fields_set:
        return None
    body = Sensor.of(design)
    circuit = circuit_of(body.design, face_areas_mm2(body.design, body.body()))
    room = [
        max(circuit.supply_V - carried.ambient_V.get(side, circuit.supply_V), 0.0)
        for side in sides_of(sensor.receivers)
    ]
    return Bend.of(circuit, tuple(room))


def _motion_words(sensor: Analysed, design: Design) -> Iterator[str]:
    low, high = float(sensor.passes.angle_deg[0]), float(sensor.passes.angle_deg[-1])
    motion = design.motion
    if low < motion.from_deg - MOST_BEYOND_DEG or high > motion.to_deg + MOST_BEYOND_DEG:
        yield (
            f"the recording goes from {low:.3g}° to {high:.3g}°, the design's motion from {motion.from_deg:g}° to "
            f"{motion.to_deg:g}°: is it the same motion?"
        )


def _cautions(found: Diagnosis) -> Iterator[str]:
    """What the numbers of a diagnosis cannot say."""
    misfit = found.fitted.misfit
    if misfit.significant:
        rms = ", ".join(f"{1e3 * rms:.2g} mV {side}" for side, rms in zip(found.sides, misfit.rms_V, strict=True))
        yield (
            f"the model misses the mean curves by more than the scatter of the cycles ({rms} rms, "
            f"{100.0 * misfit.share:.2g} % of the swing): the intervals are widened by it"
        )
    count = len(found.cycles.volts)
    if count == 1:
        yield "one cycle: its intervals take its noise for white, and drift and hysteresis are not in them"
    for side, share in found.left_out.items():
        if share > 0.0:
            yield f"{side}: {100.0 * share:.2g} % of the angles are clipped or missing in a cycle and are left out"
    if len(found.sides) == 1:
        yield f"only the {found.sides[0]} receiver is told by its name: decentre and chip rest on it alone"


def _result(asked: Asked, found: list[Found], study: recordings.Study, simulated: bool) -> dict[str, Any]:
    several = len(found) > 1
    own = [f"{one.sensor.label}: {line}" if several else line for one in found for line in one.warnings]
    made = {
        "sensors": {one.sensor.label: _sensor(one) for one in found},
        "known_beforehand": {"angle_zero_deg": asked.zero_u_deg, **dict(asked.spreads)},
        "simulated": simulated,
        "sources": [one.as_dict() for one in study.sources],
        "warnings": list(dict.fromkeys([*study.warnings, *own])),
    }
    plain: dict[str, Any] = as_plain(made)
    return plain


def _sensor(one: Found) -> dict[str, Any]:
    found = one.diagnosis
    misfit = found.fitted.misfit
    names = [found.fitted.model.parameters[place].name for place in found.fitted.active]
    model = model_V(found)
    return {
        "lens": one.sensor.lens,
        "design": one.design.name,
        "drawn": dict(one.carried.drawn) or None,
        "words": words_of(found),
        "advice": advice(found),
        "parameters": {name: _estimate(each) for name, each in found.estimates.items()},
        "not_determined": {name: list(others) for name, others in found.held.items()},
        "correlations": {"of": names, "matrix": found.correlations},
        "cycles_used": len(found.cycles.volts),
        "misfit": {
            "rms_V": dict(zip(found.sides, misfit.rms_V.tolist(), strict=True)),
            "share_of_swing": misfit.share,
            "beyond_scatter": misfit.ratio,
            "chance": misfit.chance,
            "significant": misfit.significant,
        },
        "receivers": {
            side: {
                "angle_deg": found.cycles.angle_deg,
                "mean_V": found.cycles.mean_V[:, n],
                "model_V": model[:, n],
                "residual_V": found.fitted.residual_V[:, n],
            }
            for n, side in enumerate(found.sides)
        },
    }


def _estimate(one: Any) -> dict[str, Any]:
    return {
        "value": one.value,
        "u": one.u,
        "interval_95": None if one.low is None else [one.low, one.high],
        "unit": one.unit,
        "determined": one.determined,
        "design": one.design,
        "known_u": one.known_u,
    }


__all__ = ["Asked", "Found", "diagnose", "spreads_of"]
