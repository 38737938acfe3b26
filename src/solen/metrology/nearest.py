"""Which of several designs a printed outline is nearest to, and how sure that is.

The idea: the outline is laid on each design in turn, and what is left is compared. The distances of a print from its
design are form, of unknown size and alike between neighbours, so a thousand pixels are no thousand witnesses. With m
independent values among them (`solen.metrology.register.effective_number`) less those that the pose uses up, ν, and an
unknown variance that has Jeffreys' prior, the likelihood of a design goes as (Σ d²)^(−ν/2); see A. Gelman and others,
Bayesian Data Analysis, section 14.2, for the regression whose marginal likelihood this is. With equal chances before,
these likelihoods over their sum are the chances after, among the designs asked for and no others.

An error of scale makes a lens larger and its curvature smaller, as another index does. Each design therefore says as
well at which scale the outline would lie best on it: a picture whose scale is not known that well decides nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.metrology.find import Pose
from solen.metrology.ideal import Ideal
from solen.metrology.register import Registration, register

SURE = 0.95
PARAMETERS = 3
"""Of a pose: a rotation and a shift."""
DOUBTFUL_SCALE = 0.03
"""Relative error of scale that a picture may well have where nobody states one."""


@dataclass(frozen=True)
class Rival:
    """A design and how an outline lies on it.

    Attributes
    ----------
    name
        Of the design.
    registration
        With the scale as stated.
    probability
        Chance of this design among those asked for, with the scale as stated.
    scale_factor, scaled_rms_um
        Factor of scale at which the outline would lie best on this design, and the rms distance then.
    """

    name: str
    registration: Registration
    probability: float
    scale_factor: float
    scaled_rms_um: float


def nearest(
    points_px: FloatArray, u_px: FloatArray, pose: Pose, ideals: Sequence[Ideal], u_scale: float = 0.0
) -> list[Rival]:
    """Designs with their probabilities, the nearest first.

    Parameters
    ----------
    points_px, u_px
        The outline as for `solen.metrology.register.register`.
    pose
        A first pose, good enough for each of the designs.
    ideals
        The designs, at least one.
    u_scale
        Relative standard uncertainty of the scale.
    """
    fixed = [register(points_px, u_px, pose, ideal, u_scale) for ideal in ideals]
    free = [register(points_px, u_px, pose, ideal, u_scale, scaled=True) for ideal in ideals]
    rivals = [
        Rival(ideal.name, one, float(probability), one.scale_factor, other.rms_um)
        for ideal, one, other, probability in zip(ideals, fixed, free, _probabilities(fixed), strict=True)
    ]
    return sorted(rivals, key=lambda rival: rival.registration.rms_um)


def _probabilities(found: Sequence[Registration]) -> FloatArray:
    """Chances after, from the sums of squares of the points that all registrations use."""
    common = set.intersection(*(set(one.used.tolist()) for one in found))
    squares = np.array([_sum_of_squares(one, common) for one in found])
    best = found[int(np.argmin(squares))]
    freedom = max(best.independent - PARAMETERS, 1.0)
    exponent = -0.5 * freedom * np.log(np.maximum(squares, 1e-30) / max(float(squares.min()), 1e-30))
    weight = np.exp(exponent)
    return np.asarray(weight / weight.sum())


def _sum_of_squares(one: Registration, common: set[int]) -> float:
    shared = np.isin(one.used, list(common))
    return float(np.mean((one.weights * one.off_um**2)[shared] if shared.any() else one.off_um**2))


def cautions(rivals: Sequence[Rival], u_scale: float = 0.0) -> list[str]:
    """What the comparison does not show, in sentences."""
    if len(rivals) < 2:
        return []
    first, second = rivals[0], rivals[1]
    rms = first.registration.rms_um
    if first.probability < SURE:
        return [
            f"{first.name} and {second.name} cannot be told apart: the outline is {rms:.3g} and "
            f"{second.registration.rms_um:.3g} µm (rms) from them, and neighbouring points are not independent "
            f"({first.registration.independent:.0f} independent values)"
        ]
    likely = 3.0 * u_scale if u_scale > 0.0 else DOUBTFUL_SCALE
    least = min(rms, first.scaled_rms_um)
    found = [
        f"were the scale {100.0 * (other.scale_factor - 1.0):+.1f} % off, the outline would be nearest to "
        f"{other.name}: an error of scale looks like another index"
        for other in rivals[1:]
        if abs(other.scale_factor - 1.0) < likely and other.scaled_rms_um < least
    ]
    if rms > 0.5 * second.registration.rms_um:
        found.append(
            f"the outline is {rms:.3g} µm (rms) from {first.name}, the nearest design: it is near to none of them"
        )
    return found
