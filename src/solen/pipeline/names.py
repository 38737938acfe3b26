"""Names of output files, derived from the input file."""

import re
from pathlib import Path


def stem_of(path: Path) -> str:
    """Return the name of a file without its extension, in characters that every system allows."""
    return re.sub(r'[<>:"/\\|?*\s]+', "-", path.stem) or "part"
