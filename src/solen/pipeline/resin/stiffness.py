"""Stiffness: from exports of a testing machine to a modulus and a hyperelastic model of each material.

Every file is a specimen, unless a column of it names several. Specimens of one label are one material: its modulus is
their mean, and one set of a model's parameters is fitted to all its tests, whatever their mode.
"""

# ruff: noqa: N815  units keep their case

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from solen import files
from solen.errors import DataError, OutputError, SpecError
from solen.material import stiffness as physics
from solen.material.stiffness.evaluation import CYCLE, TOE
from solen.material.stiffness.hyperelastic import WEIGHTINGS
from solen.material.stiffness.specimen import number_in
from solen.material.stiffness.test import CHOICES
from solen.pipeline.outputs import check_choice, check_figure, check_out, leave
from solen.pipeline.resin.stiffness_data import fit_data, specimen_data, table
from solen.recording import Recording, read

FITS = ("auto", "none", "all", *physics.KINDS)
_RIGID_MPA = 100.0  # a stiffer thing is no rubber: auto fits no hyperelastic model to it
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
_UNSTATED = physics.Dimensions()


@dataclass(frozen=True)
class Request:
    """What is asked of a set of files.

    Attributes
    ----------
    files
        Tests in ``mode``: tension, compression, or as the file tells.
    compression, planar, equibiaxial
        Further tests, in these modes.
    mode
        One of `CHOICES`, or None.
    labels
        None, one for all, or one for each file in the order above.
    dimensions
        Of the specimens in ``files``; those of the others are in their own metadata, or their stress is.
    strain_range_percent, secant_percent
        Range of the modulus, and strains of the secants, in per cent.
    toe, cycle, fit, weighting, lubricated, compliance_mm_per_N
        How specimens are evaluated and models fitted.
    columns, sheet
        Names of the columns of tables without a header, and a workbook's sheet.
    """

    files: tuple[Path, ...]
    compression: tuple[Path, ...] = ()
    planar: tuple[Path, ...] = ()
    equibiaxial: tuple[Path, ...] = ()
    mode: str | None = None
    labels: tuple[str, ...] = ()
    dimensions: physics.Dimensions = _UNSTATED
    strain_range_percent: tuple[float, float] | None = None
    secant_percent: tuple[float, ...] = ()
    toe: str = "auto"
    cycle: str = "first"
    fit: tuple[str, ...] = ("auto",)
    weighting: str = "absolute"
    lubricated: bool = False
    compliance_mm_per_N: float = 0.0
    columns: tuple[str, ...] | None = None
    sheet: str | None = None


@dataclass(frozen=True)
class _Specimen:
    """One specimen, where it comes from and whose it is."""

    name: str
    label: str
    recording: Recording
    evaluated: physics.Evaluated


def stiffness(
    asked: Request, *, out: Path | None = None, figure: Path | None = None, csv: Path | None = None
) -> dict[str, Any]:
    """Modulus and model of each material, as plain data.

    Parameters
    ----------
    asked
        The files and how to evaluate them.
    out, figure, csv
        Where to leave the result, its figure, and a table of true and engineering stress and strain.

    Raises
    ------
    DataError, SpecError, OutputError
        In one line, where a file, an option or an output is not what it should be.
    """
    _check(asked, out, figure, csv)
    specimens = _specimens(asked)
    labels = list(dict.fromkeys(each.label for each in specimens))
    groups = [_group([s for s in specimens if s.label == label], asked) for label in labels]
    first = groups[0]
    found = {key: first[key] for key in _LEADING}
    found |= {"groups": groups if len(groups) > 1 else [], "sources": _sources(specimens)}
    found["warnings"] = _merged(groups) + ([_first_only(labels)] if len(groups) > 1 else [])
    found = leave(found, "stiffness", out, figure, lambda: _drawn(groups, specimens))
    if csv is None:
        return found
    rows = table((s.name, s.label, s.evaluated.test) for s in specimens)
    files.write_all({csv: rows.encode("utf-8")})
    return found | {"csv": str(csv)}


_LEADING = (
    "label",
    "modulus_MPa",
    "u_modulus_MPa",
    "sd_modulus_MPa",
    "interval95_MPa",
    "strain_range",
    "strain_range_percent",
    "mode",
    "specimens",
    "model",
    "fits",
)


def _check(asked: Request, out: Path | None, figure: Path | None, csv: Path | None) -> None:
    check_out(out)
    check_figure(figure)
    if csv is not None and csv.suffix.lower() != ".csv":
        raise OutputError(str(csv), limit="a table ends in .csv", remedy="rename it")
    if asked.mode is not None:
        check_choice("--mode", asked.mode, CHOICES)
    for option, value, choices in (
        ("--toe", asked.toe, TOE),
        ("--cycle", asked.cycle, CYCLE),
        ("--weighting", asked.weighting, WEIGHTINGS),
    ):
        check_choice(option, value, choices)
    for kind in asked.fit:
        check_choice("--fit", kind, FITS)
    if asked.compliance_mm_per_N < 0:
        raise SpecError("--compliance-mm-per-n", value=asked.compliance_mm_per_N, limit="must be at least 0")
    if not _paths(asked):
        raise SpecError("stiffness", limit="needs a file", remedy="name one or more exports")
    if len(asked.labels) not in {0, 1, len(_paths(asked))}:
        limit = f"one for all files, or one for each of the {len(_paths(asked))}"
        raise SpecError("--label", value=len(asked.labels), limit=limit)
    for percent in asked.secant_percent:
        if percent <= 0:
            raise SpecError("--secant-percent", value=percent, limit="must be above 0")


def _paths(asked: Request) -> list[tuple[Path, str | None]]:
    """Files and the mode that each is said to be in, in their order."""
    found: list[tuple[Path, str | None]] = [(path, asked.mode) for path in asked.files]
    found += [(path, "compression") for path in asked.compression]
    found += [(path, "planar") for path in asked.planar]
    return found + [(path, "equibiaxial") for path in asked.equibiaxial]


def _specimens(asked: Request) -> list[_Specimen]:
    """Every specimen of every file, evaluated; all of one kind over one range of strain."""
    paths = _paths(asked)
    labels = asked.labels if len(asked.labels) == len(paths) else (asked.labels or ("",)) * len(paths)
    found: list[_Specimen] = []
    ranges: dict[tuple[str, str], tuple[float, float]] = {}
    for number, ((path, mode), label) in enumerate(zip(paths, labels, strict=True)):
        recording = read(path, sheet=asked.sheet, columns=asked.columns)
        ours = number < len(asked.files) or mode == "compression"
        stated = asked.dimensions if ours else _UNSTATED
        for name, group, part in _parts(recording):
            specimen = physics.specimen_of(stated, part.provenance.metadata)
            compliance = asked.compliance_mm_per_N if ours else 0.0
            test = physics.read_test(part, specimen, mode, compliance)
            evaluated = _evaluated(test, _settings(asked), ranges)
            called = ": ".join(filter(None, (path.name, name)))
            found.append(_Specimen(called, label or group, part, evaluated))
    return found


def _settings(asked: Request) -> physics.Settings:
    wanted = asked.strain_range_percent
    return physics.Settings(
        strain_range=None if wanted is None else (wanted[0] / 100, wanted[1] / 100),
        toe=asked.toe,
        cycle=asked.cycle,
        secants=tuple(percent / 100 for percent in asked.secant_percent),
        lubricated=asked.lubricated,
    )


def _evaluated(
    test: physics.StressStrain, settings: physics.Settings, ranges: dict[tuple[str, str], tuple[float, float]]
) -> physics.Evaluated:
    """A test over the range of those before it of its kind, where it can be and none is stated; else over its own."""
    kind = (test.mode.name, test.loading)
    if settings.strain_range is not None:
        return physics.evaluate(test, settings)
    if kind not in ranges:
        found = physics.evaluate(test, settings)
        ranges[kind] = found.young.strain_range
        return found
    try:
        return physics.evaluate(test, physics.with_range(settings, ranges[kind]))
    except DataError:
        found = physics.evaluate(test, settings)
        low, high = (100 * end for end in found.young.strain_range)
        told = f"modulus over {low:.3g} to {high:.3g} %, as the range of the other specimens holds too few points here"
        return replace(found, warnings=(*found.warnings, told))


def _parts(recording: Recording) -> list[tuple[str, str, Recording]]:
    """Specimens of a recording, each with its name and its material, by the columns that name them."""
    names, groups = recording.label(*_SPECIMEN), recording.label(*_MATERIAL)
    if names is None and groups is None:
        return [("", "", recording)]
    length = len(recording.channels[0].values) if recording.channels else 0
    keys = list(zip(groups or ("",) * length, names or ("",) * length, strict=True))
    found = []
    for group, name in dict.fromkeys(keys):
        rows = np.array([key == (group, name) for key in keys])
        channels = tuple(replace(c, values=c.values[rows]) for c in recording.channels)
        found.append((" ".join(filter(None, (group, name))), group, replace(recording, channels=channels, texts={})))
    return found


def _group(specimens: Sequence[_Specimen], asked: Request) -> dict[str, Any]:
    """One material."""
    first = specimens[0].evaluated.test
    alike = [s for s in specimens if (s.evaluated.test.mode, s.evaluated.test.loading) == (first.mode, first.loading)]
    mean = physics.mean_modulus([s.evaluated.young for s in alike])
    fits, fitted = _fits(specimens, asked, mean.modulus_MPa)
    chosen = physics.choose(fits)
    low, high = specimens[0].evaluated.young.strain_range
    return {
        "label": specimens[0].label or None,
        "modulus_MPa": mean.modulus_MPa,
        "u_modulus_MPa": mean.u_modulus_MPa,
        "sd_modulus_MPa": mean.sd_modulus_MPa,
        "interval95_MPa": list(mean.interval95_MPa),
        "strain_range": [low, high],
        "strain_range_percent": [100 * low, 100 * high],
        "mode": first.loading if first.mode.name == "uniaxial" and first.loading != "both" else first.mode.name,
        "specimens": [specimen_data(s.name, s.recording.provenance.file, s.evaluated) for s in specimens],
        "model": None if chosen is None else fit_data(chosen, fits),
        "fits": [fit_data(each, fits) for each in fits],
        "warnings": _group_warnings(specimens, alike, mean, fits, chosen, fitted),
    }


def _fits(specimens: Sequence[_Specimen], asked: Request, modulus_MPa: float) -> tuple[list[physics.Fit], str]:  # noqa: N803
    """Fits that are asked for, and why there are none where ``auto`` makes none."""
    if "none" in asked.fit:
        return [], ""
    curves = [each.evaluated.curve for each in specimens]
    kinds = list(physics.KINDS) if {"all", "auto"} & set(asked.fit) else list(asked.fit)
    if "auto" in asked.fit and abs(modulus_MPa) > _RIGID_MPA:
        return (
            [],
            f"no hyperelastic model: {modulus_MPa:.4g} MPa is no rubber's modulus; --fit all fits them still",
        )
    points = sum(len(curve.stretch) for curve in curves)
    possible = [kind for kind in kinds if points > len(physics.model(kind).names)]
    return [physics.fit(kind, curves, asked.weighting) for kind in (possible or kinds[:1])], ""


def _group_warnings(
    specimens: Sequence[_Specimen],
    alike: Sequence[_Specimen],
    mean: physics.MeanModulus,
    fits: Sequence[physics.Fit],
    chosen: physics.Fit | None,
    fitted: str,
) -> list[str]:
    """What one material's numbers do not say; what all specimens share is said once."""
    label = f"{specimens[0].label}: " if specimens[0].label else ""
    told = [f"{label}{each}" for each in dict.fromkeys(w for s in specimens for w in _named(s, specimens))]
    if len(alike) == 1:
        told.append(f"{label}one specimen: how far specimens of this material differ is not known")
    elif mean.specimens == 2:
        told.append(f"{label}two specimens: their standard deviation is itself uncertain by 76 %")
    if fitted:
        told.append(label + fitted)
    if chosen is not None:
        told += [label + each for each in physics.cautions(chosen)]
    elif fits:
        told.append(
            f"{label}no model is chosen: none of {', '.join(f.model.kind for f in fits)} is stable over the data"
        )
    return told


def _named(specimen: _Specimen, specimens: Sequence[_Specimen]) -> list[str]:
    """Warnings of a specimen, with its name where there are several and not all say the same."""
    ours = [*specimen.evaluated.warnings, *specimen.recording.warnings, *_beside_machine(specimen)]
    shared = [set(each.evaluated.warnings) for each in specimens]
    return [w if all(w in each for each in shared) else f"{specimen.name}: {w}" for w in ours]


def _beside_machine(specimen: _Specimen) -> list[str]:
    """Warning where the machine's own modulus is another one."""
    for heading, text in specimen.recording.provenance.metadata.items():
        if heading.casefold().strip() not in _MACHINE:
            continue
        theirs, ours = number_in(text, "MPa", heading), specimen.evaluated.young.modulus_MPa
        if theirs and abs(ours / theirs - 1) > 0.01:
            return [f"the machine's own {heading} is {theirs:.6g} MPa: {100 * (theirs / ours - 1):+.1f} % from this"]
    return []


def _sources(specimens: Sequence[_Specimen]) -> list[dict[str, Any]]:
    """Each file once."""
    return list({s.recording.provenance.sha256: s.recording.provenance.as_dict() for s in specimens}.values())


def _merged(groups: Sequence[Mapping[str, Any]]) -> list[str]:
    return list(dict.fromkeys(warning for group in groups for warning in group["warnings"]))


def _first_only(labels: Sequence[str]) -> str:
    return f"modulus and model beside groups are those of {labels[0]} alone; groups holds all {len(labels)}"


def _drawn(groups: Sequence[Mapping[str, Any]], specimens: Sequence[_Specimen]) -> Any:
    from solen.report.resin.stiffness import stiffness_figure

    return stiffness_figure(groups, simulated=any(s.recording.provenance.simulated for s in specimens))
