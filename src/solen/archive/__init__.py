"""Archives of one sensor, for sharing: design, resin, print, images, recordings, calibration and figures.

An archive is a folder or a zip file with a description of its contents as RO-Crate metadata: size, SHA-256 checksum,
kind and quantities with units for each file, and authors and licence for the entire archive. Each file is read once
with the readers of solen when it is packed, and everything is checked again when the archive is unpacked.

`pack` collects and describes files, and `Archive.save` writes them; `opened` checks a received archive, and
`Opened.save` unpacks it.
"""

from solen.archive.contents import Item as Item
from solen.archive.contents import described as described
from solen.archive.metadata import NAME as NAME
from solen.archive.packed import Archive as Archive
from solen.archive.packed import PackOptions as PackOptions
from solen.archive.packed import pack as pack
from solen.archive.unpacked import Limits as Limits
from solen.archive.unpacked import Opened as Opened
from solen.archive.unpacked import opened as opened
