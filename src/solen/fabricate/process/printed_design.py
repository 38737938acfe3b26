"""Predicted print of a design: the printed lens, its walls, the entire part, and a profile for tracing."""

from dataclasses import dataclass, field, replace

import numpy as np

from solen.arrays import FloatArray
from solen.fabricate.label import Label
from solen.fabricate.mesh import Mesh
from solen.fabricate.process.compensate import Compensation
from solen.fabricate.process.predict import Orientation, Phase, Prediction
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.target import Deviation
from solen.lens.profile import MeasuredProfile, profile_of
from solen.ranks import Caution, warning
from solen.recording import Provenance
from solen.results import HIDDEN, Result, plain, reported
from solen.sensor.print_loss import PrintLoss

PROFILE_POINTS = 401
U_NUMERICAL_UM = 0.1
"""Standard uncertainty of a point due to the numerical error of the model."""


@dataclass(frozen=True)
class Ripple:
    """Ripple due to layers: along the thickness for a flat part, otherwise along the profile."""

    along: str
    peak_to_valley_um: float
    rms_um: float | None


@dataclass(frozen=True, eq=False)
class Walls:
    """Straight walls of a part printed flat, layer by layer.

    Attributes
    ----------
    height_um, beyond_um
        Mid-heights of the layers (n,), and the growth of a wall beyond its image at each of them, without shrinkage.
    """

    height_um: FloatArray = field(metadata=HIDDEN)
    beyond_um: FloatArray = field(metadata=HIDDEN)

    @reported
    def layers(self) -> int:
        """Number of layers."""
        return len(self.beyond_um)

    @reported
    def first_um(self) -> float:
        """Growth of a wall beyond its image at the first layer."""
        return float(self.beyond_um[0])

    @reported
    def middle_um(self) -> float:
        """Growth of a wall beyond its image at mid-thickness."""
        return float(self.beyond_um[self.layers // 2])

    @reported
    def last_um(self) -> float:
        """Growth of a wall beyond its image at the last layer."""
        return float(self.beyond_um[-1])


@dataclass(frozen=True)
class Shape:
    """Deviation that remains after the best translation along z."""

    shift_z_um: float
    rms_um: float
    largest_um: float


@dataclass(frozen=True, eq=False)
class PrintedPart:
    """The entire part as printed flat, and its printed and designed volumes."""

    mesh: Mesh = field(metadata=HIDDEN)
    label: Label = field(metadata=HIDDEN)
    printed_mm3: float
    designed_mm3: float
    triangles: int
    slabs: int


class PrintedDesign(Result):
    """Prediction of a design as a process prints it.

    Attributes
    ----------
    name, simulated
        Name of the design; a prediction is always simulated.
    orientation, profile_at
        Orientation of the part, and description of the profile height.
    process, settings
        Name and values of the process.
    lens
        The printed lens.
    phase
        Best position of the lens in its pixel, and the improvement; None if it was not computed.
    deviation
        Deviation from the designed lens, along its normal; positive for additional material.
    u_rms_um, u_max_um
        RMS and maximum, along the lens, of the standard uncertainty of the deviation.
    shape
        Deviation after the best translation along z.
    ripple, walls
        Ripple due to layers, and straight walls of a part printed flat.
    contributions_um
        Contribution of each uncertain parameter to the uncertainty, RMS along the lens, in descending order.
    response
        Responses with the designed and the printed lens, and the loss; None if they were not traced.
    compensation, compensated_response
        Drawing that prints as designed, and responses with the lens printed from it; None without compensation.
    part
        The entire printed part; None if it was not computed.
    sources, warnings
        Process file, and limits of the conclusions.
    """

    name: str
    simulated: bool
    orientation: Orientation
    profile_at: str
    process: str
    settings: Settings
    lens: Prediction = field(metadata=HIDDEN)
    phase: Phase | None
    deviation: Deviation
    u_rms_um: float
    u_max_um: float
    shape: Shape
    ripple: Ripple
    walls: Walls | None
    contributions_um: dict[str, float]
    response: PrintLoss | None
    compensation: Compensation | None
    compensated_response: PrintLoss | None
    part: PrintedPart | None
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]

    @reported
    def cure_depth_um(self) -> float:
        """Cure depth of one exposure of a normal layer."""
        return self.settings.cure_depth_um

    @reported
    def inside_mJ_per_cm2(self) -> float:
        """Mean dose deep inside the part."""
        return self.settings.inside_mJ_per_cm2()

    @property
    def profile(self) -> MeasuredProfile:
        """Profile of the printed lens, in the form of ``lens.profile`` of a design."""
        return self._profile(self.deviation)

    @property
    def compensated_profile(self) -> MeasuredProfile | None:
        """Profile of the lens printed from the compensated drawing."""
        return None if self.compensation is None else self._profile(self.compensation.printed)

    def _profile(self, deviation: Deviation) -> MeasuredProfile:
        return profile_of_print(deviation, self.name, self.process, self.u_rms_um, self.sources)


def profile_of_print(
    deviation: Deviation, name: str, process: str, u_um: float, sources: tuple[Provenance, ...] = ()
) -> MeasuredProfile:
    """Return the profile of a printed lens, marked as simulated.

    Its ``u_mm`` is the uncertainty that is independent from point to point. The uncertainty of the process, ``u_um``,
    is common to all points and is reported in a warning: treated as noise of individual points, it would cause too much
    smoothing of the profile.
    """
    points = deviation.points_mm
    chosen = np.unique(np.linspace(0, len(points) - 1, PROFILE_POINTS).round().astype(int))
    x, z = _advancing(points[chosen]).T
    profile = profile_of(
        x,
        z,
        1e-3 * U_NUMERICAL_UM,
        name=f"{name}, printed by the model",
        simulated=True,
        edge="predicted",
        sources=tuple(plain(source) for source in sources),
    )
    warnings = (
        warning(f"predicted by a print model ({process}), not measured"),
        warning(
            f"the uncertainty of the process, {u_um:.2g} µm RMS along the lens, is common to all points and not "
            "included in u_mm"
        ),
    )
    return replace(profile, warnings=warnings)


def _advancing(points: FloatArray) -> FloatArray:
    """Return the points (N, 2) to the right of all previous points."""
    rightmost = np.concatenate([[-np.inf], np.maximum.accumulate(points[:-1, 0])])
    return points[points[:, 0] > rightmost + 1e-9]
