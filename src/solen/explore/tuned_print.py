"""Options and result of a tuning step: a measured print, the next drawing, and its predicted print."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import Field

from solen.arrays import FloatArray
from solen.explore.tuning_log import Residual, Responses, TuningLog
from solen.fabricate.process import Compensation
from solen.lens.profile import MeasuredProfile
from solen.metrology import InspectOptions
from solen.ranks import Caution
from solen.recording import Provenance
from solen.results import HIDDEN, Result, reported
from solen.spec.strict import Finite


class TuneOptions(InspectOptions):
    """Options for measuring an image, and priors of prints."""

    repeat_um: Annotated[Finite, Field(gt=0, le=100)] = 1.0
    """Expected RMS difference between two prints of one drawing in µm, known within a factor of 2."""
    drawn: Path | None = None
    """Design file of this print; default: the design for the first print, then the last correction in the log."""
    another_copy: bool = False
    """The image shows another print of the previous drawing."""


@dataclass(frozen=True)
class Common:
    """Deviations common to all prints of a design, and the scatter of individual prints.

    Attributes
    ----------
    overgrowth_um, u_overgrowth_um
        Uniform displacement of all walls outwards.
    size_percent, u_size_percent
        Relative error of the size in addition to the overgrowth.
    form_um
        RMS of the common form after registration, without overgrowth and size, as far as images resolve it.
    repeat_um
        Standard deviation of the individual form of a print.
    prints
        Number of prints evaluated.
    """

    overgrowth_um: float
    u_overgrowth_um: float
    size_percent: float
    u_size_percent: float
    form_um: float
    repeat_um: float
    prints: int


@dataclass(frozen=True)
class TunedStep:
    """One print of a tuning: its drawing, its deviation, and its prediction."""

    number: int
    drawing: int
    rms_um: float
    u_rms_um: float
    predicted: Residual | None


class TunedPrint(Result):
    """A measured print, the next drawing, and the prediction of its print.

    Attributes
    ----------
    design, simulated, process
        Name of the design, whether any image was simulated, and name of the process.
    number, drawn_by
        Number of the print, and its drawing.
    rms_um, u_rms_um
        Its deviation, as measured by `solen print inspect`.
    common
        Deviations common to all prints.
    corrected
        Names of the corrected deviations: the form, and overgrowth and size if they exceed their uncertainties. Smaller
        means of overgrowth and size are corrected too; size only if the scale has an uncertainty.
    kept
        Whether the previous drawing is kept, since no correction is predicted to be better.
    wall_um, scale
        Outward displacement of the drawn walls, and scale factor of the drawing.
    unchanged
        Predicted deviation of a further print of the same drawing.
    predicted
        Predicted deviation of the next print, from the corrected or the kept drawing.
    response
        Response as designed, of this print and of the next print; None if not traced.
    history
        All prints of the log.
    x_mm, measured_um, predicted_um, u_predicted_um
        Position along the front (N,), deviation of this print there, NaN if it was not measured, and predicted
        deviation of the next print with its uncertainty.
    compensation, profile, log
        The next drawing, the predicted profile of its print, and the log with this print.
    """

    design: str
    simulated: bool
    process: str
    number: int
    drawn_by: str
    rms_um: float
    u_rms_um: float
    common: Common
    corrected: tuple[str, ...]
    kept: bool
    wall_um: float
    scale: float
    unchanged: Residual
    predicted: Residual
    response: Responses | None
    history: tuple[TunedStep, ...]
    x_mm: FloatArray
    measured_um: FloatArray
    predicted_um: FloatArray
    u_predicted_um: FloatArray
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]
    compensation: Compensation = field(metadata=HIDDEN)
    profile: MeasuredProfile = field(metadata=HIDDEN)
    log: TuningLog = field(metadata=HIDDEN)

    @reported
    def drawn_range_um(self) -> tuple[float, float]:
        """Smallest and largest displacement of the drawn lens from the designed one."""
        return self.compensation.drawn_range_um
