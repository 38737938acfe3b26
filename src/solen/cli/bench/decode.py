"""The commands `solen bench calibrate`, `solen bench decode` and `solen bench table`."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen.analysis.calibration import CalibrationOptions, DecodeOptions, Decoding, SensorCalibrations
from solen.analysis.calibration.table import DecodingTable
from solen.analysis.network import NetworkCalibrations, NetworkDecoding
from solen.cli.app import SHOWN, lines
from solen.pipeline.bench.recorded import ANALYSED, RECORDED, Analysed, Recorded, split_files
from solen.pipeline.bench.table import table as table
from solen.pipeline.options import FLAT, Force
from solen.ranks import ranked
from solen.recording.stimulus import STIMULI
from solen.report.options import FigureOptions
from solen.results import Outcome

_File = Annotated[Path | None, Parameter(name="--out", help="Write the calibration to this .json.")]
_Table = Annotated[Path | None, Parameter(name="--out", help="Write the angles to this .csv.")]
_Send = Annotated[str | None, Parameter(help="Also send rows to udp://HOST:PORT, serial:PORT@BAUD or lsl:NAME.")]
_Schema = Annotated[bool, Parameter(help="Print the JSON Schema of a calibration.")]


def calibrate(
    *recordings: Path,
    analysis: Analysed = ANALYSED,
    options: Annotated[CalibrationOptions, FLAT] = CalibrationOptions(),
    schema: _Schema = False,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: _File = None,
) -> Outcome[SensorCalibrations | NetworkCalibrations] | None:
    """Calibrate recorded sensors: voltages to angles, with uncertainties and a check.

    (The printer is calibrated by solen print calibrate.)

    Parameters
    ----------
    recordings
        Recordings with known angles, as for solen bench analyse. Each sensor's calibration is written next to them; a
        network is calibrated for all its motions at once.
    """
    if schema:
        import json

        from solen.analysis.calibration.file import json_schema

        print(json.dumps(json_schema(), indent=2))
        return None
    from solen.pipeline.bench import calibrate as pipeline

    recordings, analysis = split_files(recordings, analysis)
    return pipeline.calibrate(*recordings, options=options, analysis=analysis, out=out, figure=figure)


@lines.register
def _(result: SensorCalibrations) -> Iterator[str]:
    for calibration in result.calibrations:
        (low, high), sign = calibration.range_deg, calibration.stimulus_of.sign
        prints = f", {len(calibration.prints)} prints" if len(calibration.prints) > 1 else ""
        yield f"{calibration.sensor}{prints}: {calibration.cycles} cycles, {low:.3g}{sign} to {high:.3g}{sign}"
        yield from (f"  {line}" for line in calibration.words)


@lines.register
def _(result: NetworkCalibrations) -> Iterator[str]:
    network, simulated = result.calibration, "; simulated" if result.simulated else ""
    counts = f"{len(network.emitters)} emitters, {len(network.receivers)} receivers"
    yield f"{network.sensor or 'network'}: {result.states} states, {counts}{simulated}"
    for name, (low, high) in zip(network.motions, network.range_deg, strict=True):
        yield f"  {name}: {low:.3g}° to {high:.3g}°"
    yield from (f"  {line}" for line in network.words)


@lines.register
def _(result: NetworkDecoding) -> Iterator[str]:
    flags = ((getattr(result, name), name) for name in ("outside", "ambiguous", "missing", "clipped"))
    ranges = (f"{name} {low:.4g}° to {high:.4g}°" for name, (low, high) in result.reached_deg.items())
    yield ", ".join([f"{result.readings} readings", *ranges, *(f"{count} {name}" for count, name in flags if count)])
    for check in result.against:
        yield (
            f"{check.motion} relative to the recorded angle at stops: RMS error {check.rms_deg:.2g}°, mean "
            f"{check.bias_deg:+.1g}°, {100 * check.within_68:.0f} and {100 * check.within_95:.0f} % within the 68 and "
            "95 % bands"
        )
    if result.interrupted:
        yield "stopped"


def decode(
    calibration: Path,
    source: Annotated[str, Parameter(allow_leading_hyphen=True)],
    /,
    *,
    signals: Recorded = RECORDED,
    options: Annotated[DecodeOptions, FLAT] = DecodeOptions(),
    out: _Table = None,
    send: _Send = None,
    force: Force = False,
) -> Outcome[Decoding | NetworkDecoding] | None:
    """Convert voltages to angles with a calibration: from a recording, from lines as they arrive, or during a run.

    Parameters
    ----------
    calibration
        File from solen bench calibrate.
    source
        A recording, the .journal of a run, or - for lines of CSV on standard input.
    """
    from solen.pipeline.bench import decode as pipeline

    if SHOWN.as_json:
        return pipeline.decode(calibration, source, options, signals, out=out, send=send, force=force)
    printed: list[str] = []

    def warn(caution: str) -> None:
        printed.append(caution)
        print(*ranked([caution]), file=sys.stderr)

    rows, summary = (sys.stdout, sys.stderr) if out is None else (None, sys.stdout)
    outcome = pipeline.decode(
        calibration, source, options, signals, out=out, rows=rows, warn=warn, send=send, force=force
    )
    for line in ranked(outcome.result.warnings[len(printed) :]):
        print(line, file=sys.stderr)
    if not SHOWN.quiet:
        files = (f"{name}: {path}" for name, path in outcome.files.items())
        print("\n".join([*lines(outcome.result), *files]), file=summary)
    return None


@lines.register
def _(result: DecodingTable) -> Iterator[str]:
    simulated, sign = "; simulated" if result.simulated else "", STIMULI[result.stimulus].sign
    deviation = f"{result.off_deg:.2g}{sign}, i.e. {result.sigma:.2g} standard uncertainties"
    extent = f"{result.low_deg:.3g}{sign} to {result.high_deg:.3g}{sign}"
    yield f"{result.sensor}: {result.pieces} segments, {extent}{simulated}"
    yield f"deviates from the full decoder by up to {deviation}"


@lines.register
def _(result: Decoding) -> Iterator[str]:
    flags = ((getattr(result, name), name) for name in ("outside", "ambiguous", "clipped", "missing"))
    low, high = result.lowest_deg, result.highest_deg
    stimulus = STIMULI[result.stimulus]
    sign = stimulus.sign
    extent = "none on the calibrated curve" if low is None else f"{low:.4g}{sign} to {high:.4g}{sign}"
    yield ", ".join([f"{result.readings} readings", extent, *(f"{count} {name}" for count, name in flags if count)])
    check = result.against_angle
    if check is not None:
        omitted = result.readings - check.readings
        if omitted:
            yield (
                f"{omitted} of {result.readings} readings ({100 * omitted / result.readings:.3g} %) have no recorded "
                f"{stimulus.name} in the calibrated range and are omitted from the next line"
            )
        yield (
            f"relative to the recorded {stimulus.name}: RMS error {check.rms_deg:.2g}{sign}, mean "
            f"{check.bias_deg:+.1g}{sign}, {100 * check.within_95:.0f} % within the 95 % bands"
        )
    if result.interrupted:
        yield "stopped"
