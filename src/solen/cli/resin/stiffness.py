"""The command of mechanical tests: `solen resin stiffness`."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Out, show, text

_Files = Annotated[list[Path] | None, Parameter(negative=(), consume_multiple=True)]
_Texts = Annotated[list[str] | None, Parameter(negative=(), consume_multiple=True)]
_Numbers = Annotated[list[float] | None, Parameter(negative=(), consume_multiple=True)]


def stiffness(
    *files: Path,
    mode: str | None = None,
    compression: _Files = None,
    planar: _Files = None,
    biaxial: _Files = None,
    label: _Texts = None,
    cube_mm: float | None = None,
    length_mm: float | None = None,
    area_mm2: float | None = None,
    width_mm: float | None = None,
    thickness_mm: float | None = None,
    diameter_mm: float | None = None,
    u_geometry_mm: float | None = None,
    strain_range_percent: Annotated[tuple[float, float] | None, Parameter(negative=())] = None,
    secant_percent: _Numbers = None,
    toe: str = "auto",
    cycle: str = "first",
    fit: _Texts = None,
    weighting: str = "absolute",
    lubricated: Annotated[bool, Parameter(negative=())] = False,
    compliance_mm_per_n: float = 0.0,
    columns: _Texts = None,
    sheet: str | None = None,
    csv: Path | None = None,
    figure: FigureFile = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Modulus, cycles and a hyperelastic model from compression and tension tests.

    Parameters
    ----------
    files
        Exports of a testing machine or tables, a specimen each.
    mode
        What the files are: tension, compression, uniaxial (both, by their signs), planar or equibiaxial. Without it,
        the files' words and signs tell.
    compression
        Further files, of compression, fitted together with the others.
    planar
        Further files, of planar tension (pure shear).
    biaxial
        Further files, of equibiaxial tension.
    label
        The material: one for all files, or one for each in the order above. Specimens of one label are replicates.
    cube_mm
        Side of a compressed cube.
    length_mm
        Gauge length, or height in compression, that the displacement is divided by; overrules the file's strain.
    area_mm2
        Cross-section before the test.
    width_mm
        Its width, with --thickness-mm.
    thickness_mm
        Its thickness.
    diameter_mm
        Or its diameter.
    u_geometry_mm
        Standard uncertainty of each of these lengths.
    strain_range_percent
        From and to where the modulus is fitted, such as 0.05 0.25.
    secant_percent
        Strains at which stress over strain is wanted.
    toe
        auto (where strain is made of displacement and the machine set no zero at a preload), always or none.
    cycle
        first or last: whose loading gives modulus and model.
    fit
        auto (all models, for rubbers), all, none, or some of neo-hookean, mooney-rivlin, yeoh, ogden-1, ogden-2,
        ogden-3.
    weighting
        absolute or relative error of the stress in the fits.
    lubricated
        The ends of a compressed specimen slid on the platens.
    compliance_mm_per_n
        How far machine and fixture give way, in mm per N; taken off the displacement.
    columns
        Names of the columns of tables without a header, such as stress_MPa stretch.
    sheet
        Sheet of a workbook.
    csv
        Write engineering and true stress and strain of all specimens as a table.
    """
    from solen.material.stiffness import Dimensions
    from solen.pipeline.resin import stiffness as pipeline

    asked = pipeline.Request(
        files=files,
        compression=tuple(compression or ()),
        planar=tuple(planar or ()),
        equibiaxial=tuple(biaxial or ()),
        mode=mode,
        labels=tuple(label or ()),
        dimensions=Dimensions(length_mm, area_mm2, width_mm, thickness_mm, diameter_mm, cube_mm, u_geometry_mm),
        strain_range_percent=strain_range_percent,
        secant_percent=tuple(secant_percent or ()),
        toe=toe,
        cycle=cycle,
        fit=tuple(fit or ("auto",)),
        weighting=weighting,
        lubricated=lubricated,
        compliance_mm_per_N=compliance_mm_per_n,
        columns=None if columns is None else tuple(columns),
        sheet=sheet,
    )
    found = pipeline.stiffness(asked, out=out, figure=figure, csv=csv)
    show(found, as_json, lambda: list(_told(found)))


def _told(found: dict[str, Any]) -> Iterable[str]:
    """Lines for a reader."""
    for group in found["groups"] or [found]:
        yield from _of_material(group)
    for warning in found["warnings"]:
        yield f"warning: {warning}"
    for kind in ("out", "figure", "csv"):
        if kind in found:
            yield f"{kind}: {found[kind]}"


def _of_material(group: dict[str, Any]) -> Iterable[str]:
    low, high = group["strain_range_percent"]
    several = group["sd_modulus_MPa"] is not None
    spread = f", standard deviation {text(group['sd_modulus_MPa'])} MPa" if several else ""
    name = f"{group['label']}: " if group["label"] else ""
    yield (
        f"{name}modulus {text(group['modulus_MPa'])} ± {group['u_modulus_MPa']:.2g} MPa ({group['mode']}, "
        f"{low:g} to {high:g} % strain{spread})"
    )
    for each in group["specimens"]:
        yield f"  {each['name']}: {text(each['modulus_MPa'])} ± {each['u_modulus_MPa']:.2g} MPa; {_ends(each)}"
        yield f"    {each['toe']['said']}"
        yield from _of_cycles(each)
    chosen = group["model"]["kind"] if group["model"] else ""
    for each in group["fits"]:
        yield _of_fit(each, "*" if each["kind"] == chosen else " ")


def _ends(each: dict[str, Any]) -> str:
    """Strength and break of a specimen."""
    told = f"largest stress {text(each['strength_MPa'])} MPa at {text(100 * each['strain_at_strength'])} %"
    return told if each["strain_at_break"] is None else f"{told}, break at {text(100 * each['strain_at_break'])} %"


def _of_cycles(each: dict[str, Any]) -> Iterable[str]:
    for cycle in each["cycles"]:
        if cycle["loss_fraction"] is not None:
            left = cycle["residual_strain"]
            rest = "" if left is None else f", {text(100 * left)} % strain left"
            yield f"    cycle {cycle['number']}: {100 * cycle['loss_fraction']:.3g} % of the work lost{rest}"
    if each["softening"]:
        lost = each["softening"]
        yield f"    last of {lost['cycles']} cycles: peak stress {100 * lost['peak_stress']:.3g} % below the first"


def _of_fit(each: dict[str, Any], mark: str) -> str:
    parameters = ", ".join(f"{name} {value:.4g}" for name, value in each["parameters"].items())
    quality = "; ".join(f"{q['mode']} {q['rms_MPa']:.2g} MPa, R² {_digits(q['r_squared'])}" for q in each["modes"])
    stable = "" if each["stable_in_data"] else " UNSTABLE in its data"
    aicc = "" if each["aicc"] is None else f", AICc {each['aicc']:.1f}"
    return f"  {mark} {each['kind']}: {parameters}; E0 {each['initial_modulus_MPa']:.4g} MPa; {quality}{aicc}{stable}"


def _digits(r_squared: float | None) -> str:
    return "none" if r_squared is None else f"{r_squared:.4f}"
