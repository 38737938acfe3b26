"""From simulated measurements of a resin to the response of a sensor, with the uncertainties propagated."""

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from solen.material.index.options import IndexOptions
from solen.material.resin_from_results import BuildOptions
from solen.pipeline.resin import cure, cutback, index, library, stiffness
from solen.sensor import Sensor
from solen.sensor.effects import with_deviations
from solen.spec import loads, template, with_values

NOISE = np.random.default_rng(5).normal


def table(file: Path, header: str, *columns: ArrayLike) -> Path:
    """Write columns of simulated values to a file, and return its path."""
    np.savetxt(file, np.array(columns).T, "%.6g", ",", header=f"# simulated\n{header}", comments="")
    return file


def results(folder: Path) -> dict[str, Path]:
    """Simulate and evaluate tests of a layer, guides, discs and a cube; return the result files, keyed by name."""
    out = {name: folder / f"{name}.json" for name in ("index", "cutback", "cure", "stiffness")}
    layer = IndexOptions(thickness_um=50.0, u_T=0.001, u_R=0.001, baseline="air")
    n = 1.48 + 0.005 / ((nm := np.arange(430, 901, 2)) * 1e-3) ** 2
    t, r = (exact + NOISE(0, 1e-3, nm.size) for exact in (2 * n / (n**2 + 1), (n - 1) ** 2 / (n**2 + 1)))
    index.index(table(folder / "layer.csv", "wavelength_nm,T,R", nm, t, r), options=layer, out=out["index"])
    mm, mj = np.repeat([10, 20, 30, 40], 4), np.repeat([16, 25, 39], 5)
    mw, um = np.exp(-0.02 * mm + NOISE(0, 0.02, mm.size)), 150 * np.log(mj / 12) + NOISE(0, 4, mj.size)
    cutback.cutback(table(folder / "guides.csv", "length_mm,power_mW", mm, mw), out=out["cutback"])
    cure.cure([table(folder / "discs.csv", "dose_mJ_per_cm2,depth_um", mj, um)], out=out["cure"])
    stretch = np.linspace(1, 0.7, 61)
    mpa = 0.4 * (stretch - stretch**-2) - NOISE(0, 1e-3, 61)
    stiffness.stiffness(table(folder / "cube.csv", "stretch,stress_MPa", stretch, mpa), out=out["stiffness"])
    return out


def main() -> dict[str, float]:
    """Return the measured properties of the resin, and the change of the contrast due to the uncertainty of n."""
    with tempfile.TemporaryDirectory() as name:
        out, options = Path(name) / "resin.toml", BuildOptions(name="simulated resin")
        resin = library.build(out, options=options, force=False, **results(Path(name))).result.to_dict()
        changes = {"material.resin": resin["resin"], "emitter.width_mm": 0.2, "motion.step_deg": 0.5}
        sensor = Sensor.of(with_values(loads(template("paper-860")), changes))
    angles_deg, u_n = np.linspace(-1.0, -0.25, 7).tolist(), sensor.material.u_index or 0.0
    shifted = [with_deviations(sensor, {"material.index": step}).power(angles_deg).contrast for step in (-u_n, u_n)]
    contrast_change = float(np.abs(np.array(shifted) - sensor.power(angles_deg).contrast).max())
    values = {"n": sensor.material.index, "u_n": u_n, "contrast_change": contrast_change, "Dp": resin["cure"]["Dp_um"]}
    values |= {"loss": resin["loss"]["absorption_per_mm"], **resin["stiffness"]["parameters"]}
    print(*(f"{key} {value:.4g}" for key, value in values.items()), sep=", ")
    return values


if __name__ == "__main__":
    main()
