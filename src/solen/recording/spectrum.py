"""Spectra of a recording: each trace with its wavelengths in nm.

The interface: `spectra` of a recording; `Spectrum.ratio` for values without percent.
"""

from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.recording.model import Channel, Recording

_MOST_RATIO = 2.0  # a ratio of light beyond this has a percentage in it


@dataclass(frozen=True)
class Spectrum:
    """One trace of a recording.

    Attributes
    ----------
    wavelength_nm
        Shape (n,), in the order of the file, which may be downwards.
    channel
        The trace: name, quantity, unit, values of shape (n,) and note.
    """

    wavelength_nm: FloatArray
    channel: Channel

    def ratio(self) -> FloatArray:
        """Values as pure numbers, 0.91 for 91 %; `DataError` for a unit that is none, or values that need one."""
        channel = self.channel
        if channel.unit:
            return channel.to("1")
        top = float(np.nanmax(np.abs(channel.values), initial=0.0))
        if channel.quantity in {"transmittance", "reflectance", "absorptance"} and top > _MOST_RATIO:
            remedy = f"write {channel.name} (%) in the header if it is in percent"
            raise DataError(channel.name, value=top, limit="has no unit and is no fraction", remedy=remedy)
        return channel.values


def spectra(recording: Recording) -> tuple[Spectrum, ...]:
    """All traces of a recording that run along a wavelength; `DataError` where there is none."""
    axes = {one.name: one for one in recording.channels if one.quantity == "wavelength"}
    found = tuple(Spectrum(axes[one.axis].to("nm"), one) for one in recording.channels if one.axis in axes)
    if not found:
        remedy = "name the column of wavelengths wavelength_nm" if not axes else "add a column of values"
        raise DataError(recording.provenance.file or "recording", limit="holds no spectrum", remedy=remedy)
    return found
