"""The command for mechanical tests: `solen resin stiffness`."""

from collections.abc import Iterator

from solen.cli.app import lines, text
from solen.material.stiffness import EvaluatedSpecimen, Fit, MaterialStiffness, MeasuredStiffness
from solen.pipeline.resin.stiffness import stiffness as stiffness


@lines.register
def _(stiffness: MeasuredStiffness) -> Iterator[str]:
    for material in stiffness.materials:
        yield from _material_lines(material)


def _material_lines(material: MaterialStiffness) -> Iterator[str]:
    low, high = (100 * end for end in material.strain_range)
    sd = material.sd_modulus_MPa
    spread = "" if sd is None else f", standard deviation {text(sd)} MPa"
    name = f"{material.label}: " if material.label else ""
    yield (
        f"{name}modulus {text(material.modulus_MPa)} ± {material.u_modulus_MPa:.2g} MPa ({material.mode}, "
        f"{low:g} to {high:g} % strain{spread})"
    )
    for specimen in material.specimens:
        young = specimen.young
        yield f"  {specimen.name}: {text(young.modulus_MPa)} ± {young.u_modulus_MPa:.2g} MPa; {_extremes(specimen)}"
        yield f"    {specimen.toe.note}"
        yield from _cycle_lines(specimen)
    for fit in material.fits:
        is_chosen = material.model is not None and fit.kind == material.model.kind
        yield _fit_line(fit, "*" if is_chosen else " ")


def _extremes(specimen: EvaluatedSpecimen) -> str:
    """Return strength and strain at break of a specimen."""
    extremes = specimen.extremes
    strength = f"largest stress {text(extremes.strength_MPa)} MPa at {text(100 * extremes.strain_at_strength)} %"
    if extremes.strain_at_break is None:
        return strength
    return f"{strength}, break at {text(100 * extremes.strain_at_break)} %"


def _cycle_lines(specimen: EvaluatedSpecimen) -> Iterator[str]:
    for cycle in specimen.cycles:
        if cycle.loss_fraction is not None:
            strain = cycle.residual_strain
            residual = "" if strain is None else f", {text(100 * strain)} % residual strain"
            yield f"    cycle {cycle.number}: {100 * cycle.loss_fraction:.3g} % of the energy lost{residual}"
    if (softening := specimen.softening) is not None:
        peak = f"peak stress {100 * softening.peak_stress:.3g} % below that of the first"
        yield f"    last of {softening.cycles} cycles: {peak}"


def _fit_line(fit: Fit, mark: str) -> str:
    parameters = ", ".join(f"{name} {value:.4g}" for name, value in fit.parameters.items())
    quality = "; ".join(f"{q.mode} {q.rms_MPa:.2g} MPa, R² {_digits(q.r_squared)}" for q in fit.quality)
    stable = "" if fit.stable_in_data else " UNSTABLE within the data"
    aicc = "" if fit.aicc is None else f", AICc {fit.aicc:.1f}"
    return f"  {mark} {fit.kind}: {parameters}; E0 {fit.initial_modulus_MPa:.4g} MPa; {quality}{aicc}{stable}"


def _digits(r_squared: float | None) -> str:
    return "none" if r_squared is None else f"{r_squared:.4f}"
