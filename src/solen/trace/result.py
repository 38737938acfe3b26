"""Results of traces by any method: detectors, monitors, ledger, and paths if stored.

All powers are fractions of the emitted power. The four parts of the ledger add up to 1: the power **detected** by
receivers, the power that **escaped** to infinity, the power **absorbed** by media, walls and the backs of receivers,
and the power **truncated**. The truncated power consists of branches below the minimum weight, rays that have met the
maximum number of interfaces (both counted in ``truncated``), and rays that met an interface from a medium other than
their own (counted in ``undefined``). The first locations of each kind are stored.

Every power has an uncertainty ``u_power``, however the rays were chosen: a standard error for independent samples, an
error estimate for a fan and for adaptive integration.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.curve import END_TOLERANCE_MM, check_count
from solen.errors import DesignError
from solen.plane import Point
from solen.results import HIDDEN, Result, reported

if TYPE_CHECKING:
    import xarray as xr

Method = Literal["fan", "sobol", "adaptive"]
Mode = Literal["count", "power", "roulette"]
MODES: tuple[Mode, ...] = get_args(Mode)

GOES_ON, DETECTED, ESCAPED, ABSORBED, TRUNCATED = range(5)
FATES = ("goes on", "detected", "escaped", "absorbed", "truncated")

SEGMENT_FIELDS = np.dtype(
    [(name, np.int64) for name in ("ray", "branch", "parent", "hit", "interface", "fate")]
    + [
        (name, np.float64)
        for name in ("x_mm", "z_mm", "dx", "dz", "length_mm", "power_s", "power_p", "kept", "optical_path_mm")
    ]
)
"""Fields of a ray segment: its ray; its branch; the parent from which that branch was split off (−1 for none); the
number of interfaces met before; the interface at its end (−1 for none); the fate there; start; direction; length
(infinite if it escapes); the power at its start as a fraction of the emitted power; the fraction of that power that
remains at its end; and the optical path length from the source to its start. A trace stores segments in order of ray,
branch and hit. Branch numbers depend on the tracer, but a parent always precedes its children.
"""

CORNER_MM = 2 * END_TOLERANCE_MM
"""Distance by which a ray that has just met a corner is moved past the end of the other curve at that corner."""
MAX_LOCATIONS = 16
"""Maximum number of locations that a trace stores for undefined rays, and for truncated rays."""


def check_choice(what: str, value: object, choices: tuple[str, ...]) -> None:
    """Raise `DesignError` if a value is not one of the choices."""
    if value not in choices:
        raise DesignError(what, value=value, limit=f"must be one of {', '.join(choices)}")


def check_mode(mode: object) -> None:
    """Raise `DesignError` for an unknown mode."""
    check_choice("mode", mode, MODES)


@dataclass(frozen=True)
class Limits:
    """Limits for following a ray.

    ``min_weight`` is the power below which a branch is truncated, as a fraction of the launch power of its ray;
    ``max_hits`` is the maximum number of interfaces that a ray may meet on one path.
    """

    min_weight: float = 1e-6
    max_hits: int = 10_000

    def __post_init__(self) -> None:
        if not 1e-15 <= self.min_weight < 1.0:
            raise DesignError("min_weight", value=self.min_weight, limit="must be from 1e-15 to below 1")
        check_count("max_hits", self.max_hits, 1)


@dataclass(frozen=True)
class Ledger:
    """Fractions of the emitted power by fate; the four fractions add up to 1."""

    detected: float
    escaped: float
    absorbed: float
    truncated: float

    @property
    def total(self) -> float:
        """Sum of the four fractions, which is 1 to within rounding error."""
        return self.detected + self.escaped + self.absorbed + self.truncated


UNKNOWN = Ledger(math.nan, math.nan, math.nan, math.nan)
"""Uncertainties of a ledger if they are unknown: all are NaN."""


class Detected(Result):
    """Reading of a receiver; powers are fractions of the emitted power.

    Attributes
    ----------
    power, u_power
        Detected power and its uncertainty, which is NaN for a single ray.
    rays
        Number of rays or branches that arrived; after adaptive integration, the total number of rays.
    power_by_source
        Power from each source in the scene.
    optical_path_mm
        Power-weighted mean optical path length of the light that arrived; NaN if none did.
    power_by_position
        (interfaces of the receiver, bins) power in equal bins of the parameter of each interface, from its start to its
        end; empty unless bins were requested.
    power_by_angle
        (bins,) power in equal bins of the angle of incidence from −90 to 90 degrees, positive if light travels towards
        the end of the interface; empty unless bins were requested.
    """

    power: float
    u_power: float
    rays: int
    power_by_source: tuple[float, ...] = ()
    optical_path_mm: float = math.nan
    power_by_position: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    power_by_angle: FloatArray = field(default_factory=lambda: np.empty(0))


class Crossed(Result):
    """Reading of a monitor: net power towards its left, uncertainty, number of crossings, and net power by bin (N,)."""

    power: float
    u_power: float
    rays: int
    power_by_bin: FloatArray


class Path(Result):
    """Path of one branch: its vertices (N, 2), the indices of the interfaces met, its initial power and its fate.

    ``parent`` is the branch of the same ray from which this branch was split off, or −1 for the launched ray itself.
    ``exit_direction`` is the unit direction after the last vertex of a branch that escaped.
    """

    ray: int
    branch: int
    parent: int
    points_mm: FloatArray
    interfaces: tuple[int, ...]
    power: float
    fate: str
    exit_direction: Point | None = None


class Trace(Result):
    """Result of tracing a scene.

    ``method`` specifies how the rays were chosen: ``"fan"`` (uniformly), ``"sobol"`` (sixteen independent scrambled
    Sobol' samples) or ``"adaptive"``. ``truncated`` is the number of truncated branches, and ``truncated_at_mm``
    contains the first of their locations. Adaptive integration also reports the number of ``pieces`` and whether the
    tolerance was ``reached``; if not, ``why`` gives the reason, and the powers do not include the part that was not
    integrated.
    ``single_error`` is the largest difference in receiver power between single and double precision, for a subset of
    the rays. In an extruded scene, ``missed`` and ``leaked`` are the parts of the escaped power that passed above or
    below all bodies, and that left bodies through their top or bottom. ``reflected`` is the power reflected by the face
    of a lens that varies with height, whatever its subsequent fate, and 0 for any other face. ``u_ledger``,
    ``u_missed`` and ``u_leaked`` are the uncertainties, NaN if unknown.
    """

    mode: Mode
    method: Method
    rays: int
    detectors: dict[str, Detected]
    monitors: dict[str, Crossed]
    ledger: Ledger
    hits: int
    undefined: int
    undefined_at_mm: tuple[Point, ...] = ()
    truncated: int = 0
    truncated_at_mm: tuple[Point, ...] = ()
    pieces: int = 0
    reached: bool = True
    why: str = ""
    single_error: float | None = None
    missed: float = 0.0
    leaked: float = 0.0
    u_ledger: Ledger = UNKNOWN
    u_missed: float = math.nan
    u_leaked: float = math.nan
    reflected: float = 0.0
    segments: NDArray[np.void] | None = field(default=None, metadata=HIDDEN)

    @reported
    def simulated(self) -> bool:
        """Always true, because no result here is measured."""
        return True

    @reported
    def u_power(self) -> float:
        """Largest ``u_power`` of all receivers; without receivers: 0, but 1 if an integration missed its tolerance."""
        return max((reading.u_power for reading in self.detectors.values()), default=0.0 if self.reached else 1.0)

    def paths(self) -> list[Path]:
        """Return the paths of all branches, in order of ray and branch; empty unless the trace stored its segments."""
        if self.segments is None or len(self.segments) == 0:
            return []
        new = (np.diff(self.segments["ray"]) != 0) | (np.diff(self.segments["branch"]) != 0)
        return [_path(part) for part in np.split(self.segments, np.flatnonzero(new) + 1)]

    def to_dataset(self, attributes: Mapping[str, str | int | float] | None = None) -> "xr.Dataset":
        """Return the trace as an `xarray.Dataset` with named dimensions and units; see `solen.trace.to_dataset`."""
        from solen.trace.dataset import to_dataset  # that module imports this one

        return to_dataset(self, attributes)


def in_order(segments: NDArray[np.void]) -> NDArray[np.void]:
    """Return ray segments in the order in which a `Trace` stores them."""
    return np.asarray(segments[np.lexsort((segments["hit"], segments["branch"], segments["ray"]))])


def _path(segments: NDArray[np.void]) -> Path:
    last = segments[-1]
    starts = np.column_stack([segments["x_mm"], segments["z_mm"]])
    escaped = not np.isfinite(last["length_mm"])
    vertices = (
        starts if escaped else np.vstack([starts, starts[-1] + last["length_mm"] * np.array([last["dx"], last["dz"]])])
    )
    return Path(
        ray=int(last["ray"]),
        branch=int(last["branch"]),
        parent=int(last["parent"]),
        points_mm=vertices,
        interfaces=tuple(int(i) for i in segments["interface"] if i >= 0),
        power=float(segments[0]["power_s"] + segments[0]["power_p"]),
        fate=FATES[int(last["fate"])],
        exit_direction=(float(last["dx"]), float(last["dz"])) if escaped else None,
    )
