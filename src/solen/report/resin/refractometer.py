"""The refractometer figure: measured indices, the fitted curve with its band, and the literature."""

from matplotlib.figure import Figure

from solen.material.index.literature import RESINS, band
from solen.material.index.refractometer import Z95, RefractometerIndex
from solen.report.canvas import LEFT, RIGHT, SOFT


def refractometer_figure(index: RefractometerIndex) -> Figure:
    """Draw index against wavelength with its 95 % interval, over the range of the literature."""
    nm, interval = index.wavelength_nm, index.interval95_n
    polymers = index.options.polymers if index.options else RESINS
    literature = band(nm, polymers, package=False)
    figure = Figure(figsize=(6.4, 4.0))
    axes = figure.subplots()
    names = " and ".join(f"{polymer}s" for polymer in polymers)
    axes.fill_between(nm, literature.low, literature.high, color=SOFT, lw=0, label=f"literature of {names}")
    axes.fill_between(nm, *interval.T, color=RIGHT, alpha=0.25, lw=0, label="95 %")
    abbe = f"{index.abbe:.0f} ± {index.u_abbe:.0f}"
    axes.plot(nm, index.n, color=RIGHT, lw=1.6, label=f"n, Abbe number {abbe}")
    u95 = Z95 * index.u_measured_n
    axes.errorbar(index.measured_nm, index.measured_n, u95, fmt="o", color=LEFT, ms=4, capsize=3, label="measured")
    axes.set(xlabel="wavelength (nm)", ylabel="refractive index n", xlim=(nm[0], nm[-1]))
    axes.legend()
    axes.set_title(f"n = {index.n_D:.4f} ± {index.u_n_D:.1g} at 589.3 nm, extended by the dispersion of polymers")
    return figure
