"""Modulus and model of each material from the specimens of mechanical tests.

Every recording is a specimen, unless one of its columns names several. Specimens with the same label are the same
material: its modulus is their mean, and a single set of model parameters is fitted to all its tests, in all modes.

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
from solen.material.stiffness.evaluation import Evaluated, MeanModulus, StiffnessOptions, evaluate, mean_modulus
from solen.material.stiffness.hyperelastic import Fit, choose, fit_each
from solen.material.stiffness.models import KINDS, model
from solen.material.stiffness.modes import TestMode
from solen.material.stiffness.modulus import Range
from solen.material.stiffness.specimen import Dimensions, number_in, specimen_of
from solen.material.stiffness.stress_strain import StressStrain
from solen.ranks import Caution, note, prefixed, warning
from solen.recording import Measured, Recording

_RIGID_MPA = 100.0  # anything stiffer is not a rubber: auto fits no hyperelastic model to it
_SPECIMEN, _MATERIAL = ("specimen", "sample", "replicate", "probe"), ("material", "resin", "group", "gruppe")
_MACHINE = (
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
        Recording of one specimen, or of several named in a column.
    mode
        Mode of the test; None to infer it from the signs and words of the file.
    label
        Name of the material; empty to read it from a column.
    dimensions
        Stated dimensions of its specimens.
    compliance_mm_per_N
        Compliance of machine and fixture.
    name
        Name of its specimen, if its file contains several.
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
        Label of the material; None without one.
    strain_range
        Strain range of the modulus of the first specimen, magnitudes.
    mode
        Mode of the first specimen's test: tension, compression, uniaxial (both directions), planar or equibiaxial.
    specimens
        All specimens; the modulus is the mean over those tested like the first.
    model, fits
        The chosen fit, None without one; and all fits.
    warnings
        Warnings, in sentences.
    """

    label: str | None
    strain_range: Range
    mode: str
    specimens: tuple[Evaluated, ...]
    model: Fit | None
    fits: tuple[Fit, ...]
    warnings: tuple[Caution, ...]


class MeasuredStiffness(MaterialStiffness, Measured, kw_only=True):
    """Stiffness of the tested materials: that of the first and, if there are several, of all.

    Attributes
    ----------
    groups
        All materials, if there are several.
    """

    groups: tuple[MaterialStiffness, ...]

    @property
    def materials(self) -> tuple[MaterialStiffness, ...]:
        """Each material once."""
        return self.groups or (self,)

    def table(self) -> str:
        """Return stress and strain of all specimens, with name and material, as CSV marked if simulated."""
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
    evaluated: Evaluated


def stiffness_of(tests: Sequence[MechanicalTest], options: StiffnessOptions = StiffnessOptions()) -> MeasuredStiffness:
    """Return modulus and model of each material.

    Raises
    ------
    DataError
        If a column, unit or dimension is missing, or the range of the modulus contains too few points.
    """
    tests = [replace(each, recording=chosen_rows(each.recording, options)) for each in tests]
    used = (*_SPECIMEN, *_MATERIAL)
    remarks = [note for each in tests for note in refuse_unused(each.recording, options, used, labels_only=True)]
    specimens = _specimens(tests, options)
    labels = list(dict.fromkeys(specimen.label for specimen in specimens))
    groups = tuple(_material([each for each in specimens if each.label == label], options) for label in labels)
    warnings = tuple(dict.fromkeys([*remarks, *(caution for group in groups for caution in group.warnings)]))
    if len(groups) > 1:
        beside = note(f"modulus and model outside groups apply only to {labels[0]}; groups contains all {len(labels)}")
        warnings = (*warnings, beside)
    sources = {each.recording.provenance.sha256: each.recording.provenance for each in specimens}
    return MeasuredStiffness(
        **vars(groups[0]) | {"warnings": warnings},
        groups=groups if len(groups) > 1 else (),
        sources=tuple(sources.values()),
    )


def _specimens(tests: Sequence[MechanicalTest], options: StiffnessOptions) -> list[_Specimen]:
    """Return every specimen of every recording, evaluated over a common strain range for each mode if possible."""
    specimens: list[_Specimen] = []
    ranges: dict[tuple[str, str], Range] = {}
    for tested in tests:
        for name, group, part in _parts(tested.recording):
            dimensions = specimen_of(tested.dimensions, part.provenance.metadata)
            test = read_test(part, dimensions, tested.mode, tested.compliance_mm_per_N)
            kind = (test.mode.name, test.loading)
            evaluated = _evaluated(test, options, ranges.get(kind))
            ranges.setdefault(kind, evaluated.young.strain_range)
            file = part.provenance.file
            evaluated = replace(evaluated, name=": ".join(filter(None, (file, tested.name, name))), file=file)
            specimens.append(_Specimen(tested.label or group, part, evaluated))
    return specimens


def _evaluated(test: StressStrain, options: StiffnessOptions, strain_range: Range | None) -> Evaluated:
    """Evaluate a test over a range, or over its default if that contains too few points and the user stated none."""
    try:
        return evaluate(test, options, strain_range)
    except DataError:
        if strain_range is None or options.strain_range_percent is not None:
            raise
    evaluated = evaluate(test, options)
    low, high = (100 * end for end in evaluated.young.strain_range)
    other = (
        f"modulus over {low:.3g} to {high:.3g} %, because the range of the other specimens contains too few points here"
    )
    return replace(evaluated, warnings=(*evaluated.warnings, warning(other)))


def _parts(recording: Recording) -> list[tuple[str, str, Recording]]:
    """Return the specimens of a recording, each with its name and material, from the columns that name them."""
    columns = [
        [texts for name in names if (texts := recording.label(name)) is not None] for names in (_MATERIAL, _SPECIMEN)
    ]
    if not any(columns):
        return [("", "", recording)]
    length = len(recording.channels[0].values) if recording.channels else 0
    words = [[" ".join(row).strip() for row in zip(*texts, strict=True)] or [""] * length for texts in columns]
    keys = list(zip(*words, strict=True))
    parts = []
    for group, name in dict.fromkeys(keys):
        rows = np.array([key == (group, name) for key in keys])
        channels = tuple(replace(c, values=c.values[rows]) for c in recording.channels)
        parts.append((" ".join(filter(None, (group, name))), group, replace(recording, channels=channels, texts={})))
    return parts


def _material(specimens: Sequence[_Specimen], options: StiffnessOptions) -> MaterialStiffness:
    first = specimens[0].evaluated.test
    moduli = [
        each.evaluated.young
        for each in specimens
        if (each.evaluated.test.mode, each.evaluated.test.loading) == (first.mode, first.loading)
    ]
    mean = mean_modulus(moduli)
    fits, unfitted = _fits(specimens, options, mean.modulus_MPa)
    chosen = choose(fits)
    warnings = [*_of_specimens(specimens), *_of_count(len(moduli)), *unfitted, *_of_fits(fits, chosen)]
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
    """Return the requested fits, and a warning if ``auto`` makes none."""
    if "none" in options.fit:
        return (), []
    if "auto" in options.fit and abs(modulus_MPa) > _RIGID_MPA:
        return (), [
            note(
                f"no hyperelastic model: {modulus_MPa:.4g} MPa is not the modulus of a rubber; --fit all fits the "
                "models anyway"
            )
        ]
    curves = [specimen.evaluated.fitted for specimen in specimens]
    kinds = list(KINDS) if {"all", "auto"} & set(options.fit) else [str(kind) for kind in options.fit]
    points = sum(len(curve.stretch) for curve in curves)
    possible = [kind for kind in kinds if points > len(model(kind).names)]
    return fit_each(possible or kinds[:1], curves, options.weighting), []


def _of_specimens(specimens: Sequence[_Specimen]) -> list[Caution]:
    """Return the warnings of the specimens, with their names if they differ."""
    shared = set.intersection(*(set(each.evaluated.warnings) for each in specimens))
    warnings: list[Caution] = []
    for each in specimens:
        own = (*each.evaluated.warnings, *each.recording.warnings, *_of_machine(each))
        warnings += [caution if caution in shared else prefixed(each.evaluated.name, caution) for caution in own]
    return list(dict.fromkeys(warnings))


def _of_machine(specimen: _Specimen) -> list[Caution]:
    """Return a warning if the machine's modulus differs."""
    for heading, text in specimen.recording.provenance.metadata.items():
        if heading.casefold().strip() not in _MACHINE:
            continue
        theirs, ours = number_in(text, "MPa", heading), specimen.evaluated.young.modulus_MPa
        if theirs and abs(ours / theirs - 1) > 0.01:
            return [
                warning(
                    f"the machine's own {heading} is {theirs:.6g} MPa, which differs from this "
                    f"modulus by {100 * (theirs / ours - 1):+.1f} %"
                )
            ]
    return []


def _of_count(specimens: int) -> list[Caution]:
    if specimens == 1:
        return [warning("only one specimen was tested: the variation between specimens of this material is unknown")]
    return (
        [warning("only two specimens were tested: their standard deviation is itself uncertain by 76 %")]
        if specimens == 2
        else []
    )


def _of_fits(fits: Sequence[Fit], chosen: Fit | None) -> list[Caution]:
    if chosen is not None:
        return cautions(chosen)
    kinds = ", ".join(each.kind for each in fits)
    return [warning(f"no model is chosen: none of {kinds} is stable over the data")] if fits else []
