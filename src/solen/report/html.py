"""The report: one HTML file with its figures inside, which opens offline."""

import platform
from importlib.resources import files
from typing import Any

import jinja2
from markupsafe import Markup

import solen
from solen.lens import OvalLens
from solen.report.figures import SHOWN_RAYS, profile_figure, rays_figure, response_figure, sensor_view, svg
from solen.report.results import results, summary
from solen.report.words import findings, headline
from solen.sensor import Case, Study
from solen.spec import dumps


def figures(study: Study) -> dict[str, str]:
    """SVG texts of all figures of a study, by file name without ending."""
    first, last = study.design.motion.from_deg, study.design.motion.to_deg
    rays = min(study.design.emitter.rays, SHOWN_RAYS)
    drawn = {}
    case = study.case
    if isinstance(case.sensor.lens, OvalLens):
        drawn["lens-profile"] = profile_figure(case.sensor.lens)
    drawn["response"] = response_figure(_pair(study.lens), _pair(study.flat))
    drawn["rays"] = rays_figure([sensor_view(case.sensor, angle, rays) for angle in (first, 0.0, last)])
    zoom_mm = 1.5 * case.sensor.lens.half_width_mm
    drawn["rays-at-the-lens"] = rays_figure([sensor_view(case.sensor, a, rays) for a in (first, 0.0, last)], zoom_mm)
    if study.lens is not None:
        drawn["rays-without-lens"] = rays_figure([sensor_view(study.flat.sensor, a, rays) for a in (first, 0.0, last)])
    return {name: svg(figure, name) for name, figure in drawn.items()}


def html(study: Study, drawn: dict[str, str]) -> str:
    """HTML text of the report; ``drawn`` are its figures as `figures` returns them."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.filters["shown"] = shown
    template = environment.from_string((files("solen.report") / "report.html").read_text(encoding="utf-8"))
    case = study.case
    return template.render(
        study=study,
        headline=headline(study),
        findings=findings(study),
        figures={name: _inline(text) for name, text in drawn.items()},
        results=results(study),
        summaries=[(label, summary(one)) for label, one in _cases(study)],
        rows=range(len(case.power.angle_deg)),
        cases=_cases(study),
        design=dumps(study.design),
        rays=study.design.emitter.rays,
        version=solen.__version__,
        python=platform.python_version(),
    )


def shown(value: Any) -> str:
    """A number as one reads it, to four places; a missing one as a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, float):
        return str(value)
    if value != 0.0 and abs(value) < 1e-3:
        return f"{value:.1e}" if abs(value) > 1e-12 else "0"
    return f"{value:.4f}".rstrip("0").rstrip(".")


def _cases(study: Study) -> list[tuple[str, Case]]:
    cases = [("with lens", study.lens), ("no lens", study.flat)]
    return [(label, case) for label, case in cases if case is not None]


def _pair(case: Case | None) -> Any:
    return None if case is None else (case.counted, case.power)


def _inline(text: str) -> Markup:
    """SVG element without the XML and document-type lines that a file needs and a page does not."""
    return Markup(text[text.index("<svg") :])  # noqa: S704  drawn by this package, not by a user
