"""Quantity that drives a recorded sensor, from the columns of its recording: an angle, a force or a depth.

An option names the column; otherwise the column is recognised by its header. If several quantities are recorded, angle
takes precedence over force and force over depth, and a note reports the choice. A force is in units of force, or in
volts from a load cell whose sensitivity is specified (`solen.analysis.load_cell`); no unit is assumed for a force or
depth.

Public names: `stimulus_column` and `reject_missing_stimulus`.
"""

import json
import math
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from solen.analysis.load_cell import LoadCell, load_cell_of
from solen.analysis.timebase import TimeBase
from solen.arrays import FloatArray
from solen.errors import DataError, SolenError, SpecError
from solen.ranks import Caution, note, prefixed, warning
from solen.recording import Channel, Recording
from solen.recording.column_roles import column_list, column_of, force_in_volts, named_column, unit_of
from solen.recording.headings import plain
from solen.recording.stimulus import ANGLE, FORCE, STIMULI, Stimulus
from solen.units import factor

if TYPE_CHECKING:
    from solen.analysis.signals import SignalOptions

_TURN_DEG = 360.0
_MAX_DEG = 720.0  # a larger angle is assumed not to be in degrees
_ANGLE_OPTIONS = ("zero_deg", "flip_angle", "step_deg")
_MAX_U_TARE = 1e-3
"""Standard uncertainty of a tare, as a fraction of the range, above which a warning is given."""


@dataclass(frozen=True, eq=False)
class StimulusColumn:
    """Quantity that drives a sensor.

    Attributes
    ----------
    stimulus
        An angle, a force or a depth.
    values
        Values of the quantity in time order, (n,).
    columns
        Names of columns that are not receivers.
    cell
        The load cell; None if not specified.
    """

    stimulus: Stimulus
    values: FloatArray
    columns: tuple[str, ...]
    cell: LoadCell | None = None


def stimulus_column(
    recording: Recording, options: "SignalOptions", base: TimeBase, warnings: list[Caution]
) -> StimulusColumn | None:
    """Return the quantity that drives a recorded sensor, or None if no column contains one.

    ``base`` contains the sample times. Assumptions are appended to the warnings.

    Raises
    ------
    DataError, SpecError
        If a column has no unit or an unsuitable unit, or an option is for another quantity.
    """
    volts = force_in_volts(recording)
    if volts is not None and volts.name in {column for _, column in options.named_receivers}:
        volts = None
    selected = _selected(recording, options, volts, warnings)
    if selected is None:
        return None
    stimulus, channel = selected
    _check_options(stimulus, options)
    columns = tuple(column.name for column in (channel, volts) if column is not None)
    if stimulus is ANGLE:
        if volts is not None:
            unused = "is in volts from a load cell and is not used; to use it, specify --load-cell and --against force"
            warnings.append(prefixed(volts.name, warning(unused)))
        angle = _degrees(recording, channel, options, warnings)[base.order]
        return StimulusColumn(ANGLE, angle, columns)
    file = recording.provenance.name
    cell = None
    if stimulus is FORCE:
        cell = load_cell_of(options.load_cell) if options.load_cell else _cell_of_rig(recording)
    scale = factor(channel.unit, stimulus.unit) if channel.unit else None
    if scale is None:
        values = _by_cell(channel, cell if options.load_cell else None, options, base, f"{file}: {channel.name}")
    else:
        if stimulus is FORCE and options.load_cell is not None:
            unused = f"is already in {channel.unit}, so only the uncertainties of --load-cell are used"
            warnings.append(prefixed(channel.name, note(unused)))
        values = scale * (channel.values[base.order] - _tare(channel, options, base))
    if options.tare_s is not None:
        u, n = _u_tare(values, options.tare_s, base)
        if u > _MAX_U_TARE * float(np.ptp(values[np.isfinite(values)])):
            text = f"has a standard uncertainty of {u:.1g} {stimulus.unit}, from {n} readings, which no band includes"
            warnings.append(prefixed("the zero", warning(f"{text}; use a longer --tare-s")))
    return StimulusColumn(stimulus, values, columns, cell)


def reject_missing_stimulus(recording: Recording) -> NoReturn:
    """Raise `DataError` for a recording without an angle, force or depth."""
    remedy = (
        "name an angle column with --angle, a stage log with --angle-file, a force column with --load or a depth "
        f"column with --depth, or specify --amplitude-deg; {column_list(recording)}"
    )
    limit = "no column is recognised as an angle, force or depth"
    raise DataError(recording.provenance.name, limit=limit, remedy=remedy)


def _selected(
    recording: Recording, options: "SignalOptions", volts: Channel | None, warnings: list[Caution]
) -> tuple[Stimulus, Channel] | None:
    """Return the quantity against which the voltages are analysed, and its column, or None if there is none."""
    columns = {name: getattr(options, stimulus.column) for name, stimulus in STIMULI.items()}
    named = {name: column for name, column in columns.items() if column is not None}
    candidates = [options.against] if options.against else list(named or STIMULI)
    for name in candidates:
        channel = _column(recording, name, named.get(name), volts)
        if channel is not None:
            others = [other for other in STIMULI if other != name and _is_recorded(recording, other, named)]
            if others and options.against is None:
                text = (
                    f"the response is against the {name}, but the {' and the '.join(others)} "
                    f"{'is' if len(others) == 1 else 'are'} also recorded: to analyse the response against the "
                    f"{others[0]}, use --against {others[0]}"
                )
                warnings.append(note(text))
            return STIMULI[name], channel
    if options.against:
        others = [name for name in STIMULI if name != options.against and _is_recorded(recording, name, named)]
        contents = f"; this recording contains {' and '.join(others)}" if others else ""
        limit = f"no column is recognised as the {options.against}{contents}"
        remedy = f"name the column with --{STIMULI[options.against].column}; {column_list(recording)}"
        raise DataError(recording.provenance.name, limit=limit, remedy=remedy)
    return None


def _column(recording: Recording, name: str, named: str | None, volts: Channel | None) -> Channel | None:
    if named is not None:
        return named_column(recording, named, f"--{STIMULI[name].column}")
    return column_of(recording, name) or (volts if name == "force" else None)


def _is_recorded(recording: Recording, name: str, named: dict[str, str]) -> bool:
    """Return whether a recording contains a quantity, even if several columns could contain it."""
    if name in named:
        return True
    try:
        return column_of(recording, name) is not None
    except DataError:
        return True


def _check_options(stimulus: Stimulus, options: "SignalOptions") -> None:
    """Raise `SpecError` for options that apply to another quantity."""
    inapplicable = ["tare_s"] if stimulus is ANGLE else [*_ANGLE_OPTIONS]
    inapplicable += [] if stimulus is FORCE else ["load_cell"]
    for name in inapplicable:
        value = getattr(options, name, None)
        if name in options.model_fields_set and value not in {None, False}:
            limit = f"does not apply to a response against the {stimulus.name}"
            remedy = "omit it" if stimulus is ANGLE or name != "zero_deg" else "set the zero with --tare-s"
            raise SpecError(f"--{name.replace('_', '-')}", value=value, limit=limit, remedy=remedy)


def _by_cell(
    channel: Channel, cell: LoadCell | None, options: "SignalOptions", base: TimeBase, what: str
) -> FloatArray:
    """Return the forces from load cell voltages."""
    unit = unit_of(channel)
    scale = factor(unit, "V") if unit else None
    if scale is None:
        limit = "is not a unit of this quantity" if unit else "specifies no unit"
        remedy = "specify the unit in the header, as in force_N, force_gf or depth_mm; or load_cell_V for a load cell"
        raise DataError(what, value=unit or None, limit=limit, remedy=remedy)
    if cell is None:
        limit = "is a voltage, but the sensitivity of the load cell is not specified"
        remedy = "use --load-cell with a file that contains N_per_V in a table [load_cell]"
        raise DataError(what, value=unit, limit=limit, remedy=remedy)
    if cell.zero_V is None and options.tare_s is None:
        remedy = "specify zero_V in [load_cell], or set --tare-s to the seconds without load at the beginning"
        raise DataError(what, limit="has no known voltage without load", remedy=remedy)
    if cell.zero_V is not None and options.tare_s is not None:
        raise SpecError("--tare-s", value=options.tare_s, limit="cannot be combined with zero_V", remedy="omit one")
    volts = scale * channel.values[base.order]
    zero_V = cell.zero_V if cell.zero_V is not None else scale * _tare(channel, options, base)
    return cell.force_N(volts, zero_V)


def _tare(channel: Channel, options: "SignalOptions", base: TimeBase) -> float:
    """Return the mean of a column over the initial tare interval, or 0 if no tare is requested."""
    if options.tare_s is None:
        return 0.0
    unloaded = channel.values[base.order][base.time_s <= base.time_s[0] + options.tare_s]
    if not np.isfinite(unloaded).any():
        limit = "this interval contains no number in the force or depth column"
        raise SpecError("--tare-s", value=options.tare_s, limit=limit, remedy="use a longer interval")
    return float(np.nanmean(unloaded))


def _u_tare(values: FloatArray, tare_s: float, base: TimeBase) -> tuple[float, int]:
    """Return the standard uncertainty of the mean that a tare subtracts, and its number of readings."""
    unloaded = values[base.time_s <= base.time_s[0] + tare_s]
    unloaded = unloaded[np.isfinite(unloaded)]
    n = len(unloaded)
    return (float(np.std(unloaded, ddof=1)) / math.sqrt(n) if n > 1 else math.inf), n


def _cell_of_rig(recording: Recording) -> LoadCell | None:
    """Return the load cell of the rig, from the header of a recording made by a bench; None if there is none."""
    with suppress(ValueError, KeyError, TypeError, SolenError):
        table: Any = json.loads(recording.provenance.metadata["header"])["rig"]["load_cell"]
        return LoadCell(**table)
    return None


def _degrees(recording: Recording, channel: Channel, options: "SignalOptions", warnings: list[Caution]) -> FloatArray:
    """Return the angle at each sample, in the order of the file, (n,)."""
    file = recording.provenance.name
    scale = factor(channel.unit, "deg") if channel.unit else 1.0
    if scale is None or channel.unit == "1":
        limit, remedy = "is not a unit of angle", "name another column with --angle"
        raise DataError(f"{file}: {channel.name}", value=channel.unit, limit=limit, remedy=remedy)
    if not channel.unit:
        _check_degrees(channel, file, warnings)
    return (-1.0 if options.flip_angle else 1.0) * (_unwrapped(channel, scale, warnings) - options.zero_deg)


def _check_degrees(channel: Channel, file: str, warnings: list[Caution]) -> None:
    """Raise `DataError` if an angle without a unit cannot be in degrees."""
    largest = float(np.nanmax(np.abs(channel.values), initial=0.0))
    if largest > _MAX_DEG:
        limit = f"specifies no unit and reaches {largest:.4g}, which is too large for degrees"
        remedy = "specify the unit in the header (deg, mdeg, rad or mrad), or name another column with --angle"
        raise DataError(f"{file}: {channel.name}", limit=limit, remedy=remedy)
    if not plain(channel.name).endswith("deg"):
        warnings.append(warning(f"the header {channel.name} specifies no unit; degrees are assumed"))


def _unwrapped(channel: Channel, scale: float, warnings: list[Caution]) -> FloatArray:
    """Return the angle in degrees, unwrapped across jumps from 360 to 0 or from 180 to −180 and vice versa."""
    angle = np.asarray(channel.values * scale)
    finite = np.isfinite(angle)
    steps = np.diff(angle[finite])
    jumps = np.abs(np.abs(steps) - _TURN_DEG) < 0.5 * (_TURN_DEG - 180.0)
    if not jumps.any() or np.ptp(angle[finite]) > _TURN_DEG:
        return angle
    unwrapped = np.unwrap(angle[finite], period=_TURN_DEG)
    angle[finite] = unwrapped - _TURN_DEG * np.round(np.median(unwrapped) / _TURN_DEG)
    warnings.append(prefixed(channel.name, note("jumps by a full rotation; the angle is continued across the jump")))
    return angle
