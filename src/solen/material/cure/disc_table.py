"""Discs of a recording: the thickness and dose of each disc, from the columns of a table."""

from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.regression import group_means
from solen.ranks import Caution, note
from solen.recording import Channel, Recording
from solen.units import factor

DISCS, REPLICATES = ("disc", "disk", "sample", "specimen", "id"), ("replicate", "repeat", "wiederholung")
THICKNESSES = ("thickness", "cure depth", "cured depth", "depth", "Dc", "cured thickness")
DOSES = ("dose", "energy", "exposure", "exposure dose", "fluence", "E")
TIMES = ("time", "exposure time", "exposure", "cure time", "t")
DOSE = "mJ/cm2"
_ROUNDED_DOSE = 0.05  # relative tolerance between a dose and time times irradiance


@dataclass(frozen=True, eq=False)
class Discs:
    """Discs of a table: dose in mJ/cm², thickness in µm, first row of each disc, columns used, and warnings."""

    dose: FloatArray
    thickness_um: FloatArray
    rows: list[int]
    columns: list[str]
    warnings: list[Caution]


def discs_of(recording: Recording, irradiance_mW_per_cm2: float | None) -> Discs:
    """Return the discs in a table; rows with the same disc and dose are repeated readings, which are averaged."""
    thickness = recording.need(*THICKNESSES)
    thickness_um = thickness.to("um")
    dose, used = _doses(recording, irradiance_mW_per_cm2)
    used = [thickness.name, *used]
    labels = [cells for name in DISCS if (cells := recording.label(name)) is not None and len(set(cells)) > 1]
    if not labels:
        return Discs(dose, thickness_um, list(range(1, len(dose) + 1)), used, [])
    labels += [cells for name in REPLICATES if (cells := recording.label(name)) is not None]
    used += [name for name, cells in recording.texts.items() if cells in labels]
    names = (" ".join(cells).strip() for cells in zip(*labels, strict=True))
    keys = [(value, name or f"row {row}") for row, (value, name) in enumerate(zip(dose.tolist(), names, strict=True))]
    means = group_means(keys, thickness_um)
    warnings = []
    if len(means) < len(keys):
        warnings = [
            note(
                f"the {len(keys)} rows contain repeated readings of {len(means)} discs: the readings "
                "of each disc are averaged"
            )
        ]
    doses = np.array([value for value, _ in means])
    return Discs(doses, np.array(list(means.values())), [keys.index(key) + 1 for key in means], used, warnings)


def _doses(recording: Recording, irradiance_mW_per_cm2: float | None) -> tuple[FloatArray, list[str]]:
    """Return the doses in mJ/cm², listed or computed from exposure times, and the names of the columns used."""
    dose, time = _with_unit(recording, DOSES, DOSE), _with_unit(recording, TIMES, "s")
    irradiance = _with_unit(recording, ("irradiance", "intensity"), "mW/cm2")
    if dose is not None:
        checked = [] if time is None or irradiance is None else _checked_columns(recording, dose, time, irradiance)
        return dose.to(DOSE), [dose.name, *checked]
    if time is None:
        unknown = recording.find(*DOSES, *TIMES) or recording.need("dose", "energy", "time")
        return unknown.to(DOSE), []  # raises an error with the remedy
    if irradiance is not None:
        return time.to("s") * irradiance.to("mW/cm2"), [time.name, irradiance.name]
    if irradiance_mW_per_cm2 is not None:
        return time.to("s") * irradiance_mW_per_cm2, [time.name]
    limit = f"contains exposure times (column {time.name}), but a working curve requires doses"
    raise DataError(recording.provenance.file, limit=limit, remedy="add --irradiance-mW-per-cm2")


def _checked_columns(recording: Recording, dose: Channel, time: Channel, irradiance: Channel) -> list[str]:
    """Return the names of the time and irradiance columns; raise `DataError` if a dose is not their product."""
    product, listed = time.to("s") * irradiance.to("mW/cm2"), dose.to(DOSE)
    differs = np.abs(product - listed) > _ROUNDED_DOSE * listed
    if differs.any():
        row = int(np.flatnonzero(differs)[0])
        limit = f"is not {time.name} times {irradiance.name}, {product[row]:.4g} mJ/cm²"
        raise DataError(
            f"{recording.provenance.file}: {dose.name} in row {row + 1}", value=f"{listed[row]:.4g}", limit=limit
        )
    return [time.name, irradiance.name]


def _with_unit(recording: Recording, names: tuple[str, ...], unit: str) -> Channel | None:
    """Return the first channel with one of the names that can be converted to a unit."""
    for name in names:
        channel = recording.find(name)
        if channel is not None and channel.unit and factor(channel.unit, unit) is not None:
            return channel
    return None
