"""The index of a resin from two spectra: transmittance and reflectance of a printed layer, simulated.

Both are read from one table. The layer is 50 µm thick and nearly clear, so its index follows from the reflectance of
its faces; its uncertainty follows from those of the spectra.
"""

import numpy as np

from solen.material.index.layer import LayerIndex, index_of_layer
from solen.material.index.options import IndexOptions
from solen.recording import read
from solen.samples import FOLDER

AT_NM = (450.0, 589.3, 860.0)


def main() -> LayerIndex:
    """Return the index of the layer with its uncertainty, at some wavelengths."""
    options = IndexOptions(thickness_um=50.0, u_thickness_um=1.0, u_T=0.001, u_R=0.001, baseline="air")
    found = index_of_layer(read(FOLDER / "layer-simulated.csv"), options)
    for nm in AT_NM:
        n, u = (np.interp(nm, found.wavelength_nm, values) for values in (found.n, found.u_n))
        print(f"{nm:5.1f} nm: n = {n:.4f} ± {u:.4f}")
    return found


if __name__ == "__main__":
    main()
