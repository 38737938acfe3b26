"""Where the data of others lies."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def outside() -> Path:
    """The folder of outside data; the test is skipped where it is absent."""
    default = Path(__file__).resolve().parents[3] / "shared" / "data"
    folder = Path(os.environ.get("SOLEN_OUTSIDE_DATA", default))
    if not (folder / "raytrace").is_dir():
        pytest.skip(f"no raytrace/ in the outside data at {folder}: set SOLEN_OUTSIDE_DATA")
    return folder
