"""Stiffness: exports of a testing machine in, modulus and hyperelastic model of each material out."""

from collections.abc import Sequence
from pathlib import Path

from solen.errors import SpecError
from solen.material.stiffness import Dimensions, MeasuredStiffness, MechanicalTest, StiffnessOptions, stiffness_of
from solen.material.stiffness.modes import TestMode
from solen.pipeline.outputs import check_ending, check_outputs, write
from solen.recording import read_parts
from solen.report.options import FigureOptions
from solen.results import Outcome


def stiffness(
    files: Sequence[Path],
    options: StiffnessOptions = StiffnessOptions(),
    dimensions: Dimensions = Dimensions(),
    *,
    compression: Sequence[Path] = (),
    planar: Sequence[Path] = (),
    biaxial: Sequence[Path] = (),
    labels: Sequence[str] = (),
    columns: Sequence[str] | None = None,
    sheet: str | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
    csv: Path | None = None,
) -> Outcome[MeasuredStiffness]:
    """Modulus and model of each material.

    Parameters
    ----------
    files
        Tests in the mode of the options.
    options, dimensions
        How tests are evaluated, and what is stated of the specimens in ``files`` and ``compression``; those of the
        others are in their own metadata, or their stress is.
    compression, planar, biaxial
        Further tests, in these modes.
    labels
        Materials: none, one for all, or one for each file in the order above.
    columns, sheet
        Names of the columns of tables without a header, and a workbook's sheet.
    out, figure, csv
        Where to write the result, its figure, and a table of engineering and true stress and strain.

    Raises
    ------
    DataError, SpecError, OutputError
        In one line, where a file, an option or an output is not what it should be.
    """
    check_outputs(out, figure)
    check_ending(csv, "a table", ".csv")
    stated: list[tuple[Path, TestMode | None]] = [(path, options.mode) for path in files]
    stated += [(path, "compression") for path in compression]
    own = len(stated)
    stated += [(path, "planar") for path in planar]
    stated += [(path, "equibiaxial") for path in biaxial]
    if not stated:
        raise SpecError("stiffness", limit="needs a file", remedy="name one or more exports")
    if len(labels) not in {0, 1, len(stated)}:
        limit = f"one for all files, or one for each of the {len(stated)}"
        raise SpecError("--label", value=len(labels), limit=limit)
    each = tuple(labels) if len(labels) == len(stated) else (*labels, "")[:1] * len(stated)
    tests = [
        MechanicalTest(
            recording=recording,
            mode=mode,
            label=label,
            dimensions=dimensions if number < own else Dimensions(),
            compliance_mm_per_N=options.compliance_mm_per_N if number < own else 0.0,
            name=name,
        )
        for number, ((path, mode), label) in enumerate(zip(stated, each, strict=True))
        for name, recording in read_parts(path, sheet=sheet, columns=columns)
    ]
    measured_stiffness = stiffness_of(tests, options)
    return write(
        measured_stiffness, "stiffness", out, {"csv": (csv, lambda: measured_stiffness.table().encode())}, figure=figure
    )
