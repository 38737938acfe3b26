"""Selection of the evaluations for which a resin recording has the required columns."""

from collections.abc import Callable

from solen.errors import DataError
from solen.material.cure.disc_table import DOSES, THICKNESSES, TIMES
from solen.material.cure.exposures import samples_of
from solen.material.loss.readings import LENGTHS, LOSSES, POWERS
from solen.material.stiffness.columns import FORCE, STRESS, TRUE_STRESS
from solen.recording import Recording
from solen.recording.optical import kind_of


def evaluations(recording: Recording) -> tuple[str, ...]:
    """Return the names of the evaluations that suit a recording, such as ``cure``, the most probable first.

    Raises
    ------
    DataError
        If no evaluation suits it.
    """
    names = tuple(name for name, suits in _SUITS.items() if suits(recording))
    if not names:
        columns = ", ".join((*recording.names, *recording.texts)[:12])
        limit = f"suits no evaluation of a resin: its columns are {columns}"
        remedy = (
            "use columns such as wavelength_nm and T, thickness_um and dose_mJ_per_cm2, length_mm and power_uW, or "
        )
        raise DataError(recording.provenance.name, limit=limit, remedy=f"{remedy}force_N and travel_mm")
    return names


def _spectrum_kinds(recording: Recording) -> set[str | None]:
    """Return the kinds of the spectra in a recording: T, R and A, and None if there is any other kind."""
    axes = {channel.name for channel in recording.channels if channel.quantity == "wavelength"}
    return {kind_of(channel) for channel in recording.channels if channel.axis in axes and channel.name not in axes}


def _has_exposures(recording: Recording) -> bool:
    try:
        return "T" in _spectrum_kinds(recording) and len({sample.exposure_s for sample in samples_of(recording)}) > 1
    except DataError:
        return False


def _has_discs(recording: Recording) -> bool:
    return recording.find(*THICKNESSES) is not None and recording.find(*DOSES, *TIMES) is not None


def _has_guides(recording: Recording) -> bool:
    return recording.find(*LENGTHS) is not None and recording.find(*POWERS, *LOSSES) is not None


_OPTICAL = {"T", "R", "A"}
_SUITS: dict[str, Callable[[Recording], bool]] = {
    "exposures": _has_exposures,
    "index": lambda recording: bool(_spectrum_kinds(recording) & {"T", "R"}),
    "penetration": lambda recording: bool(_spectrum_kinds(recording) & {"A", "T"}),
    "stiffness": lambda recording: recording.find(*FORCE, *STRESS, *TRUE_STRESS) is not None,
    "cure": lambda recording: not _spectrum_kinds(recording) & _OPTICAL and _has_discs(recording),
    "cutback": lambda recording: not _spectrum_kinds(recording) & _OPTICAL and _has_guides(recording),
    "spectra": lambda recording: bool(_spectrum_kinds(recording)),
}
