"""Parts: data of emitters, receivers, ADCs, trimmers and printers, and the light of an emitter.

`solen.parts.datasheet` defines part files and the library, `solen.parts.light` the light of a design's emitter, and
`solen.parts.printer` the printers.
"""

from solen.parts.datasheet import (
    AdcPart,
    AdcRange,
    EmitterPart,
    Part,
    PatternPart,
    Quantity,
    ReceiverPart,
    TrimmerPart,
    library,
    library_part,
    load_part,
)
from solen.parts.light import Light, light_of
from solen.parts.printer import (
    Printer,
    PrinterList,
    PrinterSummary,
    library_printer,
    load_printer,
    printer_of,
    printers,
)

__all__ = [
    "AdcPart",
    "AdcRange",
    "EmitterPart",
    "Light",
    "Part",
    "PatternPart",
    "Printer",
    "PrinterList",
    "PrinterSummary",
    "Quantity",
    "ReceiverPart",
    "TrimmerPart",
    "library",
    "library_part",
    "library_printer",
    "light_of",
    "load_part",
    "load_printer",
    "printer_of",
    "printers",
]
