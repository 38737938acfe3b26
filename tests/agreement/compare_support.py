"""Comparing two traces ray by ray, as far as the scene itself lets them be compared.

Each straight stretch of a ray has a key that does not depend on what other branches do: the key of its branch and
its place in it; a branch's key is that of its parent and the place where it left it. The rule: the reference is traced
three times, as launched and with every launch turned by ±1e-13 rad. A stretch is compared only where all three
references have it, ending on the same interface with the same fate and, to 1e-9 mm, at the same place, and so have
every stretch before it. All others are *left out*, and counted. On what is compared, the engine must have the same
stretch, on the same interface, with the same fate, ending within 1e-9 mm; where nothing is left out it must have no
stretch more. How far the powers deviate, as a share of the stretch's power, and how far the optical paths do, is told
to the caller.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.scene import Scene
from solen.scene.sources import Placed, Source
from solen.trace import Trace

TURN_RAD = 1e-13
TOLERANCE_MM = 1e-9
Key = tuple[int, ...]


@dataclass(frozen=True)
class Stretch:
    """One straight stretch: the interface it ends on, its fate, its end (its direction where it escapes), its power."""

    interface: int
    fate: int
    end: tuple[float, float]
    power: tuple[float, float]
    optical_path_mm: float

    def near(self, other: "Stretch") -> bool:
        """Same interface, fate and, within the tolerance, end."""
        same = (self.interface, self.fate) == (other.interface, other.fate)
        return same and math.dist(self.end, other.end) <= TOLERANCE_MM


@dataclass(frozen=True)
class Comparison:
    """How a scene came out: stretches of the reference, those left out, and the largest deviation of the others."""

    stretches: int
    left_out: int
    deviation_mm: float
    deviation_power: float
    deviation_optical_mm: float


@dataclass(frozen=True)
class Turned(Source):
    """Another source with every ray turned where it starts."""

    source: Source
    angle_rad: float
    rays: int

    @property
    def shape_dimensions(self) -> int:
        return self.source.shape_dimensions

    def place(self, u: FloatArray) -> Placed:
        x, z, dx, dz = self.source.place(u)
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return x, z, c * dx - s * dz, s * dx + c * dz


def turned(scene: Scene, angle_rad: float) -> Scene:
    """The scene with every ray's launch turned by a small angle."""
    sources = tuple(
        Turned(s, angle_rad, s.rays, power=s.power, s_share=s.s_share, spectrum=s.spectrum) for s in scene.sources
    )
    return dataclasses.replace(scene, sources=sources)


def stretches(trace: Trace) -> dict[Key, Stretch]:
    """Every stretch by its key: ray, then place, branch by branch, then the place in the last branch."""
    assert trace.legs is not None
    found: dict[Key, Stretch] = {}
    branches: dict[tuple[int, int], Key] = {}
    for leg in trace.legs:  # parents come before their children
        ray, branch, parent, hit = (int(leg[name]) for name in ("ray", "branch", "parent", "hit"))
        if (ray, branch) not in branches:
            branches[ray, branch] = (ray,) if parent < 0 else (*branches[ray, parent], hit - 1)
        found[(*branches[ray, branch], hit)] = _stretch(leg)
    return found


def compared(truth: Trace, others: tuple[Trace, ...], engine: Trace) -> Comparison:
    """Compare; the assertion that fails names the stretch."""
    reference, fast = stretches(truth), stretches(engine)
    turned_ones = [stretches(other) for other in others]
    kept: set[Key] = set()
    deviation_mm = deviation_power = deviation_optical = 0.0
    for key, stretch in reference.items():  # parents come before their children
        if not _follows(key, kept) or not all(key in other and stretch.near(other[key]) for other in turned_ones):
            continue
        kept.add(key)
        assert key in fast, f"the engine has no stretch {key}: {stretch}"
        assert stretch.near(fast[key]), f"stretch {key}: reference {stretch}, engine {fast[key]}"
        deviation_mm = max(deviation_mm, math.dist(stretch.end, fast[key].end))
        deviation_power = max(deviation_power, *_deviation(stretch.power, fast[key].power))
        deviation_optical = max(deviation_optical, abs(stretch.optical_path_mm - fast[key].optical_path_mm))
    left_out = len(reference) - len(kept)
    assert left_out or len(fast) == len(reference), "the engine has stretches that the reference has not"
    return Comparison(len(reference), left_out, deviation_mm, deviation_power, deviation_optical)


def _stretch(leg: np.void) -> Stretch:
    length = float(leg["length_mm"])
    x, z, dx, dz = (float(leg[name]) for name in ("x_mm", "z_mm", "dx", "dz"))
    end = (x + length * dx, z + length * dz) if math.isfinite(length) else (dx, dz)
    power = (float(leg["power_s"]), float(leg["power_p"]))
    return Stretch(int(leg["interface"]), int(leg["fate"]), end, power, float(leg["optical_path_mm"]))


def _follows(key: Key, kept: set[Key]) -> bool:
    """Whether the stretch is a launch, or the one before it, in its branch or the one it was split off, is kept."""
    before, hit = key[:-1], key[-1] - 1
    if hit < 0:
        return True
    return before in kept if len(before) > 1 and before[-1] == hit else (*before, hit) in kept


def _deviation(a: tuple[float, float], b: tuple[float, float]) -> FloatArray:
    """Deviation of the powers as a share of the stretch's power."""
    return np.abs(np.subtract(a, b)) / max(sum(a), 1e-300)
