"""Inspection of a printed lens: an image and its design as input; deviations, a profile and a figure as output."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import files
from solen.errors import SpecError
from solen.lens.profile import profile_text
from solen.metrology import FacesInspection, InspectOptions, LensInspection, measure_faces, measure_lens, read_image
from solen.pipeline.design.designs import open_design
from solen.pipeline.options import FLAT, Set
from solen.pipeline.outputs import check_outputs, drawn, named
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.spec import Design, with_values

Profile = Annotated[
    Path | None,
    Parameter(name="--out", help='Write the measured profile to this .json, for [lens] shape = "measured".'),
]


def inspect(
    image: Path,
    /,
    *,
    design: Path,
    options: Annotated[InspectOptions, FLAT] = InspectOptions(),
    bottom: Path | None = None,
    against: Annotated[list[Path] | None, Parameter(negative=())] = None,
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Profile = None,
) -> Outcome[LensInspection | FacesInspection]:
    """Measure a printed lens in an image: outline, deviations from the design, and the nearest of several designs.

    With images of both faces, the first and the last layer are measured.

    Parameters
    ----------
    image
        A micrograph of the lens, seen along y: TIFF, OME-TIFF, PNG, JPEG (needs the extra vision).
    design
        The design file of the part.
    bottom
        A micrograph of the face on the build plate, at the same scale; IMAGE then shows the other face.
    against
        Another design file to compare with; repeatable. Default: the paper's three indices, for the paper's lens.

    Raises
    ------
    SolenError
        If the image has no scale or shows no lens of that design, the design has no lens, or a file cannot be
        written.
    """
    check_outputs(out, figure)
    part = open_design(design, set_)
    _check_faces(part, options, bottom, out)
    micrograph = read_image(image, options=options)
    others = [_named_apart(open_design(path), part, path) for path in against or ()]
    if bottom is not None:
        other = read_image(bottom, options=options)
        faces = measure_faces(micrograph, other, part, edge=options.edge, against=others, priors=options)
        files.write_all(drawn(faces, figure, "inspect"))
        return Outcome(faces, named(figure=figure.figure))
    inspection = measure_lens(
        micrograph, part, edge=options.edge, against=others, priors=options, seen_from=options.seen_from
    )
    contents = drawn(inspection, figure, "inspect")
    if out is not None:
        contents[out] = profile_text(inspection.profile()).encode()
    files.write_all(contents)
    return Outcome(inspection, named(out=out, figure=figure.figure))


def _check_faces(part: Design, options: InspectOptions, bottom: Path | None, out: Path | None) -> None:
    """Raise `SpecError` for one-image options with two images, or for one profile if the lens varies with height."""
    for option, stated in (("--out", out), ("--seen-from", options.seen_from)):
        if bottom is not None and stated is not None:
            raise SpecError(option, limit="applies to a single image", remedy="leave it out, or --bottom")
    if out is not None and part.lens.in_space:
        limit = "describes one profile for all heights, but this lens varies with height"
        raise SpecError("--out", limit=limit, remedy="leave it out")


def _named_apart(other: Design, part: Design, path: Path) -> Design:
    """Label a compared design by its file name if it has the same design name as the part."""
    return with_values(other, {"name": path.stem}) if other.name == part.name else other
