"""Inspection of a printed lens: a picture and its design in; deviations, a profile and a figure out."""

from collections.abc import Sequence
from pathlib import Path

from solen import files
from solen.lens.profile import profile_text
from solen.metrology import InspectOptions, LensInspection, measure_lens, read_image
from solen.pipeline.design.designs import open_design
from solen.pipeline.outputs import check_outputs, drawn, named
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.spec import Design, with_values


def inspect(
    picture: Path,
    design: Path,
    options: InspectOptions = InspectOptions(),
    *,
    assignments: Sequence[str] = (),
    against: Sequence[Path] = (),
    figure: FigureOptions = FigureOptions(),
    out: Path | None = None,
) -> Outcome[LensInspection]:
    """Outline of a printed lens from a picture, its deviations from the design, and the nearest of several designs.

    Parameters
    ----------
    picture
        Any file that `solen.metrology.read_image` takes.
    design
        The design file of the part.
    options
        How it is measured.
    assignments
        ``key=value`` of the design.
    against
        Other design files that the outline is compared with; without any, the paper's three indices where the design
        has the paper's lens.
    figure, out
        Where to draw the result, and where to write the measured profile.

    Raises
    ------
    SolenError
        Where the picture has no scale or shows no such lens, the design has none, or a file cannot be written.
    """
    check_outputs(out, figure)
    part = open_design(design, assignments)
    image = read_image(picture, options=options)
    others = [_named_apart(open_design(path), part, path) for path in against]
    inspection = measure_lens(
        image, part, edge=options.edge, against=others, priors=options, seen_from=options.seen_from
    )
    contents = drawn(inspection, figure, "inspect")
    if out is not None:
        contents[out] = profile_text(inspection.profile()).encode()
    files.write_all(contents)
    return Outcome(inspection, named(out=out, figure=figure.figure))


def _named_apart(other: Design, part: Design, path: Path) -> Design:
    """A design that has the name of the part's is called by its file."""
    return with_values(other, {"name": path.stem}) if other.name == part.name else other
