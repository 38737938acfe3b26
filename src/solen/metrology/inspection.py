"""Inspection of a printed lens: its outline in an image, its deviations from the design, and the nearest design.

`measure_lens` compares an image with a design and returns a `LensInspection`; its `profile` can replace the lens of a
design.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtri

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.lens.profile import MeasuredProfile
from solen.metrology.comparison import ComparedDesign, compare, comparison_warnings, designs_to_compare
from solen.metrology.image import Image
from solen.metrology.nominal import NominalFront, SeenFrom, nominal_front
from solen.metrology.outline import EdgeChoice, NamedEdge, Outline, measure_outline
from solen.metrology.plausibility import resolution_warnings
from solen.metrology.print_fit import EDGE_BIAS_PX, U_SCALE, PrintFit, PrintPriors
from solen.metrology.raster import check_vision
from solen.metrology.scale import Scale, ScaleOptions
from solen.ranks import Caution, note, prefixed, warning
from solen.recording import Provenance
from solen.results import HIDDEN, Result, plain, reported
from solen.spec import Design

MAX_SIZE_CHANGE, SIGNIFICANT_SIGMAS = 0.01, 3.0
"""Relative size difference that causes a warning if it also exceeds this multiple of its standard uncertainty."""
FACES = {"sharper": "top", "softer": "bottom"}
MIN_STEP_MM = 1e-4
"""Distance in x below which points are treated as one."""


class InspectOptions(PrintPriors, ScaleOptions):
    """Options for the measurement of a lens in an image."""

    edge: EdgeChoice = "auto"
    """Edge of a thick transparent part to measure; auto selects the sharper one, or the outer one if neither is
    sharper.
    """
    seen_from: SeenFrom | None = None
    """Face that the image shows: top faces away from the build plate; bottom was on the plate and appears
    mirrored.
    """


@dataclass(frozen=True)
class FrontDeviation:
    """Deviations of a printed front from its design, positive outwards, with their uncertainty.

    The RMS deviation of a perfect print would equal the edge noise: ``rms_beyond_noise_um`` excludes it, and
    ``u_rms_um`` covers it. The largest of many deviations is biased by noise; its interval applies to all points
    simultaneously.

    Attributes
    ----------
    rms_um, u_rms_um
        RMS deviation and its standard uncertainty.
    rms_beyond_noise_um
        RMS deviation without the scatter of the edge.
    max_um, u_max_um, interval95_max_um
        Deviation of largest magnitude, with its sign, its standard uncertainty and its 95 % interval.
    max_x_mm
        Lateral position of that deviation.
    mean_um, highest_um, lowest_um, p95_um
        Mean and extremes of the deviations, and the 95th percentile of their absolute values.
    rms_of_u_um
        RMS of the points' standard uncertainties, including common shifts of the edge.
    rms_um_per_percent_of_scale
        RMS change of the deviations if the scale changes by 1 %.
    independent_values
        Number of independent values among the deviations.
    """

    rms_um: float
    u_rms_um: float
    rms_beyond_noise_um: float
    max_um: float
    u_max_um: float
    interval95_max_um: tuple[float, float]
    max_x_mm: float
    mean_um: float
    highest_um: float
    lowest_um: float
    p95_um: float
    rms_of_u_um: float
    rms_um_per_percent_of_scale: float
    independent_values: float

    @classmethod
    def of(cls, chosen: NamedEdge, image: Image) -> "FrontDeviation":
        """Return the deviations of the chosen edge."""
        fit = chosen.registration
        deviation, rms, bias = fit.deviation_um, fit.rms_um, EDGE_BIAS_PX * image.um_per_px
        scatter_um = chosen.edge.measured[1][fit.used] * image.um_per_px
        beyond = float(np.sqrt(max(rms**2 - float(np.mean(scatter_um**2)), 0.0)))
        noise = float(np.sqrt(np.mean(fit.u_um**2) / max(fit.independent_values, 1.0)))
        by_scale = float(np.mean(deviation * fit.by_scale_um)) / max(rms, 1e-9) * image.scale.u_relative
        worst = int(np.argmax(np.abs(deviation)))
        largest, u_max = float(deviation[worst]), float(np.hypot(fit.u_um[worst], bias))
        half = float(ndtri(1.0 - 0.025 / len(deviation))) * u_max
        return cls(
            rms_um=rms,
            u_rms_um=float(np.sqrt(noise**2 + by_scale**2 + bias**2 + (rms - beyond) ** 2)),
            rms_beyond_noise_um=beyond,
            max_um=largest,
            u_max_um=u_max,
            interval95_max_um=(largest - half, largest + half),
            max_x_mm=float(fit.points_mm[worst, 0]),
            mean_um=float(np.mean(deviation)),
            highest_um=float(deviation.max()),
            lowest_um=float(deviation.min()),
            p95_um=float(np.quantile(np.abs(deviation), 0.95)),
            rms_of_u_um=float(np.hypot(np.sqrt(np.mean(fit.u_um**2)), bias)),
            rms_um_per_percent_of_scale=fit.um_per_percent_of_scale,
            independent_values=fit.independent_values,
        )


@dataclass(frozen=True)
class EdgeSummary:
    """Key figures of one edge along the front.

    Attributes
    ----------
    name
        ``single``, ``outer``, ``inner``, ``sharper`` or ``softer``.
    chosen, in_focus
        Whether it is used as the outline, and whether it is clearly the sharpest.
    blur_px, contrast
        Medians along the edge.
    points_used
        Number of points.
    rms_um, mean_um
        RMS and mean of its deviations.
    outside_chosen_um
        Median distance from the chosen edge, positive outwards; None if no position has both edges.
    """

    name: str
    chosen: bool
    in_focus: bool
    blur_px: float
    contrast: float
    points_used: int
    rms_um: float
    mean_um: float
    outside_chosen_um: float | None

    @classmethod
    def of(cls, edge: NamedEdge, chosen: NamedEdge) -> "EdgeSummary":
        """Return the key figures of an edge relative to the chosen one."""
        fit, outside = edge.registration, edge.outside_um(chosen)
        return cls(
            name=edge.name,
            chosen=edge is chosen,
            in_focus=edge.sharpest,
            blur_px=edge.edge.blur,
            contrast=edge.edge.contrast,
            points_used=len(fit.used),
            rms_um=fit.rms_um,
            mean_um=float(np.mean(fit.deviation_um)),
            outside_chosen_um=float(np.median(outside)) if outside.size else None,
        )


class LensInspection(Result):
    """A printed lens in an image, measured against its design.

    Attributes
    ----------
    design
        Name of the design.
    simulated
        Whether the image was computed.
    scale
        Size of a pixel and its origin.
    deviation
        Deviation of the outline from the design.
    size
        Scale, shrinkage and uniform overgrowth, fitted together with the pose to the front and its walls.
    nearest
        Name of the most probable of the compared designs; None if the outline fits none of them.
    designs
        The compared designs by name, the most probable first.
    edges
        All edges along the front, the chosen one first.
    rotation_deg, u_rotation_deg
        Counter-clockwise rotation of the part in the image; 0 if its front faces down.
    vertex_px, u_shift_um
        (x, y) of the designed vertex, and standard uncertainties of the registration along the lens's x and z.
    mirrored
        Whether the image shows the part from its other side; None if the design is mirror-symmetric and the face is
        not specified.
    points_rejected
        Number of rejected points of the chosen edge, by reason.
    seen
        Fraction of the front that the image shows.
    measured_x_mm
        Lateral range that was measured.
    width_mm
        Width of the part just behind the front; None unless image and design show both walls.
    outline_mm
        Shape (N, 2): points of the chosen edge in lens coordinates.
    outline_deviation_um, u_outline_deviation_um
        Shape (N,): their deviations from the design, and standard uncertainties.
    sources
        The image.
    warnings
        Warnings.
    image, outline, nominal
        The image, its outline, and the designed front.
    """

    design: str
    simulated: bool
    scale: Scale
    deviation: FrontDeviation
    size: PrintFit
    nearest: str | None
    designs: dict[str, ComparedDesign]
    edges: tuple[EdgeSummary, ...]
    rotation_deg: float
    u_rotation_deg: float
    vertex_px: tuple[float, float]
    u_shift_um: tuple[float, float]
    mirrored: bool | None
    points_rejected: dict[str, int]
    seen: float
    measured_x_mm: tuple[float, float]
    width_mm: float | None
    outline_mm: FloatArray
    outline_deviation_um: FloatArray
    u_outline_deviation_um: FloatArray
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]
    image: Image = field(metadata=HIDDEN)
    outline: Outline = field(metadata=HIDDEN)
    nominal: NominalFront = field(metadata=HIDDEN)

    @reported
    def edge(self) -> EdgeSummary:
        """The chosen edge."""
        return self.edges[0]

    def profile(self) -> MeasuredProfile:
        """Return the chosen edge as a profile z(x); raise `DataError` if it folds back on itself.

        An edge that is in focus is assigned to the top face; a single edge, or one of two equally sharp edges, to the
        mean of both faces.
        """
        chosen = self.outline.chosen
        fit = chosen.registration
        order = np.argsort(fit.points_mm[:, 0], kind="stable")
        x, z = fit.points_mm[order].T
        distinct = np.concatenate([[True], np.diff(x) > MIN_STEP_MM])
        if distinct.mean() < 0.5:
            limit = "the outline folds back on itself, so it has more than one z at the same x"
            raise DataError(self.image.provenance.file, limit=limit, remedy="omit --out")
        return MeasuredProfile(
            x[distinct],
            z[distinct],
            1e-3 * fit.u_um[order][distinct],
            simulated=self.simulated,
            name=self.design,
            edge="top" if chosen.sharpest else FACES.get(chosen.name, "mean"),
            sources=tuple(plain(source) for source in self.sources),
            warnings=self.warnings,
        )


def measure_lens(
    image: Image,
    design: Design,
    *,
    edge: EdgeChoice = "auto",
    against: Sequence[Design] = (),
    priors: PrintPriors = PrintPriors(),
    seen_from: SeenFrom | None = None,
) -> LensInspection:
    """Measure a printed lens in an image against its design.

    Parameters
    ----------
    image
        The image, as `solen.metrology.read_image` reads it.
    design
        The design of the part.
    edge
        Edge to choose on a thick transparent part.
    against
        Other designs to compare with; by default the paper's three indices if the design has the paper's lens.
    priors
        Priors of the print's size and form.
    seen_from
        Face that the image shows.

    Raises
    ------
    DataError
        If the image shows no such lens, or the design has no lens.
    OutputError
        If the extra ``vision`` is not installed.
    """
    check_vision("solen print inspect")
    nominal = nominal_front(design, seen_from=seen_from)
    outline = measure_outline(image, nominal, edge, priors, seen_from)
    chosen = outline.chosen
    fit, bias_um = chosen.registration, EDGE_BIAS_PX * image.um_per_px
    designs = compare(chosen, designs_to_compare(design, nominal, against, seen_from), priors)
    # an edge bias with opposite signs on the left and on the right rotates the part
    u_turn_deg = np.degrees(2e-3 * bias_um / max(np.ptp(fit.points_mm[:, 0]), 1e-9))
    return LensInspection(
        design=design.name,
        simulated=image.provenance.simulated,
        scale=image.scale,
        deviation=FrontDeviation.of(chosen, image),
        size=chosen.size,
        nearest=designs[0].name if designs[0].possible else None,
        designs={design.name: design for design in designs},
        edges=tuple(EdgeSummary.of(edge, chosen) for edge in outline.edges),
        rotation_deg=(fit.pose.rotation_deg + 180.0) % 360.0 - 180.0,
        u_rotation_deg=float(np.hypot(fit.u_rotation_deg, u_turn_deg)),
        vertex_px=fit.pose.origin_px,
        u_shift_um=(float(np.hypot(fit.u_shift_um[0], bias_um)), float(np.hypot(fit.u_shift_um[1], bias_um))),
        mirrored=None if nominal.is_symmetric and seen_from is None else fit.pose.mirrored,
        points_rejected={reason: count for reason, count in chosen.edge.rejected.items() if count},
        seen=outline.seen,
        measured_x_mm=outline.ends_x_mm,
        width_mm=outline.width_mm,
        outline_mm=np.round(fit.points_mm, 7),
        outline_deviation_um=np.round(fit.deviation_um, 4),
        u_outline_deviation_um=np.round(fit.u_um, 4),
        sources=(image.provenance,),
        warnings=(
            *(*image.warnings, *resolution_warnings(image, nominal), *outline.warnings),
            *(*_size_warnings(image.scale, chosen), *comparison_warnings(designs, priors.form_um)),
        ),
        image=image,
        outline=outline,
        nominal=nominal,
    )


class FacesInspection(Result):
    """Both faces of a printed lens, each measured in its own image.

    Attributes
    ----------
    first_layer, last_layer
        The face that was on the build plate, and the opposite one, each compared with its layer of the design.
    """

    first_layer: LensInspection
    last_layer: LensInspection

    @reported
    def rms_um(self) -> dict[str, float]:
        """RMS deviation of each face."""
        return {"first_layer": self.first_layer.deviation.rms_um, "last_layer": self.last_layer.deviation.rms_um}

    @reported
    def overgrowth_difference_um(self) -> float:
        """Uniform overgrowth of the last layer minus that of the first."""
        return self.last_layer.size.overgrowth_um - self.first_layer.size.overgrowth_um

    @reported
    def u_overgrowth_difference_um(self) -> float:
        """Standard uncertainty of the difference; the effect of a common scale cancels."""
        last, first = self.last_layer.size, self.first_layer.size
        shared = last.by_scale_um * first.by_scale_um if self.last_layer.scale == self.first_layer.scale else 0.0
        return float(np.sqrt(last.u_overgrowth_um**2 + first.u_overgrowth_um**2 - 2.0 * shared))

    @reported
    def simulated(self) -> bool:
        """Whether either image was computed."""
        return self.first_layer.simulated or self.last_layer.simulated

    @property
    def warnings(self) -> tuple[Caution, ...]:
        """Warnings about each face."""
        faces = (("first layer", self.first_layer), ("last layer", self.last_layer))
        return tuple(prefixed(name, caution) for name, face in faces for caution in face.warnings)


def measure_faces(
    top: Image,
    bottom: Image,
    design: Design,
    *,
    edge: EdgeChoice = "auto",
    against: Sequence[Design] = (),
    priors: PrintPriors = PrintPriors(),
) -> FacesInspection:
    """Measure both faces of a printed lens.

    ``top`` is an image of the face away from the build plate, ``bottom`` of the face that was on it. The other
    parameters and the errors are those of `measure_lens`.

    Raises
    ------
    DataError
        If both images are the same.
    """
    if top.provenance.sha256 and top.provenance.sha256 == bottom.provenance.sha256:
        limit = f"is the same image as {top.provenance.file}"
        raise DataError(
            bottom.provenance.file, limit=limit, remedy="specify the image of the face that was on the plate"
        )
    return FacesInspection(
        measure_lens(bottom, design, edge=edge, against=against, priors=priors, seen_from="bottom"),
        measure_lens(top, design, edge=edge, against=against, priors=priors, seen_from="top"),
    )


def _size_warnings(scale: Scale, chosen: NamedEdge) -> list[Caution]:
    size, warnings = chosen.size, []
    if scale.u_um_per_px is None:
        warnings.append(
            warning(
                "the uncertainty of the scale is not specified (--u-um-per-px), so the uncertainties of the deviations "
                "do not include it: a scale error of 1 % changes the deviations by "
                f"{chosen.registration.um_per_percent_of_scale:.2g} µm RMS; scale and shrinkage are separated with an "
                f"assumed scale uncertainty of {100.0 * U_SCALE:g} %"
            )
        )
    change = size.size_factor - 1.0
    if abs(change) > MAX_SIZE_CHANGE and abs(change) > SIGNIFICANT_SIGMAS * size.u_size_factor:
        warnings.append(
            warning(
                f"apart from overgrowth, the outline is {100.0 * abs(change):.2f} % "
                f"{'larger' if change > 0.0 else 'smaller'} than designed: the scale is wrong, the print has shrunk "
                "or grown, or it was tilted; this image does not show the cause"
            )
        )
    if abs(size.overgrowth_um) > SIGNIFICANT_SIGMAS * size.u_overgrowth_um:
        warnings.append(
            note(
                f"all walls are displaced {'outwards' if size.overgrowth_um > 0.0 else 'inwards'} by "
                f"{abs(size.overgrowth_um):.3g} ± {size.u_overgrowth_um:.2g} µm"
            )
        )
    return warnings
