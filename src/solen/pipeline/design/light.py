"""Light that is named on the command line: a part of the library, a file of a part, or a measured spectrum."""

from pathlib import Path

from solen.errors import DataError
from solen.material.index.light import Light, led, measured_light
from solen.parts import EmitterPart, library, library_part, load_part
from solen.pipeline.resin.traces import listed
from solen.recording import read, spectra


def light_named(name: str) -> tuple[Light, str]:
    """Light, and in words where it comes from.

    ``name`` is that of a part of the library, or a file: ``.toml`` of a part, any other of a spectrum with columns of
    wavelength and power.
    """
    if name in library() or not Path(name).suffix:
        return _of_part(library_part(name))
    path = Path(name)
    if path.suffix.lower() == ".toml":
        return _of_part(load_part(path))
    recording = read(path)
    every = spectra(recording)
    if len(every) != 1:
        names = listed([one.channel.name for one in every])
        limit = f"needs one column of power beside the wavelength; it has {names}"
        raise DataError(recording.provenance.file, limit=limit)
    light = measured_light(every[0].wavelength_nm, every[0].channel.values)
    return light, f"spectrum of {recording.provenance.file}"


def _of_part(part: object) -> tuple[Light, str]:
    if not isinstance(part, EmitterPart):
        raise DataError("--led", value=getattr(part, "name", None), limit="is no emitter")
    peak_nm, fwhm_nm = part.peak_nm.usual, part.fwhm_nm.usual if part.fwhm_nm else None
    width = f", {fwhm_nm:g} nm wide" if fwhm_nm else ", its width not known"
    return led(peak_nm, fwhm_nm), f"{part.name}, peak at {peak_nm:g} nm{width}"
