"""Units inside solen are mm, nm, degrees and fractions of the emitted power; they are converted here, at the doors."""

NM_PER_UM = 1e3


def um_from_nm(wavelength_nm: float) -> float:
    """Wavelength in micrometres, as dispersion formulas take it."""
    return wavelength_nm / NM_PER_UM
