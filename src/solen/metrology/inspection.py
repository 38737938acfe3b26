"""The measured front as a profile z(x), which a design takes for its lens."""

import numpy as np

from solen.errors import DataError
from solen.lens.measured import MeasuredProfile, profile_text
from solen.metrology.image import Image
from solen.metrology.outline import Outline

FACES = {"sharper": "top", "softer": "bottom"}
LEAST_STEP_MM = 1e-4
"""Points nearer each other than this in x are one."""


def front_profile(outline: Outline, image: Image, name: str, warnings: list[str]) -> str:
    """Text of the chosen edge's profile in lens coordinates; `DataError` where it folds back on itself.

    The edge that is in focus is called the top one; one alone, or two that are equally sharp, stand for the mean.
    """
    chosen = outline.chosen
    laid = chosen.registration
    order = np.argsort(laid.points_mm[:, 0], kind="stable")
    x, z = laid.points_mm[order].T
    u = 1e-3 * laid.u_um[order]
    apart = np.concatenate([[True], np.diff(x) > LEAST_STEP_MM])
    if apart.mean() < 0.5:
        limit = "folds back on itself, so it has no z for each x"
        raise DataError(image.provenance.file, limit=limit, remedy="leave out --out")
    edge = "top" if chosen.sharpest else FACES.get(chosen.name, "mean")
    profile = MeasuredProfile(
        x[apart],
        z[apart],
        u[apart],
        simulated=image.provenance.simulated,
        name=name,
        edge=edge,
        sources=(image.provenance.as_dict(),),
        warnings=tuple(warnings),
    )
    return profile_text(profile)
