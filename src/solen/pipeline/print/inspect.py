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
    """Measure a printed lens in an image: outline, deviations from the design, and the closest of several designs.

    With images of both faces, the first and the last layer are measured.

    Parameters
    ----------
    image
        A micrograph of the lens, viewed along y: TIFF, OME-TIFF, PNG, JPEG (requires the extra vision).
    design
        The design file of the part.
    bottom
        A micrograph of the face on the build plate, at the same scale; IMAGE is then that of the other face.
    against
        Another design file to compare with; repeatable. Default, for the lens of the paper: its three indices.

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
    others = [_with_unique_name(open_design(path), part, path) for path in against or ()]
    if bottom is not None:
        bottom_micrograph = read_image(bottom, options=options)
        faces = measure_faces(micrograph, bottom_micrograph, part, edge=options.edge, against=others, priors=options)
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
    """Raise `SpecError` for options that require a single image, or a lens that does not vary with height."""
    for option, value in (("--out", out), ("--seen-from", options.seen_from)):
        if bottom is not None and value is not None:
            raise SpecError(option, limit="applies to a single image", remedy=f"omit {option} or --bottom")
    if out is not None and part.lens.in_space:
        limit = "contains one profile for all heights, but this lens varies with height"
        raise SpecError("--out", limit=limit, remedy="omit it")


def _with_unique_name(other: Design, part: Design, path: Path) -> Design:
    """Return a compared design, renamed after its file if it has the same name as that of the part."""
    return with_values(other, {"name": path.stem}) if other.name == part.name else other
