"""A small simulated rig: one traced sensor and its control, quick enough to run many times."""

from pathlib import Path

import pytest

from solen.spec import template

RIG = """
schema = 1
name = "small rig"
seed = 5
[board]
trim_v = 1.0
[[sensor]]
name = "A"
design = "sensor.toml"
emitter = 1
right = 1
left = 2
[[sensor]]
name = "B"
design = "sensor.toml"
lens = false
emitter = 2
right = 4
left = 3
[ambient]
mean_mw_cm2 = 0.05
flicker_percent = 20.0
drift_percent_per_min = 50.0
"""
PROTOCOL = """
schema = 1
name = "short"
cycles = 3
rest_s = 0.2
[[step]]
to_deg = -3.0
velocity_deg_per_s = 15.0
hold_s = 0.1
[[step]]
to_deg = 3.0
velocity_deg_per_s = 15.0
hold_s = 0.1
[[step]]
to_deg = 0.0
velocity_deg_per_s = 15.0
"""


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """Folder with rig.toml, protocol.toml and sensor.toml."""
    (tmp_path / "sensor.toml").write_text(template(), encoding="utf-8")
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    (tmp_path / "protocol.toml").write_text(PROTOCOL, encoding="utf-8")
    return tmp_path
