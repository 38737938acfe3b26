"""Signals: the voltages of receivers over time, read from the columns of a recording.

`SignalOptions` names columns and specifies what the file does not; otherwise the headers determine the roles of the
columns (`solen.recording.column_roles`). Units are converted to s, degrees and volts. An assumption causes a warning,
an ambiguity an error.

Public names: `Waveforms` and `Signals`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from solen.analysis.demodulation.clock import On
from solen.analysis.load_cell import LoadCell
from solen.arrays import BoolArray, FloatArray
from solen.ranks import Caution
from solen.recording import Provenance
from solen.recording.stimulus import ANGLE, Name, Stimulus
from solen.results import Result
from solen.spec.strict import Finite, Options, refused, repeated

TIMES, TIMES_OF_LOG = ("--time", "--rate-hz"), ("--angle-time", "--angle-rate-hz")
"""Options that specify the times of a recording, and of a stage log."""

AngleSource = Literal["optional", "elsewhere"]


class SignalOptions(Options):
    """Roles of the columns of a recording."""

    time: str | None = None
    """Time column; default: the column whose header denotes time."""
    angle: str | None = None
    """Angle column; default: the column with an angle header."""
    load: str | None = None
    """Force column, in N, mN, kN, gf, kgf or lbf, or in volts with --load-cell; default: the column with a force
    header.
    """
    depth: str | None = None
    """Depth column; default: the column with a depth header."""
    against: Name | None = None
    """Quantity against which the voltages are analysed; default: the angle if recorded, otherwise the force,
    otherwise the depth.
    """
    load_cell: Path | None = None
    """File with [load_cell], or a rig file: the sensitivity of the force column in N/V, with its uncertainty."""
    tare_s: Finite | None = Field(None, gt=0)
    """Seconds at the beginning of the recording over which the mean force or depth is subtracted as zero."""
    channel: tuple[str, ...] = ()
    """A receiver and its column, NAME=COLUMN, as in --channel left=ai0 right=ai1; S1.left=ai0 also names the sensor.
    Default: every column in volts.
    """
    time_unit: str | None = None
    """Unit of the time column if its header specifies none: s, ms, us, min."""
    rate_hz: Finite | None = Field(None, gt=0)
    """Samples per second, for a recording without times."""
    zero_deg: Finite = 0.0
    """Angle reading at rest, which is subtracted from all angles."""
    flip_angle: bool = False
    """Reverse the sign of the angle."""
    on_off_hz: Finite | None = Field(None, ge=0)
    """Switching frequency of the emitters in a raw waveform, 0 if they do not switch; default: detected. Ambient
    light is then subtracted first, as with solen bench demodulate.
    """
    on: On | None = None
    """Whether light makes this waveform low or high; default: detected from the phase that follows the motion."""
    mains_hz: Finite | None = Field(None, ge=0)
    """Mains frequency of lamps whose flicker is subtracted from this waveform, 50 or 60, or 0 for none; default:
    detected.
    """
    emitters: int = Field(1, ge=1)
    """Number of emitters that are switched in sequence, each followed by an off phase; each is treated as a sensor."""
    rails: tuple[float, float] | None = None
    """Lowest and highest voltage of the recorder, e.g. 0 5: samples at these limits are clipped. Default: detected."""
    smooth_ms: Finite | None = Field(None, gt=0)
    """Width of a moving mean over the voltages; none by default."""
    columns: tuple[str, ...] = ()
    """Column names for tables without a header, e.g. time_s angle_deg left_mV right_mV."""
    sheet: str | None = None
    """Sheet of a workbook."""

    @model_validator(mode="after")
    def _check_columns(self) -> Self:
        for text in self.channel:
            name, equals, column = text.partition("=")
            if not name.strip() or (equals and not column.strip()):
                raise refused("channel", "must be NAME=COLUMN", value=text, remedy="write it as in --channel left=V_L")
        twice = repeated(name for name, _ in self.named_receivers)
        if twice is not None:
            raise refused("channel", "is named twice", value=twice, remedy="use a different name for each receiver")
        if self.rate_hz is not None and self.time is not None:
            raise refused("rate_hz", "cannot be combined with --time", value=self.rate_hz, remedy="omit one")
        if self.emitters > 1 and not self.on_off_hz:
            limit = "requires the switching frequency of each emitter"
            raise refused("emitters", limit, value=self.emitters, remedy="specify --on-off-hz")
        if self.rails is not None and not self.rails[0] < self.rails[1]:
            low, high = self.rails
            raise refused("rails", "must be the lowest and the highest voltage, in this order", value=f"{low} {high}")
        return self

    @property
    def named_receivers(self) -> tuple[tuple[str, str], ...]:
        """Receivers with their columns, as specified by ``channel``; a name alone is also the column name."""
        parts = [text.partition("=") for text in self.channel]
        return tuple((name.strip(), (column if equals else name).strip()) for name, equals, column in parts)


class Switching(Result):
    """Switching of the emitters in a waveform.

    Attributes
    ----------
    on_off_hz
        Switching frequency of one emitter, as specified or, if ``detected``, rounded.
    on
        Whether light makes the waveform ``low`` or ``high``.
    mains_hz, flicker_V
        Mains frequency of the lamps whose flicker was subtracted, and the largest flicker amplitude; None if there is
        none.
    samples
        Number of samples in the waveform.
    clipped_samples
        Number of samples at a limit, keyed by receiver.
    limits_V
        Lowest and highest voltage of each receiver; None if no limit is visible.
    """

    on_off_hz: float
    detected: bool
    on: On
    mains_hz: float | None
    flicker_V: float | None
    samples: int
    clipped_samples: dict[str, int]
    limits_V: dict[str, tuple[float | None, float | None]]


@dataclass(frozen=True, eq=False)
class Waveforms:
    """Voltages of all receivers in a recording, in time order.

    Attributes
    ----------
    time_s, step_s
        Non-decreasing times, (n,), and the median step between them.
    receivers, volts
        Names (m,) and voltages (n, m).
    angle_deg
        Angles (n,); None if there are none.
    clipped
        Whether the recording marks each sample as clipped, (n, m); None without such marks.
    unit
        Unit of the values: V, or another unit specified in the recording, such as pF, lux or counts.
    ambient_subtracted
        Whether ambient light was subtracted, so that 0 V means no light.
    window_s
        Averaging time of each value; 0 for samples.
    switching
        Switching of the emitters; None if they do not switch.
    stimulus
        Quantity in ``angle_deg``: an angle, or a force or depth in its own unit.
    cell
        Load cell that measured the force; None if not specified.
    warnings
        Assumptions and omissions.
    """

    time_s: FloatArray
    step_s: float
    receivers: tuple[str, ...]
    volts: FloatArray
    angle_deg: FloatArray | None = None
    clipped: BoolArray | None = None
    unit: str = "V"
    ambient_subtracted: bool = False
    window_s: float = 0.0
    switching: Switching | None = None
    stimulus: Stimulus = ANGLE
    cell: LoadCell | None = None
    warnings: tuple[Caution, ...] = ()

    def rows(self, kept: BoolArray) -> "Waveforms":
        """Return the selected samples."""
        angle = None if self.angle_deg is None else self.angle_deg[kept]
        clipped = None if self.clipped is None else self.clipped[kept]
        return replace(self, time_s=self.time_s[kept], volts=self.volts[kept], angle_deg=angle, clipped=clipped)


@dataclass(frozen=True, eq=False)
class Signals:
    """A recording of a sensor.

    Attributes
    ----------
    label
        Name of the sensor; recordings with the same name belong to the same sensor.
    receivers
        Names of the receivers, (m,).
    time_s
        Non-decreasing times, (n,).
    angle_deg
        Angles (n,), or values of another ``stimulus`` in its unit.
    volts
        Voltages (n, m), NaN if there is no reading.
    lens
        Whether the sensor has a lens; None if unknown.
    source
        File name.
    clipped
        Whether the recording marks each sample as clipped, (n, m); None without such marks.
    provenance
        Provenance of the recording.
    unit
        Unit of the values: V, or another unit specified in the recording.
    ambient_subtracted
        Whether ambient light was subtracted; clipped samples were then marked before the subtraction.
    timing_bound_s
        Largest time difference between angles and readings, and the source of this bound; None if it can only be
        derived from the angle itself.
    ambient_V
        Mean ambient light that was subtracted, keyed by side; empty if not recorded.
    stimulus, cell
        Quantity in ``angle_deg``, and the load cell that measured the force; None if not specified.
    """

    label: str
    receivers: tuple[str, ...]
    time_s: FloatArray
    angle_deg: FloatArray
    volts: FloatArray
    lens: bool | None = None
    source: str = ""
    clipped: BoolArray | None = None
    provenance: Provenance = field(default_factory=Provenance)
    unit: str = "V"
    ambient_subtracted: bool = False
    timing_bound_s: tuple[float, Literal["recording", "log"]] | None = None
    ambient_V: Mapping[str, float] = field(default_factory=dict)
    stimulus: Stimulus = ANGLE
    cell: LoadCell | None = None
