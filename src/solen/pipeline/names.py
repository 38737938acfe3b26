"""Names of output files, derived from the input file."""

import re
from pathlib import Path


def stem_of(path: Path) -> str:
    """Name of a file without its extension, in characters allowed on every system."""
    return re.sub(r'[<>:"/\\|?*\s]+', "-", path.stem) or "part"
