"""The model of a layer with interference between its faces: its parameters with their priors, and the modelled spectra.

Parameters that are known independently have a prior: the thickness from a micrometer, the slit width from the
instrument, and the error of a 100 % reading from the specified accuracy. The variation of the thickness within the beam
has only a wide prior. k is piecewise linear between knots and at least 0. n is Cauchy's formula with three terms,
Sellmeier's formula with one pole, or free (`solen.material.index.dispersion_form`).

`FilmReadings` contains the readings and prior knowledge; `FilmModel` predicts the readings.
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

U_SLIT = 0.1
"""Relative standard uncertainty of a specified slit width, which includes the uncertain shape of the slit function."""
U_THICKNESS = 0.1
"""Relative standard uncertainty assumed for a thickness if none is specified."""
STEP = 1e-30
"""Complex step for derivatives."""
_MAX_THICKNESS_SD, _MAX_SLIT_NM = 0.1, 20.0
_U_BEND = 0.01  # prior standard deviation of the third term of n at the ends of the range
_U_ADDED = 0.01  # prior standard deviation of each curve of a free index
_U_CONTRAST = 0.02  # relative standard uncertainty of the contrast due to causes other than slit and thickness
_KNOTS = 6
_INITIAL_U = 1e-3  # assumed uncertainty of readings until their scatter is known
_MAX_VARIANCE_RATIO = 1.5  # ratio above which the residuals exceed the scatter
_PHASE_SDS = np.array([0.0, 0.5, 1.0, 2.0])  # standard deviations of the phase to be tried
_PHASE_HALF_RANGES = np.arange(0.0, 9.0, 0.7)  # half ranges of the phase to be tried


@dataclass(frozen=True, eq=False)
class FilmReadings:
    """Readings of a layer, and prior knowledge of it.

    Attributes
    ----------
    wavelength_nm
        Wavelengths in ascending order, shape (n,).
    readings
        Readings keyed ``T``, ``R`` or both.
    thickness
        Thickness from a micrometer; None if it was not measured.
    slit_nm
        Slit width; None if it is unknown.
    setup
        Conditions of the measurement on a substrate; None in air. If the bare substrate was measured, its index in the
        setup is the initial value of the fit.
    bare
        ``T`` and ``R`` of the bare substrate in air.
    """

    wavelength_nm: FloatArray
    readings: dict[str, Reading]
    thickness: Length | None = None
    slit_nm: float | None = None
    setup: Setup | None = None
    bare: dict[str, Reading] = field(default_factory=dict)


class FilmModel:
    """Parameters of a layer and the spectra that they predict.

    ``names`` contains the positions of the parameters in the parameter vector, keyed by name.
    """

    def __init__(
        self, measured: FilmReadings, start_n: float, optical_um: float, kind: Kind = "cauchy", *, coherent: bool = True
    ) -> None:
        nm = measured.wavelength_nm
        self.measured, self.start_n, self.optical_um = measured, start_n, optical_um
        self.coherent = coherent
        self.um = nm / NM_PER_UM
        x, ends = self.um**-2, (self.um[-1] ** -2, self.um[0] ** -2)
        self.centre = (ends[0] + ends[1]) / 2.0
        self.half = max((ends[1] - ends[0]) / 2.0, 1e-12)
        self.u = (x - self.centre) / self.half
        u_per_nm = -2.0 * self.um**-3 / self.half / NM_PER_UM
        self.fringes = 2.0 * optical_um * (1.0 / self.um[0] - 1.0 / self.um[-1])
        self.form = DispersionForm.of(kind, self.u, u_per_nm, free_knots(self.fringes))
        self.hats = _hats(nm, min(_KNOTS, max(2, nm.size // 8)))
        self.k_unit = 1e-4
        names = ["n", "rise", "bend", "ln_optical", "slit", "rough", "wedge", "other"]
        if measured.setup is not None:
            names += ["sheet", "sheet_rise", "sheet_bend"] if measured.bare else ["sheet"]
        names += [f"offset_{kind}" for kind in measured.readings]
        self.added = slice(len(names), len(names) + self.form.count)
        names += [f"added_{number}" for number in range(self.form.count)]
        self.names = {name: position for position, name in enumerate(names)}
        self.first_k = len(names)
        self.last_k = len(names) + self.hats.shape[1]
        self.size = self.last_k + self.hats.shape[1] * bool(measured.bare)
        self.blocks = {**measured.readings, **{f"bare_{kind}": reading for kind, reading in measured.bare.items()}}
        self.scatter = {kind: np.full(nm.size, _INITIAL_U) for kind in self.blocks}
        common = {kind: np.mean((reading.u_common**2).sum(axis=0)) for kind, reading in measured.readings.items()}
        self.u_offset = {kind: max(float(np.sqrt(variance)), 1e-6) for kind, variance in common.items()}

    def initial(self, phase: Phase) -> FloatArray:
        """Return initial parameters from the phase of the fringes, with the blur that fits their contrast best."""
        p = np.zeros(self.size)
        slit = self.measured.slit_nm
        values = {"n": self.start_n, "rise": self.start_n * phase.rise, "bend": self.start_n * phase.bend}
        for name, value in values.items():
            p[self.names[name]] = value
        p[self.first_k :] = 0.05
        return min((self.blurred(p, width) for width in ((slit,) if slit else (0.3, 1.0, 3.0))), key=self.cost)

    def cost(self, p: FloatArray) -> float:
        """Return the sum of squared weighted residuals."""
        residuals = self.residuals(p)
        return float(residuals @ residuals)

    def blurred(self, p: FloatArray, slit: float) -> FloatArray:
        """Return the parameters with the slit width given and the best-fitting thickness variation of a small grid."""
        if not self.coherent:
            return p
        phase = 4.0 * np.pi * self.optical_um * np.sqrt(self.centre)
        positions = [self.names[name] for name in ("slit", "rough", "wedge")]
        candidates = []
        for rough in _PHASE_SDS / phase:
            for wedge in _PHASE_HALF_RANGES / phase / np.sqrt(3.0):
                q = p.copy()
                q[positions] = slit, rough, wedge
                candidates.append(np.clip(q, *self.bounds))
        return min(candidates, key=self.cost)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the parameters."""
        low, high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        limits = {
            "n": (1.05, 4.5),
            "slit": (0.0, _MAX_SLIT_NM),
            "rough": (0.0, _MAX_THICKNESS_SD),
            "wedge": (0.0, _MAX_THICKNESS_SD),
        }
        for name, (minimum, maximum) in limits.items():
            low[self.names[name]], high[self.names[name]] = minimum, maximum
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
        """Return the causes of reduced contrast; if the model is incoherent, there are no fringes."""
        if not self.coherent:
            return Blur(0.0, 10.0)
        return Blur(*(p[self.names[name]] for name in ("slit", "rough", "wedge", "other")))

    def spectra(self, p: Any, blur: Blur | None = None) -> dict[str, Any]:
        """Return the modelled readings of the instrument, keyed by kind."""
        setup, nm = self.measured.setup, self.measured.wavelength_nm
        n, slope = self.index(p)
        k = self.k_unit * (self.hats @ p[self.first_k : self.last_k])
        sheet: tuple[Any, Any, Any] | None = None
        behind: Any = 1.0
        if setup is not None:
            behind, dark = self.sheet(p, setup)
            sheet = (behind, dark, setup.substrate.thickness_um)
        film = layer(n, slope, k, self.thickness(p), nm, behind, blur or self.blur(p))
        read = stacked(film, sheet, nm, setup)
        spectra = {kind: getattr(read, kind) + p[self.names[f"offset_{kind}"]] for kind in self.measured.readings}
        if sheet is not None and self.measured.bare:
            bare = incoherent([sheet[0]], [sheet[1]], [sheet[2]], nm)
            spectra["bare_T"] = bare.through + p[self.names["offset_T"]]
            spectra["bare_R"] = bare.front + p[self.names["offset_R"]]
        return spectra

    def sheet(self, p: Any, setup: Setup) -> tuple[Any, Any]:
        """Return the index and extinction of the sheet: as specified within its uncertainty, or as fitted."""
        specified_n = np.asarray(setup.substrate.n)
        if not self.measured.bare:
            u_n = np.asarray(setup.substrate.u_n)
            return specified_n + p[self.names["sheet"]] * np.where(u_n > 0.0, u_n, 1e-9), setup.substrate.k
        n, rise, bend = (p[self.names[name]] for name in ("sheet", "sheet_rise", "sheet_bend"))
        return specified_n + n + rise * self.u + bend * self.u**2, 0.1 * self.k_unit * (self.hats @ p[self.last_k :])

    def residuals(self, p: Any) -> Any:
        """Return the weighted residuals of the readings, followed by those of the priors."""
        spectra, rows = self.spectra(p), []
        for kind, reading in self.blocks.items():
            rows.append((spectra[kind] - reading.value) / self.scatter[kind])
        return np.concatenate([*rows, self.prior(p)])

    def prior(self, p: Any) -> Any:
        """Return the residuals of the priors, in standard uncertainties."""
        values = {name: p[position] for name, position in self.names.items()}
        u_bend = 1e-6 if self.form.kind == "sellmeier" else _U_BEND
        rows = [values["bend"] / u_bend, *(p[self.added] / _U_ADDED)]
        rows += [values[name] / _MAX_THICKNESS_SD for name in ("rough", "wedge")]
        rows.append(values["other"] / _U_CONTRAST)
        if (thickness := self.measured.thickness) is not None:
            u = U_THICKNESS * thickness.um if thickness.u_um is None else max(thickness.u_um, 1e-4 * thickness.um)
            rows.append((self.thickness(p) - thickness.um) / u)
        slit = self.measured.slit_nm
        rows.append(values["slit"] / _MAX_SLIT_NM if slit is None else (values["slit"] / slit - 1.0) / U_SLIT)
        if "sheet_bend" in values:
            rows.append(values["sheet_bend"] / _U_BEND)
        elif "sheet" in values:
            rows.append(values["sheet"])
        rows += [values[f"offset_{kind}"] / u for kind, u in self.u_offset.items()]
        return np.stack(rows)

    def slopes(self, p: FloatArray) -> FloatArray:
        """Return the derivatives of the residuals, computed by the complex-step method.

        A single step determines the derivatives for all knots of k, because each value depends only on the k at its
        wavelength.
        """
        columns = []
        for position in range(self.first_k):
            shifted = p.astype(complex)
            shifted[position] += 1j * STEP
            columns.append(self.residuals(shifted).imag / STEP)
        by_k = [self._slopes_by_k(p, first) for first in range(self.first_k, p.size, self.hats.shape[1])]
        return np.column_stack([*columns, *by_k])

    def _slopes_by_k(self, p: FloatArray, first: int) -> FloatArray:
        points, knots = self.hats.shape
        shifted = p.astype(complex)
        shifted[first : first + knots] += 1j * STEP
        by_k, count = self.residuals(shifted).imag / STEP, len(self.blocks)
        rows = np.zeros((by_k.size, knots))
        rows[: count * points] = np.tile(self.hats, (count, 1)) * by_k[: count * points, None]
        return rows

    def solve(self, p: FloatArray, steps: int = 25) -> tuple[FloatArray, float]:
        """Return the least-squares parameters from a start, and their sum of squares.

        The Levenberg-Marquardt steps do not change parameters at a bound that the step would cross.
        """
        low, high = self.bounds
        p = np.clip(p, low, high)
        residuals = self.residuals(p)
        cost, damping = float(residuals @ residuals), 1e-3
        for _ in range(steps):
            slope = self.slopes(p)
            gradient = slope.T @ residuals
            free = ~(((p <= low) & (gradient > 0.0)) | ((p >= high) & (gradient < 0.0)))
            normal = slope[:, free].T @ slope[:, free]
            previous_cost = cost
            for _ in range(6):
                step = np.zeros(p.size)
                step[free] = -np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), gradient[free])
                new_p = np.clip(p + step, low, high)
                new_residuals = self.residuals(new_p)
                new_cost = float(new_residuals @ new_residuals)
                if new_cost < cost:
                    p, residuals, cost, damping = new_p, new_residuals, new_cost, damping / 10.0
                    break
                damping = max(10.0 * damping, 1e-4)
            if previous_cost - cost < 0.01:
                break
        return p, cost

    def shifted_order(self, p: FloatArray, by: float) -> FloatArray:
        """Return parameters for fringes with orders higher by ``by`` and with phases as similar as possible."""
        names, basis = self.names, np.stack([np.ones_like(self.u), self.u, self.u**2], axis=1)
        shift = np.linalg.lstsq(basis, by * self.um / 2.0, rcond=None)[0]
        positions = [names[name] for name in ("n", "rise", "bend")]
        optical = self.optical_um * float(np.exp(p[names["ln_optical"]]))
        paths = optical * p[positions] / p[names["n"]] + shift
        shifted = p.copy()
        shifted[positions[1:]] = p[names["n"]] * paths[1:] / paths[0]
        shifted[names["ln_optical"]] = np.log(paths[0] / self.optical_um)
        return shifted

    def with_free_index(self, p: FloatArray) -> "tuple[FilmModel, FloatArray]":
        """Return the same model with a free index, and its initial parameters."""
        model = FilmModel(self.measured, self.start_n, self.optical_um, "free", coherent=self.coherent)
        return model, np.insert(p, self.added.start, np.zeros(model.form.count))

    def phase_matched(self, p: FloatArray) -> FloatArray:
        """Return parameters whose phases match those of the measured fringes.

        The phase difference is unwrapped and is between −π and π where the fringes are strongest.
        """
        n, h = self.index(p)[0], self.thickness(p)
        width = max(5, round(2.0 * self.um.size / self.fringes))
        carrier = np.exp(-4j * np.pi * n * h / self.um)

        def wave(values: dict[str, Any]) -> Any:
            total = sum(values[kind] * (1.0 if kind == "T" else -1.0) for kind in self.measured.readings)
            product = (total - uniform_filter1d(total, width)) * carrier
            return uniform_filter1d(product.real, width) + 1j * uniform_filter1d(product.imag, width)

        read = wave({kind: reading.value for kind, reading in self.measured.readings.items()})
        phase = np.unwrap(np.angle(read * np.conj(wave(self.spectra(p)))))
        weight = np.abs(read)[:, None]
        phase -= 2.0 * np.pi * np.round(phase[np.argmax(weight)] / (2.0 * np.pi))
        u = self.u
        terms = np.column_stack([np.ones_like(u), u, u**2, self.form.curves])
        change = np.linalg.lstsq(weight * terms, weight[:, 0] * phase * self.um / (4.0 * np.pi * h), rcond=None)[0]
        matched = p.copy()
        matched[self.names["ln_optical"]] += change[0] / p[self.names["n"]]
        matched[[self.names["rise"], self.names["bend"]]] += change[1:3]
        matched[self.added] += change[3:]
        return matched

    def block_residuals(self, p: FloatArray) -> dict[str, FloatArray]:
        """Return measured minus modelled values of each reading."""
        spectra = self.spectra(p)
        return {kind: reading.value - spectra[kind] for kind, reading in self.blocks.items()}

    def has_misfit(self, p: FloatArray, max_factor: float = 1.0) -> bool:
        """Whether the residuals exceed the scatter of the repeat measurements or, if there are none, are correlated.

        ``max_factor`` is the largest `variance_factor` that is attributed to noise if there are no repeat measurements.
        """
        scatter = {kind: float(np.mean(reading.u_random**2)) for kind, reading in self.blocks.items()}
        if any(scatter.values()):
            return any(
                0.0 < scatter[kind] < float(np.mean(residuals**2)) / _MAX_VARIANCE_RATIO
                for kind, residuals in self.block_residuals(p).items()
            )
        return self.variance_factor(p) > max_factor

    def variance_factor(self, p: FloatArray) -> float:
        """Return the factor on the variance that accounts for a correlation of neighbouring residuals."""
        factor = 1.0
        for residuals in self.block_residuals(p).values():
            rho = float(np.sum(residuals[1:] * residuals[:-1]) / max(np.sum(residuals**2), 1e-300))
            if rho > 2.33 / np.sqrt(residuals.size):
                factor = max(factor, (1.0 + min(rho, 0.9)) / (1.0 - min(rho, 0.9)))
        return factor

    def log_likelihood(self, p: FloatArray) -> float:
        """Return the log-likelihood of the readings with unknown scatter, up to a constant."""
        residuals = self.block_residuals(p).values()
        return -0.5 * float(sum(block.size * np.log(np.mean(block**2)) for block in residuals))

    def set_scatter(self, p: FloatArray) -> None:
        """Set the scatter of the readings to that of the residuals, or of the repeat measurements if that is larger."""
        for kind, residuals in self.block_residuals(p).items():
            df = max(residuals.size - self.size / len(self.blocks), residuals.size / 4.0)
            sd = max(float(np.sqrt(np.sum(residuals**2) / df)), 1e-9)
            self.scatter[kind] = np.maximum(sd, self.blocks[kind].u_random)


def _hats(nm: FloatArray, count: int) -> FloatArray:
    """Return piecewise linear functions of wavelength, each equal to 1 at one of ``count`` knots, shape (n, count)."""
    knots = np.linspace(nm[0], nm[-1], count)
    return np.stack([np.interp(nm, knots, row) for row in np.eye(count)], axis=1)
