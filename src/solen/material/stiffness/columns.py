"""Stress and strain columns in a recording, and what a file specifies about its test.

The machine's own stress or strain has priority over one computed from force and area, or from displacement and length,
unless the user specifies the length. Words in the file that describe the test, such as compression, a preload or a
width, are used and named; anything that the file does not specify must be specified by the user.

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
from solen.material.stiffness.stress_strain import StressStrain, as_test, sense
from solen.ranks import Caution, warning
from solen.recording import Channel, Recording

FORCE = ("force", "standard force", "load")
DISPLACEMENT = ("displacement", "extension", "travel")
CROSSHEAD = ("crosshead", "position")
STRESS, TRUE_STRESS = ("stress", "engineering stress"), ("true stress",)
STRAIN, STRETCH, TRUE_STRAIN = ("strain", "engineering strain"), ("stretch",), ("true strain",)
_COMPRESSED = ("compress", "druckversuch", "stauch", "druckspannung", "druckprüf")
_PULLED = (
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
    made: bool = False
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
        Dimensions of the specimen, as far as known.
    mode
        None to infer it from the signs and words in the file.
    compliance_mm_per_N
        Compliance of machine and fixture; force times compliance is subtracted from the displacement.

    Raises
    ------
    DataError
        If a column, unit or dimension is missing, a number is missing between others, or there was no deformation.
    """
    stress = _stress(recording, specimen)
    strain = _strain(recording, specimen)
    if (removed := strain.made and compliance_mm_per_N > 0) and specimen.area_mm2 and specimen.length_mm:
        given = compliance_mm_per_N * specimen.area_mm2 / specimen.length_mm * stress.values
        strain = replace(strain, values=_without_compliance(strain.values, given))
    name = recording.provenance.file or "test"
    made = as_test(
        strain.values,
        stress.values,
        specimen,
        mode or _stated_mode(recording, specimen),
        name=name,
        assumed=mode is None,
    )
    return replace(
        made,
        made_from=f"stress: {stress.origin}; strain: {strain.origin}",
        area_used=stress.made,
        from_displacement=strain.made,
        compliance_removed=removed,
        preload=_preload(recording.provenance.metadata),
        warnings=(*made.warnings, *strain.warnings),
    )


def _stress(recording: Recording, specimen: Specimen) -> _Column:
    """Return engineering stress in MPa, from its own column or from force and area."""
    stress = recording.find(*STRESS)
    if stress is not None:
        return _Column(stress.to("MPa"), stress.name)
    force = _only(recording, FORCE)
    if force is not None:
        if specimen.area_mm2 is None:
            remedy = "specify --strip-width-mm and --thickness-mm, --area-mm2, --diameter-mm, or --cube-mm"
            raise DataError(
                f"{recording.provenance.name}: area of the specimen", limit="is not specified", remedy=remedy
            )
        origin = f"{force.name} / {specimen.area_mm2:.6g} mm²"
        return _Column(force.to("N") / specimen.area_mm2, origin, made=True)
    true = recording.find(*TRUE_STRESS)
    if true is not None:
        return _Column(true.to("MPa") / (1 + _strain(recording, specimen).values), f"{true.name} / stretch")
    remedy = f"its columns are {', '.join(recording.names[:12])}"
    raise DataError(recording.provenance.name, limit="has no column of force or stress", remedy=remedy)


def _strain(recording: Recording, specimen: Specimen) -> _Column:
    """Return engineering strain.

    A displacement over a length specified by the user has priority over the file's strain, which has priority over a
    displacement with the file's length.
    """
    stretch, strain, true = (recording.find(*names) for names in (STRETCH, STRAIN, TRUE_STRAIN))
    travel, absolute = _travel(recording)
    stated = stretch or strain or true
    if travel is not None and specimen.length_mm is not None and (specimen.length_by_user or stated is None):
        moved = travel.to("mm")
        there = moved[np.isfinite(moved)]
        zero = float(there[0]) if absolute and len(there) else 0.0
        origin = f"{travel.name}{' since the first point' if absolute else ''} / {specimen.length_mm:.6g} mm"
        return _Column((moved - zero) / specimen.length_mm, origin, made=True)
    if strain is not None:
        values = strain.to("1")
        return _Column(values, strain.name, warnings=_other_length(recording, specimen, values, strain.name))
    if stretch is not None:
        return _Column(stretch.to("1") - 1, f"{stretch.name} - 1")
    if true is not None:
        return _Column(np.expm1(true.to("1")), f"exp({true.name}) - 1")
    if travel is not None:
        remedy = "specify --length-mm (the gauge length, or the height of a compressed specimen) or --cube-mm"
        raise DataError(f"{recording.provenance.name}: length of the specimen", limit="is not specified", remedy=remedy)
    remedy = f"its columns are {', '.join(recording.names[:12])}"
    raise DataError(recording.provenance.name, limit="has no column of displacement, strain or stretch", remedy=remedy)


def _without_compliance(strain: FloatArray, given: FloatArray) -> FloatArray:
    """Return the strain of the specimen alone, with the machine's deformation subtracted along the loading."""
    return strain - sense(strain) * sense(given) * given


def _travel(recording: Recording) -> tuple[Channel | None, bool]:
    """Return the displacement, and whether it is a position with an arbitrary zero."""
    moved = _only(recording, DISPLACEMENT)
    if moved is not None:
        return moved, False
    return _only(recording, CROSSHEAD), True


def _only(recording: Recording, names: tuple[str, ...]) -> Channel | None:
    """Return the channel with these names; `DataError` if several qualify and none has the plain name."""
    alike = [channel for channel in recording.channels if channel.quantity and channel.quantity == names[0]]
    if len(alike) > 1 and len({_stem(channel.name) for channel in alike}) == 1:
        listed = ", ".join(channel.name for channel in alike[:6])
        remedy = "a file must contain one specimen: keep the columns of one"
        raise DataError(
            recording.provenance.name, limit=f"has {len(alike)} columns of {names[0]}: {listed}", remedy=remedy
        )
    return alike[0] if alike else recording.find(*names)


def _stem(name: str) -> str:
    return name.rsplit(" (", 1)[0]


def _other_length(recording: Recording, specimen: Specimen, strain: FloatArray, name: str) -> tuple[Caution, ...]:
    """Return a warning if the file's strain was computed with a length other than the one it specifies."""
    travel, absolute = _travel(recording)
    if travel is None or absolute or specimen.length_mm is None:
        return ()
    moved = travel.to("mm")
    both = np.isfinite(moved) & np.isfinite(strain)
    at = int(np.argmax(np.where(both, np.abs(strain), 0)))
    if not both.any() or strain[at] == 0 or moved[at] == 0:
        return ()
    implied = float(moved[at] / strain[at])
    if abs(implied / specimen.length_mm - 1) < 0.01:
        return ()
    return (
        warning(
            f"{name} is {travel.name} over {implied:.5g} mm, but the file specifies a length of "
            f"{specimen.length_mm:.6g} mm; the file's strain is used unchanged (use --length-mm "
            "to divide the displacement by a length instead)"
        ),
    )


def _stated_mode(recording: Recording, specimen: Specimen) -> TestMode | None:
    """Return the mode from the words in a file or from a cubic specimen; None if unknown."""
    if specimen.is_cube:
        return "compression"
    metadata = recording.provenance.metadata
    words = " ".join((*recording.names, *metadata.keys(), *metadata.values())).casefold()
    compressed = any(word in words for word in _COMPRESSED)
    pulled = any(word in words for word in _PULLED)
    if compressed == pulled:
        return None
    return "compression" if compressed else "tension"


def _preload(metadata: Mapping[str, str]) -> str:
    """Return the preload above zero that a file specifies, in the file's words."""
    for heading, text in metadata.items():
        if any(word in heading.casefold() for word in ("vorkraft", "pre-load", "preload", "vorlast")):
            digits = "".join(c if c.isdigit() or c in ".,-" else " " for c in text).replace(",", ".").split()
            try:
                size = float(digits[0]) if digits else math.nan
            except ValueError:
                continue
            if size > 0:
                return f"{heading} {text.strip()}"
    return ""
