"""The index of a resin from two simulated spectra: the transmittance and the reflectance of a printed layer.

Both spectra are read from the same file. The layer is 50 µm thick and nearly clear, so its index is determined by the
reflectance of its faces, and the uncertainty of the index by the uncertainties of the spectra.
"""

import numpy as np

from solen.material.index.layer import LayerIndex, index_of_layer
from solen.material.index.options import IndexOptions
from solen.recording import read
from solen.samples import FOLDER

WAVELENGTHS_NM = (450.0, 589.3, 860.0)


def main() -> LayerIndex:
    """Return the index of the layer with its uncertainty."""
    options = IndexOptions(thickness_um=50.0, u_thickness_um=1.0, u_T=0.001, u_R=0.001, baseline="air")
    result = index_of_layer(read(FOLDER / "layer-simulated.csv"), options)
    for nm in WAVELENGTHS_NM:
        n, u = (np.interp(nm, result.wavelength_nm, values) for values in (result.n, result.u_n))
        print(f"{nm:5.1f} nm: n = {n:.4f} ± {u:.4f}")
    return result


if __name__ == "__main__":
    main()
