"""Numbers as JSON holds them."""

import math


def number(value: float) -> float | None:
    """A plain float, or None for what JSON cannot hold."""
    return float(value) if math.isfinite(value) else None
