"""Stiffness: exports of a testing machine as input, modulus and hyperelastic model of each material as output."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen.errors import SpecError
from solen.material.stiffness import Dimensions, MeasuredStiffness, MechanicalTest, StiffnessOptions, stiffness_of
from solen.material.stiffness.modes import TestMode
from solen.pipeline.options import FLAT, Out, Sheet
from solen.pipeline.outputs import check_ending, check_outputs, write
from solen.recording import read_parts
from solen.report.options import FigureOptions
from solen.results import Outcome

_SEVERAL = Parameter(consume_multiple=True)
_Files = Annotated[tuple[Path, ...], _SEVERAL]
_Texts = Annotated[tuple[str, ...], _SEVERAL]


def stiffness(
    *files: Path,
    options: Annotated[StiffnessOptions, FLAT, _SEVERAL] = StiffnessOptions(),
    dimensions: Annotated[Dimensions, FLAT] = Dimensions(),
    compression: _Files = (),
    planar: _Files = (),
    biaxial: _Files = (),
    label: _Texts = (),
    columns: _Texts | None = None,
    sheet: Sheet = None,
    csv: Path | None = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
) -> Outcome[MeasuredStiffness]:
    """Compute modulus, cycles and a hyperelastic model from compression and tension tests.

    Parameters
    ----------
    files
        Exports of a testing machine or tables, one specimen each.
    compression
        Further files of compression tests, which are fitted jointly with the others.
    planar
        Further files of planar tension (pure shear) tests.
    biaxial
        Further files of equibiaxial tension tests.
    label
        Name of the material: one for all files, or one per file in the order above. Equal labels mark replicates.
    columns
        Names of the columns of tables without a header, such as stress_MPa stretch.
    csv
        Write engineering and true stress and strain of all specimens to a table.

    Raises
    ------
    DataError, SpecError, OutputError
        If a file, an option or an output is invalid.
    """
    check_outputs(out, figure)
    check_ending(csv, "a table", ".csv")
    inputs: list[tuple[Path, TestMode | None]] = [(path, options.mode) for path in files]
    inputs += [(path, "compression") for path in compression]
    uniaxial = len(inputs)
    inputs += [(path, "planar") for path in planar]
    inputs += [(path, "equibiaxial") for path in biaxial]
    if not inputs:
        raise SpecError("stiffness", limit="requires a file", remedy="name one or more exports")
    if len(label) not in {0, 1, len(inputs)}:
        limit = f"must occur once, or {len(inputs)} times, once for each file, but occurs {len(label)} times"
        raise SpecError("--label", limit=limit)
    labels = tuple(label) if len(label) == len(inputs) else (*label, "")[:1] * len(inputs)
    tests = [
        MechanicalTest(
            recording=recording,
            mode=mode,
            label=label,
            dimensions=dimensions if number < uniaxial else Dimensions(),
            compliance_mm_per_N=options.compliance_mm_per_N if number < uniaxial else 0.0,
            name=name,
        )
        for number, ((path, mode), label) in enumerate(zip(inputs, labels, strict=True))
        for name, recording in read_parts(path, sheet=sheet, columns=columns)
    ]
    result = stiffness_of(tests, options)
    return write(result, "stiffness", out, {"csv": (csv, lambda: result.table().encode())}, figure=figure)
