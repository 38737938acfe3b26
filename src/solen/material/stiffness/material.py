"""Modulus and model of each material from the specimens of mechanical tests.

Every recording contains one specimen, unless a column names several. Specimens with the same label are of the same
material: the modulus of the material is the mean over its specimens, and a single set of model parameters is fitted to
the tests of all of them, in all modes.

`stiffness_of` evaluates `MechanicalTest` recordings and returns a `MeasuredStiffness`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solen.errors import DataError
from solen.files import SIMULATED_DATA, csv_cell
from solen.material.rows import chosen_rows, refuse_unused
from solen.material.stiffness.cautions import cautions
from solen.material.stiffness.columns import read_test
from solen.material.stiffness.evaluation import EvaluatedSpecimen, MeanModulus, StiffnessOptions, evaluate, mean_modulus
from solen.material.stiffness.hyperelastic import Fit, choose, fit_each
from solen.material.stiffness.models import KINDS, model
from solen.material.stiffness.modes import TestMode
from solen.material.stiffness.modulus import Range
from solen.material.stiffness.specimen import Dimensions, number_in, specimen_of
from solen.material.stiffness.stress_strain import StressStrain
from solen.ranks import Caution, note, prefixed, warning
from solen.recording import Measured, Recording

_MAX_RUBBER_MPA = 100.0  # largest modulus to which auto fits a hyperelastic model
_SPECIMEN, _MATERIAL = ("specimen", "sample", "replicate", "probe"), ("material", "resin", "group", "gruppe")
_MACHINE_MODULUS = (
    "e-modul",
    "e-modulus",
    "e modulus",
    "young's modulus",
    "youngs modulus",
    "zugmodul",
    "druckmodul",
    "et",
    "ec",
)


@dataclass(frozen=True, eq=False)
class MechanicalTest:
    """A recording to evaluate.

    Attributes
    ----------
    recording
        Recording of one specimen, or of several specimens that are named in a column.
    mode
        Mode of the test; None to infer it from the words and signs in the file.
    label
        Name of the material; empty to read it from a column.
    dimensions
        Specified dimensions of the specimens.
    compliance_mm_per_N
        Compliance of machine and fixture.
    name
        Name of the specimen, if the file contains several.
    """

    recording: Recording
    mode: TestMode | None = None
    label: str = ""
    dimensions: Dimensions = field(default_factory=Dimensions)
    compliance_mm_per_N: float = 0.0
    name: str = ""


class MaterialStiffness(MeanModulus, kw_only=True):
    """Modulus and model of a material.

    Attributes
    ----------
    label
        Label of the material; None if it has no label.
    strain_range
        Strain range for the modulus of the first specimen, as magnitudes.
    mode
        Mode of the first test: tension, compression, uniaxial (both directions), planar or equibiaxial.
    specimens
        All specimens; the modulus is the mean over those that were tested in the mode of the first.
    model, fits
        The chosen fit, or None; and all fits.
    warnings
        Warnings, one sentence each.
    """

    label: str | None
    strain_range: Range
    mode: str
    specimens: tuple[EvaluatedSpecimen, ...]
    model: Fit | None
    fits: tuple[Fit, ...]
    warnings: tuple[Caution, ...]


class MeasuredStiffness(MaterialStiffness, Measured, kw_only=True):
    """Stiffness of the tested materials. The inherited attributes describe the first material.

    Attributes
    ----------
    groups
        Stiffness of every material, including the first; empty if only one material was tested.
    """

    groups: tuple[MaterialStiffness, ...]

    @property
    def materials(self) -> tuple[MaterialStiffness, ...]:
        """All materials."""
        return self.groups or (self,)

    def table(self) -> str:
        """Return stress and strain of all specimens, with name and material, as CSV, marked if simulated."""
        lines = ["specimen,material,strain,stress_MPa,true_strain,true_stress_MPa"]
        for material in self.materials:
            for specimen in material.specimens:
                names = ",".join(csv_cell(text) for text in (specimen.name, material.label or ""))
                test = specimen.test
                columns = zip(test.strain, test.stress_MPa, test.true_strain, test.true_stress_MPa, strict=True)
                lines += [f"{names},{a:.9g},{b:.9g},{c:.9g},{d:.9g}" for a, b, c, d in columns]
        return SIMULATED_DATA * self.simulated + "\n".join(lines) + "\n"


@dataclass(frozen=True, eq=False)
class _Specimen:
    """One specimen with its material and recording."""

    label: str
    recording: Recording
    evaluated: EvaluatedSpecimen


def stiffness_of(tests: Sequence[MechanicalTest], options: StiffnessOptions = StiffnessOptions()) -> MeasuredStiffness:
    """Return modulus and model of each material.

    Raises
    ------
    DataError
        If a column, unit or dimension is missing, or the range of the modulus contains too few points.
    """
    tests = [replace(test, recording=chosen_rows(test.recording, options)) for test in tests]
    used = (*_SPECIMEN, *_MATERIAL)
    notes = [text for test in tests for text in refuse_unused(test.recording, options, used, labels_only=True)]
    specimens = _specimens(tests, options)
    labels = list(dict.fromkeys(specimen.label for specimen in specimens))
    groups = tuple(
        _material([specimen for specimen in specimens if specimen.label == label], options) for label in labels
    )
    warnings = tuple(dict.fromkeys([*notes, *(caution for group in groups for caution in group.warnings)]))
    if len(groups) > 1:
        text = (
            f"the modulus and the model apply only to {labels[0]}; "
            f"the list groups contains the results of all {len(labels)} materials"
        )
        warnings = (*warnings, note(text))
    sources = {specimen.recording.provenance.sha256: specimen.recording.provenance for specimen in specimens}
    return MeasuredStiffness(
        **vars(groups[0]) | {"warnings": warnings},
        groups=groups if len(groups) > 1 else (),
        sources=tuple(sources.values()),
    )


def _specimens(tests: Sequence[MechanicalTest], options: StiffnessOptions) -> list[_Specimen]:
    """Return the specimens of all recordings, evaluated over a common strain range for each mode if possible."""
    specimens: list[_Specimen] = []
    ranges: dict[tuple[str, str], Range] = {}
    for test in tests:
        for name, material, part in _parts(test.recording):
            dimensions = specimen_of(test.dimensions, part.provenance.metadata)
            curve = read_test(part, dimensions, test.mode, test.compliance_mm_per_N)
            mode = (curve.mode.name, curve.loading)
            evaluated = _evaluated(curve, options, ranges.get(mode))
            ranges.setdefault(mode, evaluated.young.strain_range)
            file = part.provenance.file
            evaluated = replace(evaluated, name=": ".join(filter(None, (file, test.name, name))), file=file)
            specimens.append(_Specimen(test.label or material, part, evaluated))
    return specimens


def _evaluated(test: StressStrain, options: StiffnessOptions, strain_range: Range | None) -> EvaluatedSpecimen:
    """Evaluate a test over a range or, if the user did not choose it and it has too few points, the default range."""
    try:
        return evaluate(test, options, strain_range)
    except DataError:
        if strain_range is None or options.strain_range_percent is not None:
            raise
    evaluated = evaluate(test, options)
    low, high = (100 * end for end in evaluated.young.strain_range)
    text = (
        f"the modulus is fitted over {low:.3g} to {high:.3g} %, because this test has too few points in the range of "
        "the other specimens"
    )
    return replace(evaluated, warnings=(*evaluated.warnings, warning(text)))


def _parts(recording: Recording) -> list[tuple[str, str, Recording]]:
    """Return the name, the material and the rows of each specimen in a recording, from the columns that name them."""
    columns = [
        [cells for name in names if (cells := recording.label(name)) is not None] for names in (_MATERIAL, _SPECIMEN)
    ]
    if not any(columns):
        return [("", "", recording)]
    length = len(recording.channels[0].values) if recording.channels else 0
    labels = [[" ".join(row).strip() for row in zip(*cells, strict=True)] or [""] * length for cells in columns]
    keys = list(zip(*labels, strict=True))
    parts = []
    for key in dict.fromkeys(keys):
        rows = np.array([row_key == key for row_key in keys])
        channels = tuple(replace(c, values=c.values[rows]) for c in recording.channels)
        parts.append((" ".join(filter(None, key)), key[0], replace(recording, channels=channels, texts={})))
    return parts


def _material(specimens: Sequence[_Specimen], options: StiffnessOptions) -> MaterialStiffness:
    first = specimens[0].evaluated.test
    moduli = [
        specimen.evaluated.young
        for specimen in specimens
        if (specimen.evaluated.test.mode, specimen.evaluated.test.loading) == (first.mode, first.loading)
    ]
    mean = mean_modulus(moduli)
    fits, fit_notes = _fits(specimens, options, mean.modulus_MPa)
    chosen = choose(fits)
    warnings = [
        *_specimen_warnings(specimens),
        *_count_warnings(len(moduli)),
        *fit_notes,
        *_fit_warnings(fits, chosen),
    ]
    label = specimens[0].label
    return MaterialStiffness(
        **vars(mean),
        label=label or None,
        strain_range=specimens[0].evaluated.young.strain_range,
        mode=first.loading if first.mode.name == "uniaxial" and first.loading != "both" else first.mode.name,
        specimens=tuple(specimen.evaluated for specimen in specimens),
        model=chosen,
        fits=fits,
        warnings=tuple(prefixed(label, caution) for caution in warnings),
    )


def _fits(
    specimens: Sequence[_Specimen], options: StiffnessOptions, modulus_MPa: float
) -> tuple[tuple[Fit, ...], list[Caution]]:
    """Return the requested fits, and a note if ``auto`` makes none."""
    if "none" in options.fit:
        return (), []
    if "auto" in options.fit and abs(modulus_MPa) > _MAX_RUBBER_MPA:
        return (), [
            note(
                f"no hyperelastic model is fitted, because {modulus_MPa:.4g} MPa is not the modulus of a rubber; use "
                "--fit all to fit the models anyway"
            )
        ]
    curves = [specimen.evaluated.fitted for specimen in specimens]
    kinds = list(KINDS) if {"all", "auto"} & set(options.fit) else [str(kind) for kind in options.fit]
    points = sum(len(curve.stretch) for curve in curves)
    possible = [kind for kind in kinds if points > len(model(kind).names)]
    return fit_each(possible or kinds[:1], curves, options.weighting), []


def _specimen_warnings(specimens: Sequence[_Specimen]) -> list[Caution]:
    """Return the warnings about the specimens, prefixed with their names unless a warning is common to all."""
    common = set.intersection(*(set(specimen.evaluated.warnings) for specimen in specimens))
    warnings: list[Caution] = []
    for specimen in specimens:
        cautions = (*specimen.evaluated.warnings, *specimen.recording.warnings, *_machine_warnings(specimen))
        name = specimen.evaluated.name
        warnings += [caution if caution in common else prefixed(name, caution) for caution in cautions]
    return list(dict.fromkeys(warnings))


def _machine_warnings(specimen: _Specimen) -> list[Caution]:
    """Return a warning if the modulus that the machine exported differs from the computed modulus."""
    for heading, text in specimen.recording.provenance.metadata.items():
        if heading.casefold().strip() not in _MACHINE_MODULUS:
            continue
        exported, modulus = number_in(text, "MPa", heading), specimen.evaluated.young.modulus_MPa
        if exported and abs(modulus / exported - 1) > 0.01:
            return [
                warning(
                    f"{heading} in the file is {exported:.6g} MPa, which differs from the computed modulus by "
                    f"{100 * (exported / modulus - 1):+.1f} %"
                )
            ]
    return []


def _count_warnings(specimens: int) -> list[Caution]:
    if specimens == 1:
        return [warning("only one specimen was tested: the variation between specimens of this material is unknown")]
    if specimens == 2:
        return [warning("only two specimens were tested: their standard deviation is itself uncertain by 76 %")]
    return []


def _fit_warnings(fits: Sequence[Fit], chosen: Fit | None) -> list[Caution]:
    if chosen is not None:
        return cautions(chosen)
    kinds = ", ".join(fit.kind for fit in fits)
    return [warning(f"no model is chosen: none of {kinds} is stable over the data")] if fits else []
