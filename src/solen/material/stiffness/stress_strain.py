"""Engineering and true stress and strain from the records of a testing machine.

Engineering stress is force over the area before the test, engineering strain displacement over the length before it;
compression is negative in both, regardless of the machine's sign. Stress or strain columns in the file are used
unchanged. True stress and strain assume constant volume, λA = A₀: σ = Pλ, ε = ln λ, in all three modes. This is an
approximation (rubbers: ν > 0.499; printed parts with voids less), and does not hold for a specimen that barrels or
necks.

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
_SHOWN = 400  # number of points of a curve in a result
_BOTH = 0.05  # fraction of the range beyond zero above which a test has both directions
_STRAINS, _STRESSES_MPA = (1e-9, 1e3), (1e-12, 1e6)  # smallest change and largest magnitude
_PERCENT_BY_MISTAKE = 20.0  # a strain without unit beyond this: 2000 %


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
        Whether the stress is a force over the specimen's area.
    from_displacement
        Whether the strain is a displacement over a length, including slack and the machine's compliance.
    compliance_removed
        Whether the machine's compliance has been subtracted.
    preload
        Preload at which strain was set to zero, as the file states it; empty if it states none.
    notes, warnings
        Decisions and warnings, in sentences.
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
        """λ = 1 + strain."""
        return 1 + self.strain

    @property
    def true_strain(self) -> FloatArray:
        """Logarithmic strain, ln λ."""
        return np.log(self.stretch)

    @property
    def true_stress_MPa(self) -> FloatArray:
        """Cauchy stress Pλ of an incompressible specimen."""
        return self.stress_MPa * self.stretch

    @reported
    def curve(self) -> dict[str, FloatArray]:
        """Engineering and true strain and stress: every point, or four hundred evenly spaced ones."""
        count = len(self.strain)
        rows = np.unique(np.linspace(0, count - 1, min(_SHOWN, count)).round().astype(int))
        names = ("strain", "stress_MPa", "true_strain", "true_stress_MPa")
        return {name: getattr(self, name)[rows] for name in names}

    @property
    def sign(self) -> int:
        """+1 if loading raises the strain, -1 in compression."""
        return -1 if self.loading == "compression" else 1

    def shifted(self, zero_strain: float) -> "StressStrain":
        """Return the same test with strain counted from ``zero_strain`` (a strain of this test)."""
        return replace(self, strain=self.strain - zero_strain)


def as_test(
    strain: FloatArray,
    stress_MPa: FloatArray,
    specimen: Specimen,
    mode: TestMode | None = None,
    *,
    name: str = "test",
    assumed: bool = False,
) -> StressStrain:
    """Return a test from engineering strain and stress in MPa, of either sign, shape (n,) each.

    Parameters
    ----------
    strain, stress_MPa, specimen
        As in `StressStrain`; trailing NaNs are dropped.
    mode
        None to infer it from the signs.
    name
        Name of the test in errors.
    assumed
        Whether the mode is inferred rather than stated; ambiguities are then reported in warnings.

    Raises
    ------
    DataError
        If there are no data to evaluate.
    """
    strain, stress = _without_gaps(np.asarray(strain, dtype=float), np.asarray(stress_MPa, dtype=float), name)
    loading, notes, warnings = _loading(strain, stress, mode, name, assumed)
    if loading != "both":
        wanted = -1 if loading == "compression" else 1
        strain, stress = wanted * sense(strain) * strain, wanted * sense(stress) * stress
    if (lowest := float(strain.min())) <= -1:
        remedy = "check the length and the unit of the displacement or strain"
        raise DataError(
            f"{name}: strain",
            value=lowest,
            limit="must remain above -1, because no length remains there",
            remedy=remedy,
        )
    if strain.max() > _PERCENT_BY_MISTAKE:
        warnings = (
            *warnings,
            warning(f"strain reaches {strain.max():.4g}, {100 * strain.max():.4g} %: check that it is not in per cent"),
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
    """Return both without missing rows at their end; `DataError` for gaps, too few points or no deformation."""
    if strain.shape != stress.shape or strain.ndim != 1:
        raise DataError(name, limit=f"strain and stress differ in length: {strain.shape} and {stress.shape}")
    there = np.isfinite(strain) & np.isfinite(stress)
    last = int(np.flatnonzero(there)[-1]) + 1 if there.any() else 0
    strain, stress, there = strain[:last], stress[:last], there[:last]
    if not there.all():
        row = int(np.flatnonzero(~there)[0]) + 1
        limit = f"has no value in {int((~there).sum())} of {last} rows, the first of which is row {row}"
        raise DataError(f"{name}: stress or strain", limit=limit, remedy="delete these rows, or export again")
    if last < _MIN_POINTS:
        raise DataError(
            f"{name}: points", value=last, limit=f"at least {_MIN_POINTS} are needed", remedy="export all of them"
        )
    _check_size(f"{name}: strain", strain, "", _STRAINS)
    _check_size(f"{name}: stress", stress, " MPa", _STRESSES_MPA)
    return strain, stress


def _check_size(what: str, values: FloatArray, unit: str, limits: tuple[float, float]) -> None:
    """Raise `DataError` for values that do not change, or have a magnitude that no specimen shows."""
    least, most = limits
    largest = float(values[int(np.argmax(np.abs(values)))])
    if abs(largest) > most:
        limit = f"is beyond {most:g}{unit}, which no specimen can reach"
        raise DataError(what, value=largest, limit=limit, remedy="check the column and its unit")
    if float(np.ptp(values)) <= least:
        remedy = "check that the right columns were used, with enough digits"
        raise DataError(what, value=float(values[0]), limit="is the same in every row", remedy=remedy)


def sense(values: FloatArray) -> int:
    """Return the sign of the value furthest from zero."""
    return -1 if values[int(np.argmax(np.abs(values)))] < 0 else 1


def _two_sided(strain: FloatArray) -> bool:
    return bool(min(-strain.min(), strain.max()) > _BOTH * np.ptp(strain))


def _loading(
    strain: FloatArray,
    stress: FloatArray,
    mode: TestMode | None,
    name: str,
    assumed: bool,
) -> tuple[Loading, tuple[str, ...], tuple[Caution, ...]]:
    """Return the direction of loading, the decision in words, and warnings."""
    if mode in {None, "uniaxial"} and _two_sided(strain):
        return _both_ways(strain, stress, name)
    exported = (sense(strain), sense(stress))
    signs = f"exported with {'positive' if exported[0] > 0 else 'negative'} strain and "
    signs += f"{'positive' if exported[1] > 0 else 'negative'} force"
    if mode == "tension" or mode == "compression":
        return mode, (f"{mode}, {signs}; compression is negative in the results",), ()
    if mode in {"planar", "equibiaxial"}:
        return "tension", (f"{mode} tension, {signs}",), ()
    if exported[0] != exported[1]:
        limit = f"is {signs}, which may be tension or compression"
        raise DataError(name, limit=limit, remedy="specify it: --mode tension or --mode compression")
    if exported[0] < 0:
        return "compression", (f"compression, inferred from its signs: {signs}",), ()
    warnings: tuple[Caution, ...] = ()
    if assumed:
        warnings = (
            warning(
                "tension is assumed: the file specifies no mode and all signs are positive; otherwise "
                "specify --mode compression"
            ),
        )
    return "tension", (f"tension, inferred from its signs: {signs}",), warnings


def _both_ways(
    strain: FloatArray, stress: FloatArray, name: str
) -> tuple[Loading, tuple[str, ...], tuple[Caution, ...]]:
    if float(np.sum(np.sign(strain) * np.sign(stress))) <= 0:
        remedy = "specify --mode, or change the sign of one column"
        raise DataError(name, limit="stress and strain have opposite signs on both sides of zero", remedy=remedy)
    return "both", ("tension and compression in one file, inferred from its signs",), ()
