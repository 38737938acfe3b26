"""Table of cured discs: the thickness and dose of each disc, from the columns of a recording."""

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
class Table:
    """Discs of a table: dose in mJ/cm², thickness in µm, first row of each disc, columns used, and warnings."""

    dose: FloatArray
    thickness_um: FloatArray
    rows: list[int]
    columns: list[str]
    warnings: list[Caution]


def discs(recording: Recording, irradiance_mW_per_cm2: float | None) -> Table:
    """Return the discs in a table. Rows with the same dose and disc are repeated readings and are averaged."""
    thickness = recording.need(*THICKNESSES)
    thickness_um = thickness.to("um")
    dose, used = _doses(recording, irradiance_mW_per_cm2)
    used = [thickness.name, *used]
    columns = [texts for name in DISCS if (texts := recording.label(name)) is not None and len(set(texts)) > 1]
    if not columns:
        return Table(dose, thickness_um, list(range(1, len(dose) + 1)), used, [])
    columns += [texts for name in REPLICATES if (texts := recording.label(name)) is not None]
    used += [name for name, texts in recording.texts.items() if texts in columns]
    names = (" ".join(texts).strip() for texts in zip(*columns, strict=True))
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
    return Table(doses, np.array(list(means.values())), [keys.index(key) + 1 for key in means], used, warnings)


def _doses(recording: Recording, irradiance_mW_per_cm2: float | None) -> tuple[FloatArray, list[str]]:
    """Return the doses in mJ/cm², either listed or computed from times, and the columns that they come from."""
    dose, time = _with_unit(recording, DOSES, DOSE), _with_unit(recording, TIMES, "s")
    rate = _with_unit(recording, ("irradiance", "intensity"), "mW/cm2")
    if dose is not None:
        agree = [] if time is None or rate is None else _agreeing(recording, dose, time, rate)
        return dose.to(DOSE), [dose.name, *agree]
    if time is None:
        unknown = recording.find(*DOSES, *TIMES) or recording.need("dose", "energy", "time")
        return unknown.to(DOSE), []  # raises, with the remedy
    if rate is not None:
        return time.to("s") * rate.to("mW/cm2"), [time.name, rate.name]
    if irradiance_mW_per_cm2 is not None:
        return time.to("s") * irradiance_mW_per_cm2, [time.name]
    limit = "contains exposure times, but a working curve requires doses"
    raise DataError(recording.provenance.file, value=time.name, limit=limit, remedy="add --irradiance-mW-per-cm2")


def _agreeing(recording: Recording, dose: Channel, time: Channel, rate: Channel) -> list[str]:
    """Return the names of the time and irradiance columns; `DataError` if their product is not the listed dose."""
    product, stated = time.to("s") * rate.to("mW/cm2"), dose.to(DOSE)
    off = np.abs(product - stated) > _ROUNDED_DOSE * stated
    if off.any():
        row = int(np.flatnonzero(off)[0])
        limit = f"is not {time.name} times {rate.name}, {product[row]:.4g} mJ/cm²"
        raise DataError(
            f"{recording.provenance.file}: {dose.name} in row {row + 1}", value=f"{stated[row]:.4g}", limit=limit
        )
    return [time.name, rate.name]


def _with_unit(recording: Recording, names: tuple[str, ...], unit: str) -> Channel | None:
    """Return the first channel with one of these names that converts to a unit."""
    for name in names:
        channel = recording.find(name)
        if channel is not None and channel.unit and factor(channel.unit, unit) is not None:
            return channel
    return None
