"""Inversions of R and T to n and k per second, compared with the published formulas at fifty digits.

Run with ``python benchmarks/inversion.py``. Everything is timed in one run, so the ratios hold on any machine; each
figure is the best of several runs. The last row is a map: 10⁵ wavelengths of 10³ spectra in one call.
"""

import os
import platform
import time
import tracemalloc
from collections.abc import Callable

import numpy as np

import solen
from solen.material.index import Length, forward, high_precision, invert, invert_many, measured, reading, slopes

POINTS, ROWS, REFERENCE_POINTS, SPECTRA, REPEATS = 100_000, 20, 500, 1000, 3
THICKNESS_UM = 50.0


def best_s(call: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the shortest of several runs, s."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    """Print the table."""
    rng = np.random.default_rng(0)
    nm = np.linspace(400.0, 900.0, POINTS)
    n, k = rng.uniform(1.4, 1.6, (ROWS, POINTS)), rng.uniform(0.0, 1e-3, (ROWS, POINTS))
    r, t = forward(n, k, THICKNESS_UM, nm)
    few = [tuple(map(float, row)) for row in zip(r[0], t[0], nm, strict=True)][:: POINTS // REFERENCE_POINTS]
    layer = Length(THICKNESS_UM, 0.5)
    print(
        f"solen {solen.__version__}, numpy {np.__version__}, Python {platform.python_version()}, {os.cpu_count()} cores"
    )

    def invert_few() -> None:
        for r_i, t_i, nm_i in few:
            high_precision.index(r_i, t_i, THICKNESS_UM, nm_i)

    reference = len(few) / best_s(invert_few)
    rows = [
        ("reference, fifty digits", reference),
        ("invert", r.size / best_s(lambda: invert(r, t, THICKNESS_UM, nm))),
        ("invert_many", r.size / best_s(lambda: invert_many(r, t, THICKNESS_UM, nm))),
        ("slopes", r.size / best_s(lambda: slopes(r, t, THICKNESS_UM, nm))),
        (
            "measured: u, masks, bounds",
            POINTS / best_s(lambda: measured(nm, reading(t[0], 1e-3), reading(r[0], 1e-3), layer)),
        ),
    ]
    print(f"{'method':28} {'inversions/s':>14} {'of the reference':>18}")
    for method, speed in rows:
        print(f"{method:28} {speed:14.3g} {speed / reference:18.0f}")
    measure_map(nm)


def measure_map(nm: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    """Print time and memory of a map; R varies with the wavelength and T with the spectrum."""
    r, _ = forward(np.linspace(1.45, 1.55, POINTS), 0.0, THICKNESS_UM, nm)
    t = np.linspace(0.5, 0.9, SPECTRA)[:, None]
    out = np.zeros((SPECTRA, POINTS)), np.zeros((SPECTRA, POINTS))
    for array in out:
        array += 1.0  # the first access to memory takes longer than the inversion
    seconds = best_s(lambda: invert_many(r[None, :], t, THICKNESS_UM, nm, out))
    tracemalloc.start()
    invert_many(r[None, :], t, THICKNESS_UM, nm, out)
    extra = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    speed = f"{seconds:.1f} s, {out[0].size / seconds:.3g} inversions/s"
    print(f"{POINTS} wavelengths x {SPECTRA} spectra: {speed}, {extra / 1e6:.0f} MB in addition to the results")


if __name__ == "__main__":
    main()
