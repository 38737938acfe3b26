"""Functions for scripts, which read files and return typed results; only `export` writes files.

Each function does the work of a command. Options are keyword arguments: the fields of the options class named in the
docstring of the function, which the `help` of that class describes.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from solen.analysis import Study
    from solen.analysis.calibration import SensorCalibrations
    from solen.analysis.diagnosis import SensorDiagnoses
    from solen.fabricate import ExportedSolid
    from solen.fabricate.process import PrinterCalibration
    from solen.material.cure import MeasuredCurve
    from solen.material.index.layer import LayerIndex
    from solen.material.loss import GuideLoss
    from solen.metrology import LensInspection
    from solen.results import Outcome
    from solen.spec import Design

FilePath = Path | str


def index_of_layer(file: FilePath, *, sheet: str | None = None, **options: Any) -> "LayerIndex":
    """Compute the refractive index of a printed layer from a file of R and T.

    Options: `solen.material.index.options.IndexOptions`.
    """
    from solen.material.index.layer import index_of_layer as compute
    from solen.material.index.options import IndexOptions
    from solen.recording import read

    return compute(read(file, sheet=sheet), IndexOptions(**options))


def loss_of_guide(file: FilePath, *, sheet: str | None = None, **options: Any) -> "GuideLoss":
    """Compute the loss of a guide in dB/cm from a file of powers at several lengths.

    Options: `solen.material.loss.CutbackOptions`.
    """
    from solen.material.loss import CutbackOptions, guide_loss
    from solen.recording import read

    return guide_loss(read(file, sheet=sheet), CutbackOptions(**options))


def working_curve(file: FilePath, *, sheet: str | None = None, **options: Any) -> "MeasuredCurve":
    """Fit the working curve of a resin to a file of thicknesses of cured discs.

    Options: `solen.material.cure.CureOptions`.
    """
    from solen.material.cure import CureOptions
    from solen.pipeline.resin.cure import cure

    return cure([Path(file)], options=CureOptions(**options), sheet=sheet).result


def measure_lens(
    image: FilePath, design: "Design | FilePath", *, against: "Sequence[Design]" = (), **options: Any
) -> "LensInspection":
    """Measure a printed lens in an image, and compare it with its design.

    Options: `solen.metrology.InspectOptions`.
    """
    from solen.metrology import InspectOptions, read_image
    from solen.metrology import measure_lens as measure
    from solen.spec import Design, load

    inspect_options = InspectOptions(**options)
    pixels = read_image(Path(image), options=inspect_options)
    part = design if isinstance(design, Design) else load(design)
    return measure(
        pixels,
        part,
        edge=inspect_options.edge,
        against=against,
        priors=inspect_options,
        seen_from=inspect_options.seen_from,
    )


def analyse(*recordings: FilePath, **options: Any) -> "Study":
    """Compute the response and figures of merit of each recorded sensor.

    Options: `solen.analysis.AnalysisOptions`.
    """
    from solen.analysis import AnalysisOptions, study

    return study([Path(file) for file in recordings], AnalysisOptions(**options))


def diagnose(study: "Study", **options: Any) -> "SensorDiagnoses":
    """Estimate decentre, chip width, loss and gains of analysed sensors.

    Options: `solen.analysis.diagnosis.DiagnosisOptions`.
    """
    from solen.analysis.diagnosis import DiagnosisOptions, diagnosed_sensors

    return diagnosed_sensors(study, DiagnosisOptions(**options))


def calibrate_sensor(study: "Study", **options: Any) -> "SensorCalibrations":
    """Calibrate analysed sensors.

    Options: `solen.analysis.calibration.CalibrationOptions`.
    """
    from solen.analysis.calibration import CalibrationOptions, calibrated_sensors

    return calibrated_sensors(study, CalibrationOptions(**options))


def calibrate_printer(*measurements: FilePath, process: FilePath | None = None) -> "PrinterCalibration":
    """Fit blur, edge growth and shrinkage of a printer to coupons measured by `solen print fidelity`."""
    from solen.pipeline.print.calibrate import calibrate as run

    return run([Path(file) for file in measurements], process=None if process is None else Path(process)).result


def export(design: "Design | FilePath", folder: FilePath, *formats: str) -> "Outcome[ExportedSolid]":
    """Write the solid and drawings of a design into a folder, in formats such as ``"step"``; default: STL and 3MF."""
    from solen.pipeline.design.export import export as run

    return run(Path(design) if isinstance(design, str) else design, Path(folder), formats)
