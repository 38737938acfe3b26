"""Stiffness: modulus and hyperelastic model, with uncertainties, from testing-machine exports.

Force and displacement are converted to engineering stress and strain with the dimensions of the specimen, and the toe
is compensated. The slope over a specified range is the modulus, and one hyperelastic model of all tests of a material
is the input for a finite-element program.

`stiffness_of` evaluates recordings completely. `specimen_of` and `read_test` make a test; `evaluate` combines
`find_toe`, `young`, `cycles_of` and `extremes`; `mean_modulus` averages several specimens; `fit` and `choose` select a
model, and `cautions` returns warnings about its limitations.
"""

from solen.material.stiffness.cautions import cautions
from solen.material.stiffness.columns import read_test
from solen.material.stiffness.cycles import cycles_of, loading_branch, loading_curve, relative_to_last_cycle, softening
from solen.material.stiffness.evaluation import EvaluatedSpecimen, StiffnessOptions, evaluate, mean_modulus
from solen.material.stiffness.hyperelastic import Curve, Fit, choose, fit
from solen.material.stiffness.material import MaterialStiffness, MeasuredStiffness, MechanicalTest, stiffness_of
from solen.material.stiffness.models import KINDS, model
from solen.material.stiffness.modes import EQUIBIAXIAL, MODES, PLANAR, UNIAXIAL, Mode
from solen.material.stiffness.modulus import default_range, extremes, ideal_ratio, secant, young
from solen.material.stiffness.specimen import Dimensions, bonded_ratio, specimen_of
from solen.material.stiffness.stability import StableRange, margin, stable_range
from solen.material.stiffness.stress_strain import StressStrain, as_test
from solen.material.stiffness.toe import find_toe

__all__ = [
    "EQUIBIAXIAL",
    "KINDS",
    "MODES",
    "PLANAR",
    "UNIAXIAL",
    "Curve",
    "Dimensions",
    "EvaluatedSpecimen",
    "Fit",
    "MaterialStiffness",
    "MeasuredStiffness",
    "MechanicalTest",
    "Mode",
    "StableRange",
    "StiffnessOptions",
    "StressStrain",
    "as_test",
    "bonded_ratio",
    "cautions",
    "choose",
    "cycles_of",
    "default_range",
    "evaluate",
    "extremes",
    "find_toe",
    "fit",
    "ideal_ratio",
    "loading_branch",
    "loading_curve",
    "margin",
    "mean_modulus",
    "model",
    "read_test",
    "relative_to_last_cycle",
    "secant",
    "softening",
    "specimen_of",
    "stable_range",
    "stiffness_of",
    "young",
]
