"""A resin from simulated measurements to a response, with propagated uncertainties of the measurements."""

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
    """Write a simulated file of columns."""
    np.savetxt(file, np.array(columns).T, "%.6g", ",", header=f"# simulated\n{header}", comments="")
    return file


def results(folder: Path) -> dict[str, Path]:
    """Return results of four measurements: a clear layer of 1.48 + 0.005/λ², guides, cured discs, a cube."""
    out = {name: folder / f"{name}.json" for name in ("index", "cutback", "cure", "stiffness")}
    layer = IndexOptions(thickness_um=50.0, u_T=0.001, u_R=0.001, baseline="air")
    n = 1.48 + 0.005 / ((nm := np.arange(430, 901, 2)) * 1e-3) ** 2
    t, r = (one / (n**2 + 1) + NOISE(0, 1e-3, nm.size) for one in (2 * n, (n - 1) ** 2))
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
    """Return the measured properties of the resin, and the effect of the index's uncertainty on the response."""
    with tempfile.TemporaryDirectory() as name:
        out, options = Path(name) / "resin.toml", BuildOptions(name="simulated resin")
        made = library.build(out, options=options, force=False, **results(Path(name))).result.to_dict()
        changes = {"material.resin": made["resin"], "emitter.width_mm": 0.2, "motion.step_deg": 0.5}
        sensor = Sensor.of(with_values(loads(template("paper-860")), changes))
    near, u_n = np.linspace(-1.0, -0.25, 7).tolist(), sensor.material.u_index or 0.0  # degrees, beside the null
    others = [with_deviations(sensor, {"material.index": step}).power(near).contrast for step in (-u_n, u_n)]
    moved = float(np.abs(np.array(others) - sensor.power(near).contrast).max())
    found = {"n": sensor.material.index, "u_n": u_n, "moved": moved}
    found |= {"loss": made["loss"]["absorption_per_mm"], "Dp": made["cure"]["Dp_um"], **made["stiffness"]["parameters"]}
    print(*(f"{key} {value:.4g}" for key, value in found.items()), sep=", ")
    return found


if __name__ == "__main__":
    main()
