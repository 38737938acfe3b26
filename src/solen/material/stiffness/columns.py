"""Stress and strain from the columns of a recording, and the mode and preload of its test.

Stress and strain columns have priority over values computed from force and area, or from displacement and length,
unless the user specifies the length. The mode and the preload are taken from words in the file; what the file does not
contain must be specified by the user.

`read_test` converts a recording to a `StressStrain`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.stiffness.modes import TestMode
from solen.material.stiffness.specimen import Specimen
from solen.material.stiffness.stress_strain import StressStrain, as_test, dominant_sign
from solen.ranks import Caution, warning
from solen.recording import Channel, Recording

FORCE = ("force", "standard force", "load")
DISPLACEMENT = ("displacement", "extension", "travel")
CROSSHEAD = ("crosshead", "position")
STRESS, TRUE_STRESS = ("stress", "engineering stress"), ("true stress",)
STRAIN, STRETCH, TRUE_STRAIN = ("strain", "engineering strain"), ("stretch",), ("true strain",)
_COMPRESSION_WORDS = ("compress", "druckversuch", "stauch", "druckspannung", "druckprüf")
_TENSION_WORDS = (
    "tensile",
    "tension",
    "zugversuch",
    "dehnung",
    "zugspannung",
    "pull-to-failure",
    "elongation",
    "astm d412",
    "astm d638",
    "iso 527",
    "iso 37",
)


@dataclass(frozen=True, eq=False)
class _Column:
    """Stress or strain, its origin, whether it was computed from force or displacement, and warnings."""

    values: FloatArray
    origin: str
    is_computed: bool = False
    warnings: tuple[Caution, ...] = ()


def read_test(
    recording: Recording,
    specimen: Specimen,
    mode: TestMode | None = None,
    compliance_mm_per_N: float = 0.0,
) -> StressStrain:
    """Return the test in a recording.

    Parameters
    ----------
    recording
        Recording of a force or stress and a displacement, strain or stretch.
    specimen
        Dimensions of the specimen, as far as they are known.
    mode
        Mode of the test; None to infer it from the words and signs in the file.
    compliance_mm_per_N
        Compliance of machine and fixture; force times compliance is subtracted from the displacement.

    Raises
    ------
    DataError
        If a column, unit or dimension is missing, a number is missing between others, or there was no deformation.
    """
    stress = _stress(recording, specimen)
    strain = _strain(recording, specimen)
    if (is_corrected := strain.is_computed and compliance_mm_per_N > 0) and specimen.area_mm2 and specimen.length_mm:
        machine_strain = compliance_mm_per_N * specimen.area_mm2 / specimen.length_mm * stress.values
        strain = replace(strain, values=_without_compliance(strain.values, machine_strain))
    test = as_test(
        strain.values,
        stress.values,
        specimen,
        mode or _mode_in_file(recording, specimen),
        name=recording.provenance.file or "test",
        is_inferred=mode is None,
    )
    return replace(
        test,
        made_from=f"stress: {stress.origin}; strain: {strain.origin}",
        area_used=stress.is_computed,
        from_displacement=strain.is_computed,
        compliance_removed=is_corrected,
        preload=_preload(recording.provenance.metadata),
        warnings=(*test.warnings, *strain.warnings),
    )


def _stress(recording: Recording, specimen: Specimen) -> _Column:
    """Return engineering stress in MPa, from a stress column, from force and area, or from true stress."""
    stress = recording.find(*STRESS)
    if stress is not None:
        return _Column(stress.to("MPa"), stress.name)
    force = _only(recording, FORCE)
    if force is not None:
        if specimen.area_mm2 is None:
            name = f"{recording.provenance.name}: area of the specimen"
            remedy = "add --strip-width-mm and --thickness-mm, --area-mm2, --diameter-mm, or --cube-mm"
            raise DataError(name, limit="is not specified", remedy=remedy)
        origin = f"{force.name} / {specimen.area_mm2:.6g} mm²"
        return _Column(force.to("N") / specimen.area_mm2, origin, is_computed=True)
    true = recording.find(*TRUE_STRESS)
    if true is not None:
        return _Column(true.to("MPa") / (1 + _strain(recording, specimen).values), f"{true.name} / stretch")
    raise _no_column(recording, "force or stress")


def _strain(recording: Recording, specimen: Specimen) -> _Column:
    """Return engineering strain.

    A displacement divided by a length that the user specifies has priority over the strain in the file, which has
    priority over a displacement divided by the length in the file.
    """
    stretch, strain, true = (recording.find(*names) for names in (STRETCH, STRAIN, TRUE_STRAIN))
    displacement, is_position = _displacement(recording)
    has_strain = bool(stretch or strain or true)
    if displacement is not None and specimen.length_mm is not None and (specimen.length_by_user or not has_strain):
        mm = displacement.to("mm")
        known = mm[np.isfinite(mm)]
        zero = float(known[0]) if is_position and len(known) else 0.0
        origin = (
            f"{displacement.name}{' relative to the first point' if is_position else ''} / {specimen.length_mm:.6g} mm"
        )
        return _Column((mm - zero) / specimen.length_mm, origin, is_computed=True)
    if strain is not None:
        values = strain.to("1")
        return _Column(values, strain.name, warnings=_length_warnings(recording, specimen, values, strain.name))
    if stretch is not None:
        return _Column(stretch.to("1") - 1, f"{stretch.name} - 1")
    if true is not None:
        return _Column(np.expm1(true.to("1")), f"exp({true.name}) - 1")
    if displacement is not None:
        remedy = "add --length-mm (the gauge length, or the height of a compressed specimen) or --cube-mm"
        raise DataError(f"{recording.provenance.name}: length of the specimen", limit="is not specified", remedy=remedy)
    raise _no_column(recording, "displacement, strain or stretch")


def _no_column(recording: Recording, quantities: str) -> DataError:
    limit = f"has no column of {quantities}; its columns are {', '.join(recording.names[:12])}"
    return DataError(recording.provenance.name, limit=limit, remedy="name the column with --map")


def _without_compliance(strain: FloatArray, machine_strain: FloatArray) -> FloatArray:
    """Return the strain of the specimen alone; the deformation of the machine has the direction of the loading."""
    return strain - dominant_sign(strain) * dominant_sign(machine_strain) * machine_strain


def _displacement(recording: Recording) -> tuple[Channel | None, bool]:
    """Return the displacement, and whether it is a position with an arbitrary zero."""
    displacement = _only(recording, DISPLACEMENT)
    if displacement is not None:
        return displacement, False
    return _only(recording, CROSSHEAD), True


def _only(recording: Recording, names: tuple[str, ...]) -> Channel | None:
    """Return the first channel with these names; raise `DataError` if the columns of several specimens have them."""
    matching = [channel for channel in recording.channels if channel.quantity and channel.quantity == names[0]]
    if len(matching) > 1 and len({channel.name.rsplit(" (", 1)[0] for channel in matching}) == 1:
        columns = ", ".join(channel.name for channel in matching[:6])
        limit = f"must contain one specimen, but has {len(matching)} columns of {names[0]}: {columns}"
        raise DataError(recording.provenance.name, limit=limit, remedy="keep the columns of one specimen")
    return matching[0] if matching else recording.find(*names)


def _length_warnings(recording: Recording, specimen: Specimen, strain: FloatArray, name: str) -> tuple[Caution, ...]:
    """Return a warning if the strain in a file was computed with a length that is not the one in the file."""
    displacement, is_position = _displacement(recording)
    if displacement is None or is_position or specimen.length_mm is None:
        return ()
    mm = displacement.to("mm")
    known = np.isfinite(mm) & np.isfinite(strain)
    row = int(np.argmax(np.where(known, np.abs(strain), 0)))
    if not known.any() or strain[row] == 0 or mm[row] == 0:
        return ()
    implied_mm = float(mm[row] / strain[row])
    if abs(implied_mm / specimen.length_mm - 1) < 0.01:
        return ()
    return (
        warning(
            f"{name} is {displacement.name} divided by {implied_mm:.5g} mm, but the file specifies a length of "
            f"{specimen.length_mm:.6g} mm; {name} is used unchanged (use --length-mm to divide {displacement.name} by "
            "a specified length instead)"
        ),
    )


def _mode_in_file(recording: Recording, specimen: Specimen) -> TestMode | None:
    """Return the mode from the words in a file, or compression for a cube; None if unknown."""
    if specimen.is_cube:
        return "compression"
    metadata = recording.provenance.metadata
    words = " ".join((*recording.names, *metadata.keys(), *metadata.values())).casefold()
    is_compressed = any(word in words for word in _COMPRESSION_WORDS)
    is_pulled = any(word in words for word in _TENSION_WORDS)
    if is_compressed == is_pulled:
        return None
    return "compression" if is_compressed else "tension"


def _preload(metadata: Mapping[str, str]) -> str:
    """Return the entry for the preload as written in the file; empty if there is none or the preload is 0."""
    for heading, text in metadata.items():
        if any(word in heading.casefold() for word in ("vorkraft", "pre-load", "preload", "vorlast")):
            digits = "".join(c if c.isdigit() or c in ".,-" else " " for c in text).replace(",", ".").split()
            try:
                preload = float(digits[0]) if digits else math.nan
            except ValueError:
                continue
            if preload > 0:
                return f"{heading} {text.strip()}"
    return ""
