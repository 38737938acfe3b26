"""Names of files that a command makes after the file that it was given."""

import re
from pathlib import Path


def stem_of(path: Path) -> str:
    """Name of a file without its ending, as one that every system takes."""
    return re.sub(r'[<>:"/\\|?*\s]+', "-", path.stem) or "part"
