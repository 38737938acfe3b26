"""The index of a clear layer evaluated by four methods, one of which is wrong.

An 80 µm layer with the dispersion of an acrylate is measured, in this simulation, with a noise of 0.1 % in T and R. The
last method uses the absorbance that a spectrophotometer exports, −log10(T), as if it were the fraction of light
absorbed in the layer: the resulting values look like an index, but are wrong.
"""

import numpy as np

from solen.material.index import IndexSpectrum, Length, absorptance, as_published, forward, lossless, measured, reading
from solen.material.index.illuminant import index_in, led

THICKNESS_UM, U = 80.0, 1e-3
WAVELENGTH_NM = np.arange(450.0, 951.0, 2.0)
INDEX = 1.482 + 5.0e3 / WAVELENGTH_NM**2
EXTINCTION = np.full(WAVELENGTH_NM.shape, 2e-6)  # 0.3 % of the light is lost at 860 nm


def routes(seed: int = 1) -> dict[str, IndexSpectrum]:
    """Return the index by each of the four methods, from the same simulated spectra."""
    rng = np.random.default_rng(seed)
    exact_r, exact_t = forward(INDEX, EXTINCTION, THICKNESS_UM, WAVELENGTH_NM)
    r, t, a = (value + rng.normal(0.0, U, value.size) for value in (exact_r, exact_t, 1.0 - exact_r - exact_t))
    layer = Length(THICKNESS_UM, 1.0)
    return {
        "R and T measured": measured(WAVELENGTH_NM, reading(t, U), reading(r, U), layer),
        "T and absorptance": absorptance(WAVELENGTH_NM, reading(t, U), reading(a, U), layer),
        "T alone, lossless": lossless(WAVELENGTH_NM, reading(t, U)),
        "as published": as_published(WAVELENGTH_NM, reading(t, U), layer),
    }


def main() -> dict[str, tuple[float, float | None]]:
    """Return the index of the layer for an LED at 860 nm with its uncertainty, keyed by method."""
    light = led(860.0, 30.0)
    truth = float(light.weight @ (1.482 + 5.0e3 / light.wavelength_nm**2))
    print(f"simulated layer in the light of an 860 nm LED: n = {truth:.4f}")
    results = {}
    for name, spectrum in routes().items():
        index = index_in(spectrum, light)
        assert index.n is not None  # noqa: S101  most of the band of the LED is valid
        u = "no uncertainty" if index.u_n is None else f"± {index.u_n:.4f}"
        print(f"  {name:18} {index.n:.4f} {u:15}{'' if spectrum.measurement else '  not a measurement'}")
        results[name] = (index.n, index.u_n)
    return results


if __name__ == "__main__":
    main()
