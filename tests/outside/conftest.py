"""The folder of data from other sources."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def outside() -> Path:
    """Return the folder of outside data; skip the test if it is missing."""
    default = Path(__file__).resolve().parents[3] / "shared" / "data"
    folder = Path(os.environ.get("SOLEN_OUTSIDE_DATA", default))
    if not (folder / "raytrace").is_dir():
        pytest.skip(f"no raytrace/ in the outside data at {folder}: set SOLEN_OUTSIDE_DATA")
    return folder
