"""The command `solen bench firmware`, which writes firmware for boards."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.pipeline.bench import firmware as pipeline
from solen.pipeline.bench.firmware import firmware as firmware


@lines.register
def _(result: pipeline.Firmware) -> Iterator[str]:
    how = "open the sketch in the Arduino IDE" if result.board == "uno" else "copy the files onto one with MicroPython"
    yield f"next: {how}; docs/board.md lists the wiring of the pins"
    states = f"bits = {result.bits}, range_v = {result.range_V}, baud = {result.baud}"
    if result.straight_V is not None:
        states += f", straight_v = {list(result.straight_V)}"
    yield f'[board] of the rig: driver = "serial", {states}'
