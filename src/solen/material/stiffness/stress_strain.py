"""Engineering and true stress and strain from the records of a testing machine.

Engineering stress is the force divided by the area before the test, and engineering strain is the displacement divided
by the length before the test; compression is negative in both, regardless of the sign in the file. Stress and strain
columns in a file are used unchanged, except for their sign. True stress and strain assume an incompressible specimen,
λA = A₀: σ = Pλ, ε = ln λ, in all three modes. This is an approximation (ν > 0.499 for rubbers, lower for printed parts
with voids), and does not hold for a specimen that barrels or necks.

`as_test` converts arrays to a `StressStrain`; `solen.material.stiffness.columns` does so for a recording.
"""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.stiffness.modes import MODES, UNIAXIAL, Mode, TestMode
from solen.material.stiffness.specimen import Specimen
from solen.ranks import Caution, warning
from solen.results import HIDDEN, reported

Loading = Literal["tension", "compression", "both"]
_MIN_POINTS = 5
_MAX_CURVE_POINTS = 400  # number of points of a curve in a result
_MIN_REVERSE_FRACTION = 0.05  # fraction of the strain range beyond zero for a test in both directions
_STRAINS, _STRESSES_MPA = (1e-9, 1e3), (1e-12, 1e6)  # smallest change and largest magnitude of a test
_MAX_STRAIN = 20.0  # a larger strain is probably in per cent


@dataclass(frozen=True, eq=False)
class StressStrain:
    """One test, in the order of recording.

    Attributes
    ----------
    mode
        Mode of deformation.
    loading
        ``tension``, ``compression``, or ``both`` if a file contains both.
    strain, stress_MPa
        Engineering strain and stress, shape (n,); compression is negative.
    specimen
        Dimensions of the specimen.
    made_from
        Columns that contain stress and strain, or from which they are computed.
    area_used
        Whether the stress is a force divided by the area of the specimen.
    from_displacement
        Whether the strain is a displacement divided by a length, including slack and the compliance of the machine.
    compliance_removed
        Whether the effect of the compliance has been subtracted.
    preload
        Preload at which strain was set to zero, in the words of the file; empty if the file specifies none.
    notes, warnings
        Notes on the evaluation, and warnings, one sentence each.
    """

    mode: Mode = field(metadata=HIDDEN)
    loading: Loading
    strain: FloatArray = field(metadata=HIDDEN)
    stress_MPa: FloatArray = field(metadata=HIDDEN)
    specimen: Specimen
    made_from: str = ""
    area_used: bool = False
    from_displacement: bool = False
    compliance_removed: bool = False
    preload: str = ""
    notes: tuple[str, ...] = ()
    warnings: tuple[Caution, ...] = ()

    @property
    def stretch(self) -> FloatArray:
        """Stretch, λ = 1 + strain."""
        return 1 + self.strain

    @property
    def true_strain(self) -> FloatArray:
        """Logarithmic strain, ln λ."""
        return np.log(self.stretch)

    @property
    def true_stress_MPa(self) -> FloatArray:
        """Cauchy stress of an incompressible specimen, Pλ."""
        return self.stress_MPa * self.stretch

    @reported
    def curve(self) -> dict[str, FloatArray]:
        """Engineering and true strain and stress of all points or, if there are more, of 400 evenly spaced ones."""
        count = len(self.strain)
        rows = np.unique(np.linspace(0, count - 1, min(_MAX_CURVE_POINTS, count)).round().astype(int))
        names = ("strain", "stress_MPa", "true_strain", "true_stress_MPa")
        return {name: getattr(self, name)[rows] for name in names}

    @property
    def sign(self) -> int:
        """Sign of the strain during loading: -1 in compression, otherwise 1."""
        return -1 if self.loading == "compression" else 1

    def shifted(self, zero_strain: float) -> "StressStrain":
        """Return the same test with strains relative to a strain of this test."""
        return replace(self, strain=self.strain - zero_strain)


def as_test(
    strain: FloatArray,
    stress_MPa: FloatArray,
    specimen: Specimen,
    mode: TestMode | None = None,
    *,
    name: str = "test",
    is_inferred: bool = False,
) -> StressStrain:
    """Return a test from engineering strain and stress in MPa, of either sign, shape (n,) each.

    Parameters
    ----------
    strain, stress_MPa, specimen
        As in `StressStrain`; trailing NaNs are dropped.
    mode
        Mode of the test; None to infer it from the signs.
    name
        Name of the test in error messages.
    is_inferred
        Whether the user specified no mode; ambiguities are then reported in warnings.

    Raises
    ------
    DataError
        If there are no data to evaluate.
    """
    strain, stress = _without_gaps(np.asarray(strain, dtype=float), np.asarray(stress_MPa, dtype=float), name)
    loading, notes, warnings = _loading(strain, stress, mode, name, is_inferred)
    if loading != "both":
        sign = -1 if loading == "compression" else 1
        strain, stress = sign * dominant_sign(strain) * strain, sign * dominant_sign(stress) * stress
    if (lowest := float(strain.min())) <= -1:
        limit = "must be above -1, at which the length is 0"
        remedy = "check the length and the unit of the displacement or strain"
        raise DataError(f"{name}: strain", value=lowest, limit=limit, remedy=remedy)
    if strain.max() > _MAX_STRAIN:
        warnings = (
            *warnings,
            warning(
                f"the largest strain is {strain.max():.4g} ({100 * strain.max():.4g} %): check that the values are not "
                "in per cent"
            ),
        )
    return StressStrain(
        mode=MODES.get(mode or "", UNIAXIAL),
        loading=loading,
        strain=strain,
        stress_MPa=stress,
        specimen=specimen,
        notes=notes,
        warnings=warnings,
    )


def _without_gaps(strain: FloatArray, stress: FloatArray, name: str) -> tuple[FloatArray, FloatArray]:
    """Return both arrays without missing rows at the end; raise `DataError` for gaps, few points or no deformation."""
    if strain.shape != stress.shape or strain.ndim != 1:
        limit = f"must have as many strains as stresses, but their shapes are {strain.shape} and {stress.shape}"
        raise DataError(name, limit=limit)
    complete = np.isfinite(strain) & np.isfinite(stress)
    count = int(np.flatnonzero(complete)[-1]) + 1 if complete.any() else 0
    strain, stress, complete = strain[:count], stress[:count], complete[:count]
    if not complete.all():
        row = int(np.flatnonzero(~complete)[0]) + 1
        limit = f"has no value in {int((~complete).sum())} of {count} rows, the first of which is row {row}"
        raise DataError(f"{name}: stress or strain", limit=limit, remedy="delete these rows, or export the test again")
    if count < _MIN_POINTS:
        limit = f"must be at least {_MIN_POINTS}"
        raise DataError(f"{name}: number of points", value=count, limit=limit, remedy="export all points")
    _check_magnitude(f"{name}: strain", strain, "", _STRAINS)
    _check_magnitude(f"{name}: stress", stress, " MPa", _STRESSES_MPA)
    return strain, stress


def _check_magnitude(name: str, values: FloatArray, unit: str, limits: tuple[float, float]) -> None:
    """Raise `DataError` for values that do not change, or have a magnitude that no specimen can reach."""
    min_change, max_magnitude = limits
    largest = float(values[int(np.argmax(np.abs(values)))])
    if abs(largest) > max_magnitude:
        limit = f"exceeds {max_magnitude:g}{unit}, which no specimen can reach"
        raise DataError(name, value=largest, limit=limit, remedy="check the column and its unit")
    if float(np.ptp(values)) <= min_change:
        remedy = "check that the correct columns were used, with enough digits"
        raise DataError(name, value=float(values[0]), limit="is the same in every row", remedy=remedy)


def dominant_sign(values: FloatArray) -> int:
    """Return the sign of the value with the largest magnitude."""
    return -1 if values[int(np.argmax(np.abs(values)))] < 0 else 1


def _loading(
    strain: FloatArray,
    stress: FloatArray,
    mode: TestMode | None,
    name: str,
    is_inferred: bool,
) -> tuple[Loading, tuple[str, ...], tuple[Caution, ...]]:
    """Return the direction of loading, a note on how it was determined, and warnings."""
    reverse_strain = min(-strain.min(), strain.max())
    if mode in {None, "uniaxial"} and reverse_strain > _MIN_REVERSE_FRACTION * np.ptp(strain):
        return _both_directions(strain, stress, name)
    strain_sign, stress_sign = dominant_sign(strain), dominant_sign(stress)
    words = {1: "positive", -1: "negative"}
    signs = f"exported with {words[strain_sign]} strain and {words[stress_sign]} force"
    if mode == "tension" or mode == "compression":
        return mode, (f"{mode}, {signs}; compression is negative in the results",), ()
    if mode in {"planar", "equibiaxial"}:
        return "tension", (f"{mode} tension, {signs}",), ()
    if strain_sign != stress_sign:
        limit = f"is {signs}, which may be tension or compression"
        raise DataError(name, limit=limit, remedy="specify --mode tension or --mode compression")
    if strain_sign < 0:
        return "compression", (f"compression, inferred from the signs: {signs}",), ()
    warnings: tuple[Caution, ...] = ()
    if is_inferred:
        warnings = (
            warning(
                "the mode is not specified, and tension is assumed because all signs are positive: if this was a "
                "compression test, specify --mode compression"
            ),
        )
    return "tension", (f"tension, inferred from the signs: {signs}",), warnings


def _both_directions(
    strain: FloatArray, stress: FloatArray, name: str
) -> tuple[Loading, tuple[str, ...], tuple[Caution, ...]]:
    if float(np.sum(np.sign(strain) * np.sign(stress))) <= 0:
        remedy = "specify --mode, or change the sign of one column"
        raise DataError(name, limit="has stress and strain of opposite signs on both sides of zero", remedy=remedy)
    return "both", ("tension and compression in one file, inferred from the signs",), ()
