"""Comparison of a printed outline with several designs: the nearest one, with probabilities.

The outline is fitted to each design in turn, together with everything that makes an entire print larger or smaller (see
`solen.metrology.print_fit`), so that neither a wrong scale nor overgrowth makes a wrong design the nearest. With equal
priors, the posterior probabilities are the marginal likelihoods divided by their sum; they apply to these designs
alone. Whether any of them explains the outline is a separate question, which `p_form` answers: if the residual form
error is larger than that of prints of the right design, none of the designs fits.

Public names: `designs_to_compare`, `compare` and `comparison_warnings`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solen.arrays import FloatArray
from solen.lens import OvalLens
from solen.metrology.nominal import NominalFront, SeenFrom, nominal_front
from solen.metrology.outline import NamedEdge
from solen.metrology.print_fit import PrintFit, PrintPriors, fit_print
from solen.metrology.registration import Registration, register
from solen.ranks import Caution, do_not_use, warning
from solen.results import HIDDEN, reported
from solen.sensor import Sensor
from solen.spec import Design, with_values

MIN_PROBABILITY = 0.95
MIN_P_FORM = 0.05
"""A design is ruled out if the form error of the outline has a lower probability for a print of this design."""
PAPER_INDICES = (1.44, 1.49, 1.54)
PAPER_MM = (1.0, 20.0, 2.0)
"""Emitter distance, focus and half width of the paper's lenses."""


@dataclass(frozen=True, eq=False)
class ComparedDesign:
    """A design and how well an outline fits it.

    Attributes
    ----------
    name
        Name of the design.
    registration
        Registration with the scale as specified and the size as designed.
    front_mm
        The front as designed, shape (n, 2).
    size
        Size, overgrowth and form of the print if it was made from this design.
    probability
        Probability of this design among those compared, marginalised over pose, scale, shrinkage, overgrowth and form.
    """

    name: str
    registration: Registration = field(metadata=HIDDEN)
    front_mm: FloatArray = field(metadata=HIDDEN)
    size: PrintFit
    probability: float

    @reported
    def rms_um(self) -> float:
        """RMS deviation with the scale as specified and the size as designed."""
        return self.registration.rms_um

    @property
    def possible(self) -> bool:
        """Whether the form error is plausible for a print of this design."""
        return self.size.p_form >= MIN_P_FORM


def designs_to_compare(
    design: Design, nominal: NominalFront, against: Sequence[Design] = (), seen_from: SeenFrom | None = None
) -> list[NominalFront]:
    """Return the nominal fronts to compare an outline with, under unique names; that of the design is always included.

    By default these are the paper's three indices if the design has the paper's lens.
    """
    if against:
        return _distinct([nominal, *(nominal_front(other, seen_from=seen_from) for other in against)])
    lens = Sensor.of(design).cut
    if not isinstance(lens, OvalLens) or (lens.distance_mm, lens.focus_mm, lens.half_width_mm) != PAPER_MM:
        return [nominal]
    papers = [
        nominal_front(with_values(design, {"lens.design_index": index}), f"n = {index}", seen_from)
        for index in PAPER_INDICES
    ]
    if any(abs(index - lens.design_index) < 1e-9 for index in PAPER_INDICES):
        return papers
    return [replace(nominal, name=f"n = {lens.design_index:.6g}"), *papers]


def _distinct(fronts: Sequence[NominalFront]) -> list[NominalFront]:
    """Return the fronts with unique names: a number is appended to each repeated name."""
    names = [front.name for front in fronts]
    counts = [names[:index].count(name) for index, name in enumerate(names)]
    return [
        replace(front, name=f"{front.name} ({count + 1})") if count else front
        for front, count in zip(fronts, counts, strict=True)
    ]


def compare(
    edge: NamedEdge, fronts: Sequence[NominalFront], priors: PrintPriors = PrintPriors()
) -> list[ComparedDesign]:
    """Fit the outline to each design; return the fits with the probabilities of the designs, the most probable first.

    Parameters
    ----------
    edge
        The outline, with a pose that is accurate to about a tenth of the lens's width for each of the designs.
    fronts
        The nominal fronts, at least one.
    priors
        Priors of the print's size and form.
    """
    traced, u_px = edge.traced, edge.edge.measured[1]
    fits = [fit_print(traced, front, priors) for front in fronts]
    independent = min(fits, key=lambda fit: fit.form_um).independent_values
    sizes = [fit_print(traced, front, priors, independent) for front in fronts]
    logs = np.array([size.log_evidence for size in sizes])
    weights = np.exp(logs - logs.max())
    designs = [
        ComparedDesign(
            front.name,
            register(traced.front_px, u_px, traced.pose, front, traced.u_scale or 0.0, size.on_front),
            front.front_mm,
            size,
            float(probability),
        )
        for front, size, probability in zip(fronts, sizes, weights / weights.sum(), strict=True)
    ]
    return sorted(designs, key=lambda design: -design.size.log_evidence)


def comparison_warnings(designs: Sequence[ComparedDesign], form_um: float) -> list[Caution]:
    """Return warnings if no design fits, or if the two most probable ones cannot be distinguished."""
    first = designs[0]
    if not any(design.possible for design in designs):
        unmatched = "none of these designs" if len(designs) > 1 else f"no normal print of {first.name}"
        return [
            do_not_use(
                f"the outline matches {unmatched}: after fitting size and overgrowth, the form error "
                f"is {first.size.form_um:.3g} µm RMS, whereas a print of the correct design has "
                f"about {form_um:g} µm (--form-um; probability {first.size.p_form:.2g})"
            )
        ]
    if len(designs) < 2 or first.probability >= MIN_PROBABILITY:
        return []
    second = designs[1]
    return [
        warning(
            f"{first.name} and {second.name} cannot be distinguished: after fitting size and overgrowth, "
            f"the outline deviates from them by {first.size.form_um:.3g} and {second.size.form_um:.3g} "
            f"µm RMS, and neighbouring points are correlated ({first.size.independent_values:.0f} "
            "independent values)"
        )
    ]
