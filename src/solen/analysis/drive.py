"""Quantity that drives a recorded sensor, from the columns of its recording: an angle, a force or a depth.

An option names the column; otherwise the column is recognised by its header. If several quantities are recorded, angle
takes precedence over force and force over depth, and a warning reports the choice. A force is in force units, or in
volts from a load cell whose calibration is specified (`solen.analysis.load_cell`); no unit is assumed for a force or
depth.

Public names: `driven` and `reject_undriven`.
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
_FAR_DEG = 720.0  # an angle beyond two turns is not in degrees
_OF_ANGLES = ("zero_deg", "flip_angle", "step_deg")
_MAX_TARE = 1e-3
"""Standard error of a tare, as a fraction of the range, above which a warning is given."""


@dataclass(frozen=True, eq=False)
class Drive:
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


def driven(recording: Recording, options: "SignalOptions", base: TimeBase, warnings: list[Caution]) -> Drive | None:
    """Return the quantity that drives a recorded sensor, or None if no column contains one.

    Assumptions are added to the warnings. ``base`` contains the sample times.

    Raises
    ------
    DataError, SpecError
        If a column has no unit or an unsuitable unit, or an option is for another quantity.
    """
    volts = force_in_volts(recording)
    if volts is not None and volts.name in {column for _, column in options.named_receivers}:
        volts = None
    found = _chosen(recording, options, volts, warnings)
    if found is None:
        return None
    stimulus, channel = found
    _check_options(stimulus, options)
    columns = tuple(one.name for one in (channel, volts) if one is not None)
    if stimulus is ANGLE:
        if volts is not None:
            unused = "is in volts from a load cell and is not used; to use it, specify --load-cell and --against force"
            warnings.append(prefixed(volts.name, warning(unused)))
        angle = _degrees(recording, channel, options, warnings)[base.order]
        return Drive(ANGLE, angle, columns)
    file = recording.provenance.name
    cell = (load_cell_of(options.load_cell) if options.load_cell else _of_rig(recording)) if stimulus is FORCE else None
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
        if u > _MAX_TARE * float(np.ptp(values[np.isfinite(values)])):
            doubt = f"has a standard uncertainty of {u:.1g} {stimulus.unit}, from {n} readings, which no band includes"
            warnings.append(prefixed("the zero", warning(f"{doubt}; tare for longer")))
    return Drive(stimulus, values, columns, cell)


def reject_undriven(recording: Recording) -> NoReturn:
    """Raise `DataError` for a recording that nothing drives, with a remedy."""
    remedy = (
        "name an angle column with --angle or a stage log with --angle-file, or specify --amplitude-deg; name a force "
        "column with --load or a "
        f"depth column with --depth; {column_list(recording)}"
    )
    limit = "no column is recognised as an angle, force or depth"
    raise DataError(recording.provenance.name, limit=limit, remedy=remedy)


def _chosen(
    recording: Recording, options: "SignalOptions", volts: Channel | None, warnings: list[Caution]
) -> tuple[Stimulus, Channel] | None:
    """The quantity against which the voltages are analysed, and its column."""
    stated = {name: getattr(options, one.column) for name, one in STIMULI.items()}
    named = {name: column for name, column in stated.items() if column is not None}
    wanted = [options.against] if options.against else list(named or STIMULI)
    for name in wanted:
        channel = _column(recording, name, named.get(name), volts)
        if channel is not None:
            others = [other for other in STIMULI if other != name and _there(recording, other, named)]
            if others and options.against is None:
                more = (
                    f"the response is against the {name}, but the {' and the '.join(others)} "
                    f"{'is' if len(others) == 1 else 'are'} also recorded: to analyse that, use --against {others[0]}"
                )
                warnings.append(note(more))
            return STIMULI[name], channel
    if options.against:
        there = [name for name in STIMULI if name != options.against and _there(recording, name, named)]
        has = f"; this recording contains {' and '.join(there)}" if there else ""
        limit = f"no column is recognised as the {options.against}{has}"
        remedy = f"name the column with --{STIMULI[options.against].column}; {column_list(recording)}"
        raise DataError(recording.provenance.name, limit=limit, remedy=remedy)
    return None


def _column(recording: Recording, name: str, named: str | None, volts: Channel | None) -> Channel | None:
    if named is not None:
        return named_column(recording, named, f"--{STIMULI[name].column}")
    return column_of(recording, name) or (volts if name == "force" else None)


def _there(recording: Recording, name: str, named: dict[str, str]) -> bool:
    """Whether a recording also contains another quantity, even in several columns of which none is named."""
    if name in named:
        return True
    try:
        return column_of(recording, name) is not None
    except DataError:
        return True


def _check_options(stimulus: Stimulus, options: "SignalOptions") -> None:
    """Raise `SpecError` for options that apply to another quantity."""
    foreign = ["tare_s"] if stimulus is ANGLE else [*_OF_ANGLES]
    foreign += [] if stimulus is FORCE else ["load_cell"]
    for name in foreign:
        if name in options.model_fields_set and getattr(options, name) not in {None, False}:
            option = f"--{name.replace('_', '-')}"
            remedy = "omit it" if stimulus is ANGLE or name != "zero_deg" else "--tare-s sets the zero"
            value = getattr(options, name)
            raise SpecError(
                option, value=value, limit=f"does not apply to a response against the {stimulus.name}", remedy=remedy
            )


def _by_cell(
    channel: Channel, cell: LoadCell | None, options: "SignalOptions", base: TimeBase, what: str
) -> FloatArray:
    """Forces from load cell voltages."""
    unit = unit_of(channel)
    scale = factor(unit, "V") if unit else None
    if scale is None:
        limit = "is not a unit of this quantity" if unit else "specifies no unit"
        remedy = "specify the unit in the header: force_N, force_gf or depth_mm; load_cell_V for a load cell"
        raise DataError(what, value=unit or None, limit=limit, remedy=remedy)
    if cell is None:
        remedy = "specify the load cell calibration with --load-cell FILE: [load_cell] with N_per_V"
        raise DataError(
            what, value=unit, limit="is a voltage, but the load cell sensitivity is not specified", remedy=remedy
        )
    if cell.zero_V is None and options.tare_s is None:
        remedy = "specify zero_V in [load_cell], or use --tare-s with the seconds without load at the beginning"
        raise DataError(what, limit="has no known voltage without load", remedy=remedy)
    if cell.zero_V is not None and options.tare_s is not None:
        raise SpecError("--tare-s", value=options.tare_s, limit="cannot be combined with zero_V", remedy="omit one")
    volts = scale * channel.values[base.order]
    zero_V = cell.zero_V if cell.zero_V is not None else scale * _tare(channel, options, base)
    return cell.force_N(volts, zero_V)


def _tare(channel: Channel, options: "SignalOptions", base: TimeBase) -> float:
    """Mean of a column over the initial tare interval, or 0 if no tare is requested."""
    if options.tare_s is None:
        return 0.0
    first = channel.values[base.order][base.time_s <= base.time_s[0] + options.tare_s]
    if not np.isfinite(first).any():
        limit = "have no number in the force or depth column"
        raise SpecError("--tare-s", value=options.tare_s, limit=limit, remedy="use more")
    return float(np.nanmean(first))


def _u_tare(values: FloatArray, tare_s: float, base: TimeBase) -> tuple[float, int]:
    """Standard error of the mean that a tare subtracts, in the unit of the values, and the number of readings."""
    first = values[base.time_s <= base.time_s[0] + tare_s]
    first = first[np.isfinite(first)]
    n = len(first)
    return (float(np.std(first, ddof=1)) / math.sqrt(n) if n > 1 else math.inf), n


def _of_rig(recording: Recording) -> LoadCell | None:
    """Load cell of the rig, from the header that a bench wrote in a recording."""
    with suppress(ValueError, KeyError, TypeError, SolenError):
        table: Any = json.loads(recording.provenance.metadata["header"])["rig"]["load_cell"]
        return LoadCell(**table)
    return None


def _degrees(recording: Recording, channel: Channel, options: "SignalOptions", warnings: list[Caution]) -> FloatArray:
    """Angle at each sample, in the order of the file, (n,)."""
    file = recording.provenance.name
    scale = factor(channel.unit, "deg") if channel.unit else 1.0
    if scale is None or channel.unit == "1":
        limit = "is not a unit of angle"
        raise DataError(
            f"{file}: {channel.name}", value=channel.unit, limit=limit, remedy="name another column with --angle"
        )
    if not channel.unit:
        _check_degrees(channel, file, warnings)
    return (-1.0 if options.flip_angle else 1.0) * (_unwound(channel, scale, warnings) - options.zero_deg)


def _check_degrees(channel: Channel, file: str, warnings: list[Caution]) -> None:
    """Raise `DataError` if an angle without a unit cannot be in degrees."""
    farthest = float(np.nanmax(np.abs(channel.values), initial=0.0))
    if farthest > _FAR_DEG:
        limit = f"reaches {farthest:.4g} without a specified unit, which is too large for degrees"
        remedy = "specify the unit in the header: deg, mdeg, rad or mrad; or name another column with --angle"
        raise DataError(f"{file}: {channel.name}", limit=limit, remedy=remedy)
    if not plain(channel.name).endswith("deg"):
        warnings.append(warning(f"the header {channel.name} specifies no unit; degrees are assumed"))


def _unwound(channel: Channel, scale: float, warnings: list[Caution]) -> FloatArray:
    """Angle in degrees, continued across jumps from 360 to 0 or from 180 to −180 and vice versa."""
    angle = np.asarray(channel.values * scale)
    held = np.isfinite(angle)
    steps = np.diff(angle[held])
    if not (np.abs(np.abs(steps) - _TURN_DEG) < 0.5 * (_TURN_DEG - 180.0)).any() or np.ptp(angle[held]) > _TURN_DEG:
        return angle
    unwound = np.unwrap(angle[held], period=_TURN_DEG)
    angle[held] = unwound - _TURN_DEG * np.round(np.median(unwound) / _TURN_DEG)
    warnings.append(prefixed(channel.name, note("jumps by a full rotation; the angle is continued across the jump")))
    return angle
