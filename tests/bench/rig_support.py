"""A small simulated rig with a board or a DAQ device, and a short protocol for it."""

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
DAQS = {"counter": 'switching = "counter"', "sync": 'sync = "ai8"'}
"""Settings of a simulated DAQ device."""


def daq_rig(settings: str = DAQS["counter"], rig: str = RIG) -> str:
    """Return the rig with a DAQ device instead of the board."""
    return rig.replace("[board]", f"[daq]\n{settings}")
