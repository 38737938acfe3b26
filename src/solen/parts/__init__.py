"""Parts: what datasheets say of emitters, receivers, converters and trimmers, and what a design's emitter is.

`solen.parts.datasheet` holds the files and the library, `solen.parts.light` a design's emitter with the part it names.
"""

from solen.parts.datasheet import (
    AdcPart,
    AdcRange,
    EmitterPart,
    Part,
    PatternPart,
    Quantity,
    ReceiverPart,
    SpectrumPart,
    TrimmerPart,
    library,
    library_part,
    load_part,
)
from solen.parts.light import Light, light_of

__all__ = [
    "AdcPart",
    "AdcRange",
    "EmitterPart",
    "Light",
    "Part",
    "PatternPart",
    "Quantity",
    "ReceiverPart",
    "SpectrumPart",
    "TrimmerPart",
    "library",
    "library_part",
    "light_of",
    "load_part",
]
