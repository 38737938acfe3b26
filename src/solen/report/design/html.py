"""The report: one self-contained HTML file with embedded figures."""

import math
import platform
import re
from collections.abc import Callable
from importlib.resources import files
from typing import Any

import jinja2
from markupsafe import Markup, escape
from matplotlib.figure import Figure

import solen
from solen.fabricate import SolidFiles
from solen.lens import DesignedLens, OvalLens
from solen.report import canvas
from solen.report.design.as_printed import printed_sentences
from solen.report.design.background import AnyStudy, budget_rows, findings, warnings
from solen.report.design.figures import (
    MAX_RAYS,
    effects_figure,
    rays_figure,
    sensor_view,
    study_figure,
)
from solen.report.design.lens import focus_figure, profile_figure
from solen.report.design.summary import advice, effect_rows, emitter_text, expected, lens_sentences, lens_table
from solen.report.print.as_printed import as_printed_figure
from solen.results import scalars
from solen.sensor import Case, DesignStudy
from solen.spec import dumps

FIGURES = {
    "lens-profile": "profile of the lens, z against x in mm",
    "response": "power at each receiver, and the contrast, against the driven quantity",
    "readings": "readings over each motion",
    "shape": "the body at rest and deformed, with its strain",
    "matters": "change of the contrast at each angle, for each parameter that deviates by its tolerance",
    "as-printed": "deviation of the printed lens, and the contrast with the printed and with the designed lens",
    "focus": "focus against the index of the material",
    "rays": "rays from the LED through the lens and the body to the receivers, in each position",
    "rays-at-the-lens": "the same rays near the LED and the lens",
    "rays-without-lens": "rays through the body without its lens",
}
"""All figures that a report may have, with their alternative texts; ``shape`` is for a soft body."""

NO_SOLID = SolidFiles({})


def figures(study: DesignStudy) -> dict[str, str]:
    """Return the figures of a study as SVG text, keyed by name; the design determines which of `FIGURES` exist."""
    rays = min(study.design.emitter.rays, MAX_RAYS)
    case = study.case
    angle_deg = case.power.angle_deg
    angles = sorted({float(angle_deg[0]), 0.0, float(angle_deg[-1])})
    draws: dict[str, Callable[[], Figure]] = {"response": lambda: study_figure(study)}
    if study.as_printed is not None:
        as_printed = study.as_printed
        draws["as-printed"] = lambda: as_printed_figure(as_printed)
    if study.practice is not None and study.practice.effects:
        practice = study.practice
        draws["matters"] = lambda: effects_figure(practice)
    if study.practice is not None and isinstance(case.sensor.cut, OvalLens):
        draws["focus"] = lambda: focus_figure(case.sensor)
    if isinstance(case.sensor.cut, DesignedLens):
        cut = case.sensor.cut
        draws["lens-profile"] = lambda: profile_figure(cut)
    views = [sensor_view(case.sensor, angle, rays) for angle in angles]
    draws["rays"] = lambda: rays_figure(views)
    if not case.sensor.is_drawn:
        draws["rays-at-the-lens"] = lambda: rays_figure(views, 1.5 * case.sensor.lens.half_width_mm)
    if study.with_lens is not None and study.no_lens is not None:
        without_lens = study.no_lens.sensor
        draws["rays-without-lens"] = lambda: rays_figure([sensor_view(without_lens, a, rays) for a in angles])
    return {name: canvas.svg(canvas.drawn(draws[name]), name) for name in FIGURES if name in draws}


def html(study: DesignStudy, drawn: dict[str, str], solid: SolidFiles = NO_SOLID) -> str:
    """Return the report as HTML text with its figures (``drawn``) and links to the part to print (``solid``)."""
    in_plane = study.design.trace.dimension == "2d"
    case = study.case
    return page(
        "report.html",
        study,
        drawn,
        solid,
        lead="simulated with the specified emitter" if in_plane else emitter_text(study),
        expected=expected(study),
        effect_rows=effect_rows(study.practice),
        lenses=lens_table(study.practice),
        lens_sentences=lens_sentences(study.practice),
        advice=advice(study),
        findings=findings(study),
        parts=_parts(study),
        summaries=[(label, vars(case.summary)) for label, case in _cases(study)],
        rows=range(len(case.power.angle_deg)),
        cases=_cases(study),
        budget=budget_rows(study),
        printed=[] if study.as_printed is None else printed_sentences(study.as_printed),
        rays=None if case.count is None else study.design.emitter.rays,
    )


def page(
    template: str,
    study: AnyStudy,
    drawn: dict[str, str],
    solid: SolidFiles,
    *,
    lead: str,
    expected: list[tuple[str, str]],
    **content: Any,
) -> str:
    """Return a report as HTML text: the content common to all reports, and that of a template."""
    return rendered(
        template,
        study=study,
        design=dumps(study.design),
        figures={name: inline(text, name, _alt(name, expected)) for name, text in drawn.items()},
        lead=lead,
        warnings=warnings(study),
        expected=expected,
        solid=solid,
        **content,
    )


def rendered(template: str, **content: Any) -> str:
    """Return the HTML text of a template of `solen.report`, in the common page style."""
    loader = jinja2.FunctionLoader(lambda name: (files("solen.report") / name).read_text(encoding="utf-8"))
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, loader=loader)
    environment.filters["shown"] = number_text
    return environment.get_template(template).render(
        version=solen.__version__, python=platform.python_version(), **content
    )


def _alt(name: str, expected: list[tuple[str, str]]) -> str:
    """Return the alternative text of a figure: its subject and, for the response, the first expected value."""
    subject = FIGURES.get(name, name)
    return f"{subject}; {expected[0][0]}: {expected[0][1]}" if name == "response" and expected else subject


def _parts(study: DesignStudy) -> dict[str, list[tuple[str, Any]]]:
    """Return the rows of the value tables, keyed by subject."""
    focus = next((focus for focus in study.foci if focus.step == 0.0), None)
    parts = {"material": study.material, "lens": study.lens, "focus": focus, "body": study.body}
    hidden = ("step", "by_uncertainty")
    tables = {
        name: [(key, value) for key, value in scalars(part) if value is not None and key not in hidden]
        for name, part in parts.items()
        if part is not None
    }
    if "material" in tables:
        tables["material"].insert(0, ("wavelength_nm", study.wavelength_nm))
    return tables


def number_text(value: Any) -> str:
    """Format a number with up to four decimals; a missing number as a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, float):
        return str(value)
    if not math.isfinite(value):
        return "–"
    if value != 0.0 and abs(value) < 1e-3:
        return f"{value:.1e}" if abs(value) > 1e-12 else "0"
    return f"{value:.4f}".rstrip("0").rstrip(".")


def _cases(study: DesignStudy) -> list[tuple[str, Case]]:
    with_lens = "with lens" if study.as_printed is None else f"lens {study.as_printed.label}"
    labels = {"lens": with_lens, "designed": "lens as designed", "no_lens": "no lens"}
    return [(labels[name], case) for name, case in study.cases.items()]


def inline(text: str, name: str, alt: str = "") -> Markup:
    """Return the SVG element of a file, with an alternative text and ids that are unique on the page."""
    element = text[text.index("<svg") :].replace("<svg", f'<svg role="img" aria-label="{escape(alt or name)}"', 1)
    for before, after in ((' id="', '"'), ("url(#", ")"), ('href="#', '"')):
        element = re.sub(f'({re.escape(before)})([^")]+)(?={re.escape(after)})', rf"\g<1>{name}-\g<2>", element)
    return Markup(element)  # noqa: S704  drawn by this package, not by a user
