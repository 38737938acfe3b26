"""Comparison of a printed outline with several designs: which is nearest, and how sure that is.

The idea: the outline is registered to each design in turn, and the residuals are compared. The deviations of a print
from its design are form, of unknown size and alike between neighbours, so a thousand pixels are not a thousand
witnesses. With m independent values among them (`solen.metrology.registration.effective_number`) less those that the
pose uses up, ν, and an unknown variance with Jeffreys' prior, the likelihood of a design goes as (Σ d²)^(−ν/2); see
A. Gelman and others, Bayesian Data Analysis, section 14.2, for the regression whose marginal likelihood this is. With
equal priors, these likelihoods over their sum are the posterior probabilities, among these designs alone.

An error of scale makes a lens larger and its curvature smaller, as another index does. For each design the scale at
which the outline would fit it best is therefore stated as well: a picture of a less certain scale decides nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solen.arrays import FloatArray
from solen.lens import OvalLens
from solen.metrology.edge import Edge
from solen.metrology.nominal import NominalFront, nominal_front
from solen.metrology.pose import Pose
from solen.metrology.registration import Registration, register
from solen.results import HIDDEN, reported
from solen.sensor import Sensor
from solen.spec import Design, with_values

SURE = 0.95
PARAMETERS = 3
"""Of a pose: a rotation and a shift."""
DOUBTFUL_SCALE = 0.03
"""Relative error of scale that a picture may well have where no uncertainty is stated."""
PAPER_INDICES = (1.44, 1.49, 1.54)
PAPER_MM = (1.0, 20.0, 2.0)
"""Emitter's distance, focus and half width of the paper's lenses."""


@dataclass(frozen=True, eq=False)
class ComparedDesign:
    """A design and how an outline fits it.

    Attributes
    ----------
    name
        Of the design.
    registration
        With the scale as stated.
    probability
        Of this design among those compared, with the scale as stated.
    """

    name: str
    registration: Registration = field(metadata=HIDDEN)
    probability: float

    @reported
    def rms_um(self) -> float:
        """Rms deviation with the scale as stated."""
        return self.registration.rms_um

    @reported
    def scale_factor(self) -> float:
        """Factor of scale at which the outline would fit this design best."""
        return self.registration.scale_factor

    @reported
    def scaled_rms_um(self) -> float:
        """Rms deviation at that scale."""
        return self.registration.scaled_rms_um


def designs_to_compare(design: Design, nominal: NominalFront, against: Sequence[Design] = ()) -> list[NominalFront]:
    """Nominal fronts to compare an outline with, each with a name of its own; the design's is always among them.

    Without others, those of the paper's three indices where the design has the paper's lens.
    """
    if against:
        return _distinct([nominal, *(nominal_front(other) for other in against)])
    lens = Sensor.of(design).cut
    if not isinstance(lens, OvalLens) or (lens.distance_mm, lens.focus_mm, lens.half_width_mm) != PAPER_MM:
        return [nominal]
    papers = [
        nominal_front(with_values(design, {"lens.design_index": index}), f"n = {index}") for index in PAPER_INDICES
    ]
    if any(abs(index - lens.design_index) < 1e-9 for index in PAPER_INDICES):
        return papers
    return [replace(nominal, name=f"n = {lens.design_index:.6g}"), *papers]


def _distinct(fronts: Sequence[NominalFront]) -> list[NominalFront]:
    """The same with a number behind a name that stands before."""
    names = [front.name for front in fronts]
    before = [names[:place].count(name) for place, name in enumerate(names)]
    return [
        replace(front, name=f"{front.name} ({count + 1})") if count else front
        for front, count in zip(fronts, before, strict=True)
    ]


def compare(edge: Edge, pose: Pose, fronts: Sequence[NominalFront], u_scale: float = 0.0) -> list[ComparedDesign]:
    """Designs with their probabilities, the nearest first.

    Parameters
    ----------
    edge
        The outline.
    pose
        First guess, good enough for each of the designs.
    fronts
        The nominal fronts, at least one.
    u_scale
        Relative standard uncertainty of the scale.
    """
    fits = [register(*edge.measured, pose, front, u_scale) for front in fronts]
    designs = [
        ComparedDesign(front.name, fit, float(probability))
        for front, fit, probability in zip(fronts, fits, _probabilities(fits), strict=True)
    ]
    return sorted(designs, key=lambda design: design.rms_um)


def _probabilities(fits: Sequence[Registration]) -> FloatArray:
    """Posterior probabilities, from the sums of squares of the points that all registrations use."""
    common = set.intersection(*(set(fit.used.tolist()) for fit in fits))
    squares = np.array([_mean_square(fit, common) for fit in fits])
    best = fits[int(np.argmin(squares))]
    freedom = max(best.independent - PARAMETERS, 1.0)
    weight = np.exp(-0.5 * freedom * np.log(np.maximum(squares, 1e-30) / max(float(squares.min()), 1e-30)))
    return np.asarray(weight / weight.sum())


def _mean_square(fit: Registration, common: set[int]) -> float:
    shared = np.isin(fit.used, list(common))
    return float(np.mean((fit.weights * fit.deviation_um**2)[shared] if shared.any() else fit.deviation_um**2))


def doubts(designs: Sequence[ComparedDesign], u_scale: float = 0.0) -> list[str]:
    """What the comparison does not show, in sentences."""
    if len(designs) < 2:
        return []
    first, second = designs[0], designs[1]
    rms = first.rms_um
    if first.probability < SURE:
        return [
            f"{first.name} and {second.name} cannot be distinguished: the outline deviates by {rms:.3g} and "
            f"{second.rms_um:.3g} µm (rms) from them, and neighbouring points are not independent "
            f"({first.registration.independent:.0f} independent values)"
        ]
    likely = 3.0 * u_scale if u_scale > 0.0 else DOUBTFUL_SCALE
    least = min(rms, first.scaled_rms_um)
    warnings = [
        f"were the scale {100.0 * (other.scale_factor - 1.0):+.1f} % off, {other.name} would be the nearest: "
        "an error of scale looks like another index"
        for other in designs[1:]
        if abs(other.scale_factor - 1.0) < likely and other.scaled_rms_um < least
    ]
    if rms > 0.5 * second.rms_um:
        warnings.append(f"the outline deviates by {rms:.3g} µm (rms) from {first.name}, the nearest: it is near none")
    return warnings
