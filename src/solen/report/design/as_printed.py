"""Sentences that compare the printed lens with the designed lens."""

import numpy as np

from solen.report.design.summary import measured
from solen.sensor import AsPrinted, Comparison

RESOLVED = 2.0
"""A difference is resolved if it exceeds its uncertainty by this factor."""


def printed_sentences(as_printed: AsPrinted) -> list[str]:
    """Return sentences on how printing changes the lens and the response."""
    deviation, fit = as_printed.lens.fit.deviation, as_printed.lens.fit
    more = "more" if deviation.max_um > 0.0 else "less"
    lines = [
        f"The lens {as_printed.label} deviates from the designed lens by {deviation.rms_um:.3g} µm RMS and by at most "
        f"{abs(deviation.max_um):.3g} µm ({more} material, at x = {deviation.max_x_mm:.2f} mm); its points have an "
        f"uncertainty of {fit.u_rms_um:.2g} µm and were smoothed over {fit.smooth.resolution_mm:.2g} mm."
    ]
    return lines + [
        _compared(comparison) for comparison in (as_printed.emitter, as_printed.chip) if comparison is not None
    ]


def _compared(comparison: Comparison) -> str:
    largest, width_mm = comparison.largest, comparison.width_mm
    emitter = f"With a chip {width_mm:g} mm wide" if width_mm > 0.0 else "With a point emitter"
    if largest is None:
        return f"{emitter}, no light reaches the receivers."
    resolved = np.any(np.abs(comparison.difference) > RESOLVED * comparison.u_difference)
    text = (
        f"{emitter}, the contrast differs by up to {measured(largest.contrast, largest.u_contrast)}, at "
        f"{largest.angle_deg:+g}°{'' if resolved else '; this difference is not resolved'}."
    )
    if comparison.null_shift_deg is not None and comparison.u_null_shift_deg is not None:
        text += f" The null moves by {measured(comparison.null_shift_deg, comparison.u_null_shift_deg)}°."
    after, before = comparison.printed.received_share, comparison.designed.received_share
    return f"{text} The receivers receive {after:.2%} of the light, {before:.2%} as designed."
