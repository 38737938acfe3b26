"""Results of traces, however they were computed: detectors, monitors, ledger, and paths if kept.

All powers are fractions of the emitted power. The ledger's four parts add up to 1: what receivers **detected**, what
**escaped** to infinity, what was **absorbed** by media, walls and the backs of receivers, and what was **truncated**:
branches below the stated weight, rays beyond the stated number of hits, and rays that met an interface from a medium
they were not in (counted in ``undefined``, the others in ``truncated``, and located, never dropped).

Every power has an uncertainty ``u_power``, however the rays were chosen: for independent samples a
standard error, for a fan and for adaptive integration an estimate of the error.
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

LEG = np.dtype(
    [(name, np.int64) for name in ("ray", "branch", "parent", "hit", "interface", "fate")]
    + [
        (name, np.float64)
        for name in ("x_mm", "z_mm", "dx", "dz", "length_mm", "power_s", "power_p", "kept", "optical_path_mm")
    ]
)
"""One straight stretch: its ray, its branch, the branch that one was split off (−1: none), how many interfaces were
met on the way here, the interface it ends on (−1: none), the fate there, start, direction, length (inf where it
escapes), the power at its start as a fraction of the emitted power, the share of that left at its end, and the optical
path from the source to its start. A trace holds them in the order of ray, branch and hit; how a ray's branches are
numbered is up to the tracer, but a parent always comes before its children."""

CORNER_MM = 2 * END_TOLERANCE_MM
"""How far a ray that has just met a corner is carried on past the end of the other curve that meets there."""
KEPT_PLACES = 16
"""How many places of undefined rays, and of truncated ones, a trace remembers."""


def check_choice(what: str, value: object, choices: tuple[str, ...]) -> None:
    """`DesignError` if a value is none of the choices."""
    if value not in choices:
        raise DesignError(what, value=value, limit=f"must be one of {', '.join(choices)}")


def check_mode(mode: object) -> None:
    """`DesignError` for a mode that does not exist."""
    check_choice("mode", mode, MODES)


@dataclass(frozen=True)
class Limits:
    """Where following a ray ends.

    ``min_weight`` is the power below which a branch is cut, as a fraction of the power its ray was launched with;
    ``max_hits`` the most interfaces a ray may meet on one way.
    """

    min_weight: float = 1e-6
    max_hits: int = 10_000

    def __post_init__(self) -> None:
        if not 1e-15 <= self.min_weight < 1.0:
            raise DesignError("min_weight", value=self.min_weight, limit="must be from 1e-15 to below 1")
        check_count("max_hits", self.max_hits, 1)


@dataclass(frozen=True)
class Ledger:
    """Where the emitted power went; the four add up to 1."""

    detected: float
    escaped: float
    absorbed: float
    truncated: float

    @property
    def total(self) -> float:
        """Sum of the four: 1 but for rounding."""
        return self.detected + self.escaped + self.absorbed + self.truncated


UNKNOWN = Ledger(math.nan, math.nan, math.nan, math.nan)
"""Uncertainties of a ledger where nothing tells them."""


class Detected(Result):
    """Reading of a receiver; powers are fractions of the emitted power.

    Attributes
    ----------
    power, u_power
        Power detected, and its uncertainty: NaN for a single ray.
    rays
        Rays or branches that arrived; after an adaptive integration all rays that it took.
    power_by_source
        Power from each source of the scene.
    optical_path_mm
        Mean optical path of what arrived, weighted by power; NaN where nothing did.
    power_by_position
        (interfaces of the receiver, bins) power in equal bins of each interface's parameter from its start to its end;
        empty unless bins were asked for.
    power_by_angle
        (bins,) power in equal bins of the angle of incidence from −90 to 90 degrees, positive where light runs towards
        the interface's end; empty unless bins were asked for.
    """

    power: float
    u_power: float
    rays: int
    power_by_source: tuple[float, ...] = ()
    optical_path_mm: float = math.nan
    power_by_position: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    power_by_angle: FloatArray = field(default_factory=lambda: np.empty(0))


class Crossed(Result):
    """Reading of a monitor: net power towards its left, crossings, and net power per bin (N,) from start to end."""

    power: float
    u_power: float
    rays: int
    power_by_bin: FloatArray


class Path(Result):
    """Path of one branch: its corners (N, 2), the interfaces met by number, its power at the start and its fate.

    ``parent`` is the branch of the same ray that it was split off, −1 for the launched ray itself.
    ``exit_direction`` is the unit direction beyond the last corner of a branch that escaped.
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

    ``method`` says how the rays were chosen: ``"fan"`` (evenly), ``"sobol"`` (sixteen independent scrambled Sobol'
    samples) or ``"adaptive"``. ``truncated`` counts branches that were cut off, ``truncated_at_mm`` holds the first of
    their places. Adaptive integration also says in how many ``pieces``, and whether its tolerance was ``reached``; if
    not, ``why`` says what stood in the way, and the powers lack what was not integrated. ``single_error`` is the
    largest difference of a receiver's power between single and double precision, found on a part of the rays. In an
    extruded scene ``missed`` and ``leaked`` are parts of what escaped: what passed above or below all bodies, and what
    left them through top or bottom; ``reflected`` is what a lens that is no cylinder reflected of the light that met
    it, wherever that went, and 0 for any other face. ``u_ledger``, ``u_missed`` and ``u_leaked`` are their
    uncertainties, NaN where the rays cannot tell.
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
    legs: NDArray[np.void] | None = field(default=None, metadata=HIDDEN)

    @reported
    def simulated(self) -> bool:
        """Always: nothing here is measured."""
        return True

    @reported
    def u_power(self) -> float:
        """Largest ``u_power`` of any receiver; without one 0, or 1 where an integration missed its tolerance."""
        return max((reading.u_power for reading in self.detectors.values()), default=0.0 if self.reached else 1.0)

    def paths(self) -> list[Path]:
        """Paths of all branches, in the order of ray and branch; empty unless the trace kept its legs."""
        if self.legs is None or len(self.legs) == 0:
            return []
        new = (np.diff(self.legs["ray"]) != 0) | (np.diff(self.legs["branch"]) != 0)
        return [_path(part) for part in np.split(self.legs, np.flatnonzero(new) + 1)]

    def to_dataset(self, attributes: Mapping[str, str | int | float] | None = None) -> "xr.Dataset":
        """The same as an `xarray.Dataset` with named dimensions and units; see `solen.trace.to_dataset`."""
        from solen.trace.dataset import to_dataset  # it is made from this module

        return to_dataset(self, attributes)


def in_order(legs: NDArray[np.void]) -> NDArray[np.void]:
    """Stretches in the order that a `Trace` holds them in."""
    return np.asarray(legs[np.lexsort((legs["hit"], legs["branch"], legs["ray"]))])


def _path(legs: NDArray[np.void]) -> Path:
    last = legs[-1]
    starts = np.column_stack([legs["x_mm"], legs["z_mm"]])
    escaped = not np.isfinite(last["length_mm"])
    corners = (
        starts if escaped else np.vstack([starts, starts[-1] + last["length_mm"] * np.array([last["dx"], last["dz"]])])
    )
    return Path(
        ray=int(last["ray"]),
        branch=int(last["branch"]),
        parent=int(last["parent"]),
        points_mm=corners,
        interfaces=tuple(int(i) for i in legs["interface"] if i >= 0),
        power=float(legs[0]["power_s"] + legs[0]["power_p"]),
        fate=FATES[int(last["fate"])],
        exit_direction=(float(last["dx"]), float(last["dz"])) if escaped else None,
    )
