"""Features of printed coupons (pillars, holes, gaps, steps): measured sizes from files, and sizes from the model.

Seen from above, the width of a feature is its maximum width, on the window side of a layer deep inside the part. The
dose of a round image blurred by a Gaussian is a one-dimensional integral, so a coupon is modelled without an image,
averaged over its positions between pixels (`Settings.edge_um`). A pillar is missing if even its centre receives less
than the critical dose; a hole is closed, and the pillars of a gap are merged, if its centre receives at least the
critical dose.

All features of an image share its scale, which a `MeasuredCoupon` therefore contains: a scale error is a single
unknown, not independent noise of each feature.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, Field
from scipy.optimize import elementwise
from scipy.special import i0e

from solen.arrays import FloatArray
from solen.errors import DataError, SolenError
from solen.fabricate.process.growth import Light, inside_light
from solen.fabricate.process.settings import Settings
from solen.recording import Provenance
from solen.recording.source import load
from solen.spec.objects import parse_json
from solen.spec.strict import NotNegative, Number, Strict, error_context

Kind = Literal["pillar", "hole", "gap", "step"]
Length = Annotated[float, Field(strict=True, gt=0, le=100)]
GAP_PILLAR_MM = 0.3
"""Default diameter of the two pillars of a gap, as in the published group B."""
UNIT_RATIO = 3.0
"""A median ratio of measured to drawn sizes within this factor of 1000 or 1/1000 suggests a wrong unit."""
_BLUR_WIDTHS = 6.5  # standard deviations at which a blur is cut off
_NODES = 28  # of the quadrature
_EDGE_TOLERANCES: Any = {"xatol": 1e-7, "xrtol": 0.0, "fatol": 0.0, "frtol": 0.0}  # in µm


@dataclass(frozen=True)
class MeasuredFeature:
    """A feature of a coupon.

    Attributes
    ----------
    kind
        Pillar or hole, whose size is its diameter; gap between two pillars; or step, whose size is its height.
    nominal_mm
        Drawn size.
    measured_mm, u_measured_mm
        Measured size and its standard uncertainty; None if the feature is missing.
    resolved
        Whether the pillar exists, the hole or gap is open, or the step is visible.
    diameter_mm
        Diameter of the two pillars of a gap.
    u_own_mm
        Standard uncertainty without that of the scale; None if it is not reported separately.
    """

    kind: Kind
    nominal_mm: Length
    measured_mm: Length | None
    u_measured_mm: Length | None
    resolved: Annotated[bool, Field(strict=True)]
    diameter_mm: Length = GAP_PILLAR_MM
    u_own_mm: Length | None = None

    def own_u_mm(self, u_scale: float) -> float:
        """Return the standard uncertainty without that of the scale: as reported, or by subtraction in quadrature.

        A total uncertainty below the contribution of the scale is treated as one that already excludes the scale.
        """
        if self.u_own_mm is not None:
            return self.u_own_mm
        u_mm, scale_mm = self.u_measured_mm or 0.0, (self.measured_mm or 0.0) * u_scale
        return math.sqrt(u_mm**2 - scale_mm**2) if scale_mm < u_mm else u_mm


class PixelScale(Strict):
    """Size of a pixel of the image in which features were measured."""

    model_config = ConfigDict(extra="ignore")
    error: ClassVar[type[SolenError]] = DataError

    um_per_px: Annotated[Number, Field(gt=0)]
    u_um_per_px: NotNegative | None = None


class _File(Strict):
    """A feature file; other keys, such as those of `solen print fidelity --out`, are ignored."""

    model_config = ConfigDict(extra="ignore")
    error: ClassVar[type[SolenError]] = DataError

    coupon: str = ""
    simulated: Annotated[bool, Field(strict=True)] = False
    features: tuple[MeasuredFeature, ...]
    scale: PixelScale | None = None
    pitch_ratio: Annotated[Number, Field(gt=0)] | None = None
    u_pitch_ratio: Annotated[Number, Field(gt=0)] | None = None
    z_um: Annotated[Number, Field(gt=0)] | None = None
    u_z_um: NotNegative | None = None


@dataclass(frozen=True)
class SharedScale:
    """A scale that all lengths of an image share: its value, and its relative standard uncertainty."""

    size_um: float | None = None
    u_relative: float | None = None

    @classmethod
    def of(cls, size_um: float | None, u_um: float | None) -> "SharedScale":
        """Return the scale for the size of a pixel and its standard uncertainty, both in µm; either may be unknown."""
        return cls(size_um, None if size_um is None or u_um is None else u_um / size_um)


@dataclass(frozen=True)
class MeasuredCoupon:
    """Features of an image or a height map.

    Attributes
    ----------
    features
        The features.
    lateral, vertical
        Scales of lengths and of heights.
    pitch_ratio, u_pitch_ratio
        Ratio of measured to drawn distances between features, and its standard uncertainty without that of the scale.
    source
        The file.
    """

    features: tuple[MeasuredFeature, ...]
    lateral: SharedScale = SharedScale()
    vertical: SharedScale = SharedScale()
    pitch_ratio: float | None = None
    u_pitch_ratio: float | None = None
    source: Provenance | None = None

    @property
    def name(self) -> str:
        """Name of the file."""
        return "coupon" if self.source is None else self.source.file


def read_features(path: Path) -> MeasuredCoupon:
    """Return the features in a JSON file, and their scale.

    The file is ``{"coupon": …, "simulated": …, "features": [{"kind": "pillar" | "hole" | "gap" | "step", "nominal_mm":
    …, "measured_mm": …, "u_measured_mm": …, "resolved": …}, …], "scale": {"um_per_px": …, "u_um_per_px": …}}``; a gap
    may have the ``diameter_mm`` of its pillars, and the file a ``pitch_ratio`` with its uncertainty.

    Raises
    ------
    DataError
        If the file is not a feature file, or contains an invalid feature.
    """
    source = load(path)
    data = parse_json(source.text(), str(path))
    if not isinstance(data, dict) or not isinstance(data.get("features"), list):
        raise DataError(str(path), limit='is not a feature file: it has no list "features"')
    _check_units(path, data["features"])
    with error_context(str(path)):
        file = _File(**data | {"features": [_without_unresolved(row) for row in data["features"]]})
    for number, feature in enumerate(file.features):
        if feature.measured_mm is not None and feature.u_measured_mm is None:
            limit = "is missing, but required to weight the measured size"
            raise DataError(f"{path}: features[{number}].u_measured_mm", limit=limit, remedy="add it")
    scale, metadata = file.scale, {"coupon": file.coupon}
    return MeasuredCoupon(
        file.features,
        SharedScale() if scale is None else SharedScale.of(scale.um_per_px, scale.u_um_per_px),
        SharedScale.of(file.z_um, file.u_z_um),
        file.pitch_ratio if file.u_pitch_ratio is not None else None,
        file.u_pitch_ratio,
        Provenance(source.name, source.sha256, "solen-features", metadata=metadata, simulated=file.simulated),
    )


def _check_units(path: Path, rows: list[Any]) -> None:
    """Raise `DataError` if measured and drawn sizes typically differ by a factor of about a thousand."""
    ratios = [
        float(measured) / float(nominal)
        for row in rows
        if isinstance(row, dict)
        for nominal, measured in [(row.get("nominal_mm"), row.get("measured_mm"))]
        if isinstance(nominal, int | float) and isinstance(measured, int | float) and nominal > 0.0 and measured > 0.0
    ]
    ratio = sorted(ratios)[len(ratios) // 2] if ratios else 1.0
    for factor, unit in ((1e3, "seems to be in µm"), (1e-3, "seems to be in metres, or nominal_mm in µm")):
        if abs(math.log(ratio / factor)) < math.log(UNIT_RATIO):
            limit = f"{unit}: it is typically {ratio:.3g} times nominal_mm"
            raise DataError(f"{path}: measured_mm", limit=limit, remedy="write all sizes in mm")


def _without_unresolved(row: Any) -> Any:
    """Return a row without its sizes if the feature is not resolved (such as a step of height 0)."""
    if not isinstance(row, dict):
        return row
    sizes = {key: row.get(key) if row.get("resolved") else None for key in ("measured_mm", "u_measured_mm", "u_own_mm")}
    return {key: value for key, value in row.items() if key != "diameter_mm" or value is not None} | sizes


def printed_mm(settings: Settings, features: Sequence[MeasuredFeature]) -> FloatArray:
    """Return the printed sizes (n,) of features in mm; NaN for features that are missing or closed."""
    sizes = np.full(len(features), np.nan)
    light = inside_light(settings)
    scale, wash = 1.0 - 0.01 * settings.shrinkage_percent, 2.0 * settings.wash_um
    for kind, solve, sign in (("pillar", _pillars, 1.0), ("hole", _holes, -1.0), ("gap", _gaps, -1.0)):
        indices = [i for i, feature in enumerate(features) if feature.kind == kind]
        if indices:
            nominal = np.array([1e3 * features[i].nominal_mm for i in indices])
            diameter = np.array([1e3 * features[i].diameter_mm for i in indices])
            sizes[indices] = 1e-3 * (scale * solve(nominal, diameter, light, settings.Ec_mJ_per_cm2) + sign * wash)
    for i, feature in enumerate(features):
        if feature.kind == "step":
            layers = round(1e3 * feature.nominal_mm / settings.layer_um)
            height = 1e-3 * layers * settings.layer_um * (1.0 - 0.01 * settings.shrinkage_z_percent)
            sizes[i] = height if layers else np.nan
    return np.where(sizes > 0.0, sizes, np.nan)


def disc(r_um: FloatArray, radius_um: FloatArray, sigma_um: FloatArray | float) -> FloatArray:
    """Return the light of a uniform disc blurred by a Gaussian, at distances from its centre; arguments are broadcast.

    The light is ∫ exp(-(r - ρ)²/2σ²) e^(-rρ/σ²) I₀(rρ/σ²) ρ dρ/σ² over the disc, by Gauss–Legendre quadrature within
    6.5 σ of r; at the centre, it is 1 - exp(-R²/2σ²).
    """
    nodes, weights = _quadrature()
    low = np.maximum(r_um - _BLUR_WIDTHS * sigma_um, 0.0)
    high = np.maximum(np.minimum(r_um + _BLUR_WIDTHS * sigma_um, radius_um), low)
    half = 0.5 * (high - low)
    rho = (low + half)[..., None] + half[..., None] * nodes
    r, sigma = r_um[..., None], np.asarray(sigma_um)[..., None]
    density = np.exp(-0.5 * ((r - rho) / sigma) ** 2) * i0e(r * rho / sigma**2) * rho / sigma**2
    return np.asarray(half * (density @ weights))


@lru_cache(maxsize=1)
def _quadrature() -> tuple[FloatArray, FloatArray]:
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    return nodes, weights


def _dose(r_um: FloatArray, radius_um: FloatArray, light: Light) -> FloatArray:
    """Return the dose at distances from the centres of lit discs."""
    doses, blurs = light
    return np.asarray(doses @ disc(r_um, radius_um, blurs[:, None]))


def _pillars(diameter: FloatArray, _: FloatArray, light: Light, critical: float) -> FloatArray:
    radius = 0.5 * diameter

    def excess(r: FloatArray, radius: FloatArray) -> FloatArray:
        return _dose(r, radius, light) - critical

    return 2.0 * _edge(excess, radius + _BLUR_WIDTHS * float(light[1].max()), radius)


def _holes(diameter: FloatArray, _: FloatArray, light: Light, critical: float) -> FloatArray:
    radius, full_dose = 0.5 * diameter, float(light[0].sum())

    def deficit(r: FloatArray, radius: FloatArray) -> FloatArray:
        return critical - (full_dose - _dose(r, radius, light))

    return 2.0 * _edge(deficit, radius + _BLUR_WIDTHS * float(light[1].max()), radius)


def _gaps(gap: FloatArray, diameter: FloatArray, light: Light, critical: float) -> FloatArray:
    radius, centre = 0.5 * diameter, 0.5 * (diameter + gap)

    def deficit(x: FloatArray, radius: FloatArray, centre: FloatArray) -> FloatArray:
        return critical - _dose(np.abs(centre - x), radius, light) - _dose(centre + x, radius, light)

    return 2.0 * _edge(deficit, centre, radius, centre)


def _edge(function: Callable[..., FloatArray], far: FloatArray, *arguments: FloatArray) -> FloatArray:
    """Return the distances at which a function, positive at the centre, falls to 0; NaN if that is beyond ``far``."""
    near = np.zeros_like(far)
    has_root = (function(near, *arguments) > 0.0) & (function(far, *arguments) < 0.0)
    edges = np.full(len(far), np.nan)
    if has_root.any():
        bracket, args = (near[has_root], far[has_root]), tuple(values[has_root] for values in arguments)
        edges[has_root] = elementwise.find_root(function, bracket, args=args, tolerances=_EDGE_TOLERANCES).x
    return edges
