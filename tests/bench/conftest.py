"""A small simulated rig: one traced sensor and its control, quick enough to run many times."""

from pathlib import Path

import pytest

from solen.spec import template
from tests.bench.rig_support import PROTOCOL, RIG


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """Folder with rig.toml, protocol.toml and sensor.toml."""
    (tmp_path / "sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    (tmp_path / "protocol.toml").write_text(PROTOCOL, encoding="utf-8")
    return tmp_path
