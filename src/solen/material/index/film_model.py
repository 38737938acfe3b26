"""The model of a layer whose faces interfere: its parameters with their priors, and the spectra that they predict.

Parameters with independent information have a prior: the thickness from a micrometer, the slit width from the
instrument, and the error of a 100 % reading from the specified accuracy. The variation of the thickness within the beam
has only a wide prior. k is piecewise linear between knots, each at least 0. n is Cauchy's formula with three terms, one
pole of Sellmeier's formula, or free (`solen.material.index.dispersion_form`).

`Measured` contains the readings and prior knowledge; `FilmModel` predicts the readings.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from solen.arrays import FloatArray
from solen.material.index.coherence import Blur, layer, stacked
from solen.material.index.dispersion_form import DispersionForm, Kind, free_knots
from solen.material.index.fringes import Phase
from solen.material.index.reading import Length, Reading
from solen.material.index.stack import Setup, incoherent
from solen.units import NM_PER_UM

SLIT_SHARE = 0.1
"""Relative standard uncertainty of a specified slit width, which includes the uncertain shape of the slit function."""
U_THICKNESS = 0.1
"""Relative standard uncertainty assumed for a thickness if none is specified."""
_MAX_SPREAD, _MAX_SLIT_NM = 0.1, 20.0
_BEND = 0.01  # prior standard deviation of the third term of n at the ends of the range
_ADDED = 0.01  # the same for each curve of a free index
_OTHER = 0.02  # relative standard uncertainty of the contrast from other causes than slit and thickness
_KNOTS = 6
STEP = 1e-30
_STATED_U = 1e-3  # assumed uncertainty of readings until their scatter is known
_BEYOND = 1.5  # ratio of variances above which the residuals exceed the scatter
_BLURRED = np.array([0.0, 0.5, 1.0, 2.0])  # standard deviations of the phase to be tried
_TURNED = np.arange(0.0, 9.0, 0.7)  # half ranges of the phase to be tried


@dataclass(frozen=True, eq=False)
class Measured:
    """Readings of a layer, and prior knowledge of it.

    Attributes
    ----------
    wavelength_nm
        Wavelengths, shape (n,), ascending.
    readings
        ``T``, ``R`` or both.
    thickness
        Thickness from a micrometer; None if it was not measured.
    slit_nm
        Slit width; None if it is not known.
    setup
        Sheet under the layer; None in air. If the sheet was measured too, its index is the initial value in the fit.
    bare
        ``T`` and ``R`` of the bare sheet in air.
    """

    wavelength_nm: FloatArray
    readings: dict[str, Reading]
    thickness: Length | None = None
    slit_nm: float | None = None
    setup: Setup | None = None
    bare: dict[str, Reading] = field(default_factory=dict)


class FilmModel:
    """Parameters of a layer and their predictions; ``names`` maps a name to its position in the parameter vector."""

    def __init__(
        self, measured: Measured, level: float, optical_um: float, kind: Kind = "cauchy", *, coherent: bool = True
    ) -> None:
        nm = measured.wavelength_nm
        self.measured, self.level, self.optical_um = measured, level, optical_um
        self.coherent = coherent
        self.um = nm / NM_PER_UM
        x, ends = self.um**-2, (self.um[-1] ** -2, self.um[0] ** -2)
        self.middle = (ends[0] + ends[1]) / 2.0
        self.half = max((ends[1] - ends[0]) / 2.0, 1e-12)
        self.u = (x - self.middle) / self.half
        u_per_nm = -2.0 * self.um**-3 / self.half / NM_PER_UM
        self.fringes = 2.0 * optical_um * (1.0 / self.um[0] - 1.0 / self.um[-1])
        self.form = DispersionForm.of(kind, self.u, u_per_nm, free_knots(self.fringes))
        self.hats = _hats(nm, min(_KNOTS, max(2, nm.size // 8)))
        self.k_unit = 1e-4
        names = ["n", "rise", "bend", "ln_optical", "slit", "rough", "wedge", "other"]
        if measured.setup is not None:
            names += ["sheet", "sheet_rise", "sheet_bend"] if measured.bare else ["sheet"]
        names += [f"off_{kind}" for kind in measured.readings]
        self.added = slice(len(names), len(names) + self.form.curves)
        names += [f"added_{number}" for number in range(self.form.curves)]
        self.names = {name: place for place, name in enumerate(names)}
        self.first_k = len(names)
        self.last_k = len(names) + self.hats.shape[1]
        self.size = self.last_k + self.hats.shape[1] * bool(measured.bare)
        self.blocks = {**measured.readings, **{f"bare_{kind}": one for kind, one in measured.bare.items()}}
        self.scatter = {kind: np.full(nm.size, _STATED_U) for kind in self.blocks}
        common = {kind: np.mean((reading.u_common**2).sum(axis=0)) for kind, reading in measured.readings.items()}
        self.u_off = {kind: max(float(np.sqrt(variance)), 1e-6) for kind, variance in common.items()}

    def start(self, phase: Phase) -> FloatArray:
        """Return initial parameters from the fringes' phase, with the blur that fits the contrast best."""
        p = np.zeros(self.size)
        slit = self.measured.slit_nm
        values = {"n": self.level, "rise": self.level * phase.rise, "bend": self.level * phase.bend}
        for name, value in values.items():
            p[self.names[name]] = value
        p[self.first_k :] = 0.05
        return min((self.blurred(p, width) for width in ((slit,) if slit else (0.3, 1.0, 3.0))), key=self.cost)

    def cost(self, p: FloatArray) -> float:
        """Return the sum of squared weighted residuals."""
        off = self.residuals(p)
        return float(off @ off)

    def blurred(self, p: FloatArray, slit: float) -> FloatArray:
        """Return the parameters with the best-fitting thickness variation from a small grid."""
        if not self.coherent:
            return p
        middle = 4.0 * np.pi * self.optical_um * np.sqrt(self.middle)
        places = [self.names[name] for name in ("slit", "rough", "wedge")]
        tried = []
        for rough in _BLURRED / middle:
            for wedge in _TURNED / middle / np.sqrt(3.0):
                q = p.copy()
                q[places] = slit, rough, wedge
                tried.append(np.clip(q, *self.bounds))
        return min(tried, key=self.cost)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the parameters."""
        low, high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        limits = {
            "n": (1.05, 4.5),
            "slit": (0.0, _MAX_SLIT_NM),
            "rough": (0.0, _MAX_SPREAD),
            "wedge": (0.0, _MAX_SPREAD),
        }
        for name, (least, most) in limits.items():
            low[self.names[name]], high[self.names[name]] = least, most
        low[self.first_k :] = 0.0
        return low, high

    def index(self, p: Any) -> tuple[Any, Any]:
        """Return the index and its derivative with respect to wavelength."""
        n, rise, bend = (p[self.names[name]] for name in ("n", "rise", "bend"))
        return self.form.index(n, rise, bend, p[self.added])

    def thickness(self, p: Any) -> Any:
        """Return the thickness in µm."""
        return self.optical_um * np.exp(p[self.names["ln_optical"]]) / p[self.names["n"]]

    def blur(self, p: Any) -> Blur:
        """Return the loss of contrast, which is complete for a layer that is evaluated from its levels alone."""
        if not self.coherent:
            return Blur(0.0, 10.0)
        return Blur(*(p[self.names[name]] for name in ("slit", "rough", "wedge", "other")))

    def spectra(self, p: Any, blur: Blur | None = None) -> dict[str, Any]:
        """Return the modelled instrument readings, by kind."""
        setup, nm = self.measured.setup, self.measured.wavelength_nm
        n, slope = self.index(p)
        k = self.k_unit * (self.hats @ p[self.first_k : self.last_k])
        sheet: tuple[Any, Any, Any] | None = None
        behind: Any = 1.0
        if setup is not None:
            behind, dark = self.sheet(p, setup)
            sheet = (behind, dark, setup.substrate.thickness_um)
        piece = layer(n, slope, k, self.thickness(p), nm, behind, blur or self.blur(p))
        read = stacked(piece, sheet, nm, setup)
        found = {kind: getattr(read, kind) + p[self.names[f"off_{kind}"]] for kind in self.measured.readings}
        if sheet is not None and self.measured.bare:
            alone = incoherent([sheet[0]], [sheet[1]], [sheet[2]], nm)
            found["bare_T"] = alone.through + p[self.names["off_T"]]
            found["bare_R"] = alone.front + p[self.names["off_R"]]
        return found

    def sheet(self, p: Any, setup: Setup) -> tuple[Any, Any]:
        """Return the index and extinction of the sheet, either as specified or as fitted."""
        known = np.asarray(setup.substrate.n)
        if not self.measured.bare:
            return known + p[self.names["sheet"]] * _unit(np.asarray(setup.substrate.u_n)), setup.substrate.k
        n, rise, bend = (p[self.names[name]] for name in ("sheet", "sheet_rise", "sheet_bend"))
        return known + n + rise * self.u + bend * self.u**2, 0.1 * self.k_unit * (self.hats @ p[self.last_k :])

    def residuals(self, p: Any) -> Any:
        """Return the weighted residuals of the readings, followed by those of the priors."""
        spectra, rows = self.spectra(p), []
        for kind, reading in self.blocks.items():
            rows.append((spectra[kind] - reading.value) / self.scatter[kind])
        return np.concatenate([*rows, self.prior(p)])

    def prior(self, p: Any) -> Any:
        """Return the residuals of the priors, in standard uncertainties."""
        at = {name: p[place] for name, place in self.names.items()}
        bend = 1e-6 if self.form.kind == "sellmeier" else _BEND
        rows = [at["bend"] / bend, *(p[self.added] / _ADDED), at["rough"] / _MAX_SPREAD, at["wedge"] / _MAX_SPREAD]
        rows.append(at["other"] / _OTHER)
        if (thickness := self.measured.thickness) is not None:
            u = U_THICKNESS * thickness.um if thickness.u_um is None else max(thickness.u_um, 1e-4 * thickness.um)
            rows.append((self.thickness(p) - thickness.um) / u)
        slit = self.measured.slit_nm
        rows.append(at["slit"] / _MAX_SLIT_NM if slit is None else (at["slit"] / slit - 1.0) / SLIT_SHARE)
        if "sheet_bend" in at:
            rows.append(at["sheet_bend"] / _BEND)
        elif "sheet" in at:
            rows.append(at["sheet"])
        rows += [at[f"off_{kind}"] / u for kind, u in self.u_off.items()]
        return np.stack(rows)

    def slopes(self, p: FloatArray) -> FloatArray:
        """Return the derivatives of the residuals, computed by the complex-step method.

        One step serves all knots of k, because each wavelength depends only on its own k.
        """
        one_by_one = np.zeros((self.residuals(p).size, self.first_k))
        for place in range(self.first_k):
            moved = p.astype(complex)
            moved[place] += 1j * STEP
            one_by_one[:, place] = self.residuals(moved).imag / STEP
        return np.hstack(
            [one_by_one, *(self._by_k(p, first) for first in range(self.first_k, p.size, self.hats.shape[1]))]
        )

    def _by_k(self, p: FloatArray, first: int) -> FloatArray:
        points, knots = self.hats.shape
        moved = p.astype(complex)
        moved[first : first + knots] += 1j * STEP
        by_k, count = self.residuals(moved).imag / STEP, len(self.blocks)
        rows = np.zeros((by_k.size, knots))
        rows[: count * points] = np.tile(self.hats, (count, 1)) * by_k[: count * points, None]
        return rows

    def solve(self, p: FloatArray, steps: int = 25) -> tuple[FloatArray, float]:
        """Return the least-squares parameters from a start, and their sum of squares.

        The Levenberg-Marquardt steps change only the free parameters, that is, those not at a bound that the step would
        cross.
        """
        low, high = self.bounds
        p = np.clip(p, low, high)
        off = self.residuals(p)
        cost, damping = float(off @ off), 1e-3
        for _ in range(steps):
            slope = self.slopes(p)
            pull = slope.T @ off
            free = ~(((p <= low) & (pull > 0.0)) | ((p >= high) & (pull < 0.0)))
            normal = slope[:, free].T @ slope[:, free]
            before = cost
            for _ in range(6):
                step = np.zeros(p.size)
                step[free] = -np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), pull[free])
                moved = np.clip(p + step, low, high)
                other = self.residuals(moved)
                if float(other @ other) < cost:
                    p, off, cost, damping = moved, other, float(other @ other), damping / 10.0
                    break
                damping = max(10.0 * damping, 1e-4)
            if before - cost < 0.01:
                break
        return p, cost

    def shifted_order(self, p: FloatArray, by: float) -> FloatArray:
        """Return parameters for fringes with orders higher by ``by`` and with phases as similar as possible."""
        names, basis = self.names, np.stack([np.ones_like(self.u), self.u, self.u**2], axis=1)
        shift = np.linalg.lstsq(basis, by * self.um / 2.0, rcond=None)[0]
        places = [names[name] for name in ("n", "rise", "bend")]
        optical = self.optical_um * float(np.exp(p[names["ln_optical"]]))
        paths = optical * p[places] / p[names["n"]] + shift
        moved = p.copy()
        moved[places[1:]] = p[names["n"]] * paths[1:] / paths[0]
        moved[names["ln_optical"]] = np.log(paths[0] / self.optical_um)
        return moved

    def freed(self, p: FloatArray) -> "tuple[FilmModel, FloatArray]":
        """Return the same model with a free index, and its initial parameters."""
        model = FilmModel(self.measured, self.level, self.optical_um, "free", coherent=self.coherent)
        moved = np.insert(p, self.added.start, np.zeros(model.form.curves))
        return model, moved

    def phase_matched(self, p: FloatArray) -> FloatArray:
        """Return parameters whose phases match the measured fringes, followed from their strongest part."""
        n, h = self.index(p)[0], self.thickness(p)
        width = max(5, round(2.0 * self.um.size / self.fringes))
        carrier = np.exp(-4j * np.pi * n * h / self.um)
        spectra = self.spectra(p)

        def wave(values: dict[str, Any]) -> Any:
            both = sum(values[kind] * (1.0 if kind == "T" else -1.0) for kind in self.measured.readings)
            product = (both - uniform_filter1d(both, width)) * carrier
            return uniform_filter1d(product.real, width) + 1j * uniform_filter1d(product.imag, width)

        read = wave({kind: reading.value for kind, reading in self.measured.readings.items()})
        turn = np.unwrap(np.angle(read * np.conj(wave(spectra))))
        weight = np.abs(read)[:, None]
        turn -= 2.0 * np.pi * np.round(turn[np.argmax(weight)] / (2.0 * np.pi))
        u = self.u
        terms = np.column_stack([np.ones_like(u), u, u**2, self.form.waves])
        found = np.linalg.lstsq(weight * terms, weight[:, 0] * turn * self.um / (4.0 * np.pi * h), rcond=None)[0]
        moved = p.copy()
        moved[self.names["ln_optical"]] += found[0] / p[self.names["n"]]
        moved[[self.names["rise"], self.names["bend"]]] += found[1:3]
        moved[self.added] += found[3:]
        return moved

    def misfits(self, p: FloatArray, widened: float = 1.0) -> bool:
        """Whether the residuals exceed the scatter of repeats or, without repeats, whether neighbours correlate.

        ``widened`` is the largest `widening` still attributed to noise without repeats.
        """
        spectra = self.spectra(p)
        left = [float(np.mean((block.value - spectra[kind]) ** 2)) for kind, block in self.blocks.items()]
        known = [float(np.mean(block.u_random**2)) for block in self.blocks.values()]
        if any(known):
            return any(0.0 < scatter < off / _BEYOND for off, scatter in zip(left, known, strict=True))
        return self.widening(p) > widened

    def widening(self, p: FloatArray) -> float:
        """Return the factor that widens the variance if the residuals of neighbours are correlated."""
        spectra, most = self.spectra(p), 1.0
        for kind, reading in self.blocks.items():
            off = reading.value - spectra[kind]
            rho = float(np.sum(off[1:] * off[:-1]) / max(np.sum(off**2), 1e-300))
            if rho > 2.33 / np.sqrt(off.size):
                most = max(most, (1.0 + min(rho, 0.9)) / (1.0 - min(rho, 0.9)))
        return most

    def likelihood(self, p: FloatArray) -> float:
        """Return the log-likelihood of the readings with unknown scatter, up to a constant."""
        spectra = self.spectra(p)
        off = [reading.value - spectra[kind] for kind, reading in self.blocks.items()]
        return -0.5 * float(sum(one.size * np.log(np.mean(one**2)) for one in off))

    def weigh(self, p: FloatArray) -> None:
        """Set the scatter of the readings to that of the residuals, or of the repeats if theirs is larger."""
        spectra = self.spectra(p)
        for kind, reading in self.blocks.items():
            off = reading.value - spectra[kind]
            freedom = max(off.size - self.size / len(self.blocks), off.size / 4.0)
            self.scatter[kind] = np.maximum(max(float(np.sqrt(np.sum(off**2) / freedom)), 1e-9), reading.u_random)


def _unit(u: FloatArray) -> FloatArray:
    return np.where(u > 0.0, u, 1e-9)


def _hats(nm: FloatArray, count: int) -> FloatArray:
    """Return piecewise linear functions of wavelength, each equal to 1 at one of ``count`` knots, shape (n, count)."""
    knots = np.linspace(nm[0], nm[-1], count)
    return np.stack([np.interp(nm, knots, row) for row in np.eye(count)], axis=1)
