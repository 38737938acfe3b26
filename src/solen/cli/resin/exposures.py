"""The command that compares layers with different exposures."""

import math
from collections.abc import Iterator

from solen.cli.app import lines
from solen.material.cure.exposures import ExposureTrends, Trend
from solen.pipeline.resin.exposures import exposures as exposures


@lines.register
def _(trends: ExposureTrends) -> Iterator[str]:
    yield "exposure (s)  " + "  ".join(f"{seconds:7g}" for seconds in trends.exposure_s)
    for row in trends.wavelengths:
        for name, values, line in (("T", row.T, row.trend_T), ("n", row.n, row.trend_n)):
            if line is not None:
                cells = ("      -" if math.isnan(value) else f"{value:7.4f}" for value in values)
                yield f"{name} {row.wavelength_nm:7g} nm  " + "  ".join(cells)
                yield f"    {name} changes by {_slope(line)}"


def _slope(line: Trend) -> str:
    ends = line.interval95_slope_per_s
    interval = "no interval from two samples" if ends is None else f"{ends[0]:+.2g} to {ends[1]:+.2g}, 95 %"
    return f"{line.slope_per_s:+.3g} per s ({interval})"
