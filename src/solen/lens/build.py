"""The lens of a design."""

import hashlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TypeVar, cast

from solen.errors import DataError, DesignError
from solen.lens.base import Lens
from solen.lens.fitted_profile import FittedProfile
from solen.lens.in_space import LensInSpace
from solen.lens.layered import LayeredLens
from solen.lens.layers_file import LayeredLensFromFile, read_layers
from solen.lens.line_focus import LineFocusLens
from solen.lens.measured import MeasuredLens
from solen.lens.optics import FlatFace, OvalLens
from solen.lens.profile import MeasuredProfile, read_profile
from solen.lens.spline import DEFAULT_MIN_FEATURE_UM, DesignedLens, SplineLens
from solen.spec import Design

T = TypeVar("T")
DEFAULT_LAYER_MM = 0.025
"""Layer height if the design specifies none: that of the paper's printer."""


def lens_of(design: Design, index: float) -> Lens:
    """Return the lens of a design in a material of ``index`` (at the emitter's wavelength).

    The oval is shaped for ``lens.design_index`` if specified, else for the material's index; a spline deviates from the
    oval, and a measured lens combines its profile with an oval or a spline. Raise `DesignError` if the lens cannot
    work, and `DataError` if its file is not a profile.
    """
    spec, distance_mm = design.lens, design.emitter.distance_mm
    if spec.shape == "none":
        return FlatFace(distance_mm, spec.half_width_mm)
    if spec.design_index is None and index <= 1.0:
        raise DesignError(
            "the material's index",
            value=index,
            limit="must be above 1, the index of air, for the lens to focus",
            remedy="specify another material, or lens.design_index",
        )
    if spec.in_space:
        return _in_space(design, spec.design_index or index)
    oval = OvalLens(distance_mm, spec.focus_mm, spec.half_width_mm, spec.design_index or index)
    designed = oval if spec.knots_um is None else _spline(oval, spec.knots_um, spec.min_feature_um)
    if design.profile_file is None or spec.shape != "measured":
        return designed
    return measured_lens(designed, _of_file(design.profile_file, read_profile))


@lru_cache(maxsize=32)
def _spline(oval: OvalLens, knots_um: tuple[float, ...], min_feature_um: float | None) -> SplineLens:
    return SplineLens(oval, knots_um, DEFAULT_MIN_FEATURE_UM if min_feature_um is None else min_feature_um)


def _in_space(design: Design, index: float) -> LensInSpace:
    """Return a lens that varies with height."""
    spec, thickness_mm = design.lens, design.body.thickness_mm
    oval = (design.emitter.distance_mm, spec.focus_mm, spec.half_width_mm, index)
    if spec.shape == "layered" and design.profile_file is not None:
        profiles = _of_file(design.profile_file, read_layers)
        layer_mm = thickness_mm / len(profiles.z_mm)
        return LayeredLensFromFile(*oval, thickness_mm=thickness_mm, layer_mm=layer_mm, file=profiles)
    if spec.shape == "layered":
        return _layered(*oval, thickness_mm, DEFAULT_LAYER_MM if spec.layer_mm is None else spec.layer_mm)
    return _line_focus(*oval, thickness_mm, "body" if spec.y_focus_mm is None else spec.y_focus_mm)


@lru_cache(maxsize=32)
def _layered(distance: float, focus: float, half: float, index: float, thickness: float, layer: float) -> LayeredLens:
    return LayeredLens(distance, focus, half, index, thickness_mm=thickness, layer_mm=layer)


@lru_cache(maxsize=32)
def _line_focus(
    distance: float, focus: float, half: float, index: float, thickness: float, y_focus: float | str
) -> LineFocusLens:
    if isinstance(y_focus, str):
        collimated = LineFocusLens(distance, focus, half, index, thickness_mm=thickness)
        return collimated if y_focus == "collimated" else LineFocusLens.confining(collimated)
    return LineFocusLens(distance, focus, half, index, thickness_mm=thickness, y_focus_mm=y_focus)


@lru_cache(maxsize=32)
def measured_lens(designed: DesignedLens, profile: MeasuredProfile) -> MeasuredLens:
    """Return the designed lens with the deviation of a measured profile; cached, because smoothing takes time.

    Raises
    ------
    DesignError
        If too much of the lens is missing from the profile, or the profile belongs to another lens.
    """
    return MeasuredLens(FittedProfile(designed, profile))


def _of_file(path: Path, read: Callable[[Path], T]) -> T:
    """Return the content of a profile file, which is read again only if the file changes."""
    try:
        sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    except (OSError, ValueError):
        return read(path)  # raises with the reason
    return cast("T", _read(path, sha256, read))


@lru_cache(maxsize=32)
def _read(path: Path, sha256: str, read: Callable[[Path], object]) -> object:  # noqa: ARG001  part of the cache's key
    try:
        return read(path)
    except DataError as error:
        what = f"lens.profile: {error.what}"
        raise DataError(what, value=error.value, limit=error.limit, remedy=error.remedy) from None
