"""A test's loading as a curve to fit: without its toe, from the cycle that is wanted, and no denser than it needs.

The idea: a fit should not know how often the machine sampled. A loading branch is averaged into steps of equal stretch,
at most fifty, and ends at its largest stress. A branch of a later cycle starts at the strain that the earlier ones
left; there the specimen's length and area are others, and stress and stretch are counted from them (incompressible, so
the area shrinks as the length grows).

The interface: `loading_curve` of a test; `rereferenced` counts a test from the end of its earlier cycles.
"""

from dataclasses import replace

import numpy as np

from solen.arrays import FloatArray
from solen.material.stiffness.cycles import cycles_of, loading_branch
from solen.material.stiffness.hyperelastic import Curve
from solen.material.stiffness.test import StressStrain

MOST = 50
"""Points of a curve to fit."""


def loading_curve(test: StressStrain, cycle: str = "first", toe_end: float = 0.0) -> Curve:
    """Loading branch of a test, first or last, as a curve to fit.

    Parameters
    ----------
    test
        Strains counted from where the toe's compensation puts zero, or as `rereferenced` does.
    cycle
        ``first`` or ``last``.
    toe_end
        Strain (magnitude) below which stresses are the toe's and are left out.
    """
    rows = loading_branch(test, cycle)
    stretch, stress = test.stretch[rows], test.stress_MPa[rows]
    if test.loading != "both":
        kept = test.sign * (stretch - 1) >= toe_end
        kept[int(np.argmax(test.sign * stress)) + 1 :] = False
        stretch, stress = stretch[kept], stress[kept]
    return Curve(test.mode, *_thinned(stretch, stress))


def rereferenced(test: StressStrain) -> StressStrain:
    """The same test with stress and strain per area and length at the start of its last cycle's loading.

    The start is where the cycle before left no stress; where that was not reached, or there is one cycle only, the test
    is returned as it is.
    """
    found = cycles_of(test)
    if len(found) < 2 or found[-2].residual_strain is None:
        return test
    left = 1 + test.sign * found[-2].residual_strain
    return replace(test, strain=test.stretch / left - 1, stress_MPa=test.stress_MPa * left)


def _thinned(stretch: FloatArray, stress: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means over steps of equal stretch, by rising stretch; the points themselves where they are few."""
    if len(stretch) <= MOST:
        order = np.argsort(stretch, kind="stable")
        return stretch[order], stress[order]
    edges = np.linspace(stretch.min(), stretch.max(), MOST + 1)
    step = np.clip(np.searchsorted(edges, stretch, side="right") - 1, 0, MOST - 1)
    count = np.bincount(step, minlength=MOST)
    filled = count > 0
    means = [np.bincount(step, weights=values, minlength=MOST)[filled] / count[filled] for values in (stretch, stress)]
    return means[0], means[1]
