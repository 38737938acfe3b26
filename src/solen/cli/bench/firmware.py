"""The command `solen bench firmware`, which writes firmware for boards."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.pipeline.bench import firmware as pipeline
from solen.pipeline.bench.firmware import firmware as firmware


@lines.register
def _(result: pipeline.Firmware) -> Iterator[str]:
    step = "copy the files onto a board with MicroPython"
    if result.board == "uno":
        step = "open the sketch in the Arduino IDE and upload it"
    yield f"next: {step}; docs/board.md lists the pins"
    values = f"bits = {result.bits}, range_v = {result.range_V}, baud = {result.baud}"
    if result.linear_V is not None:
        values += f", linear_v = {list(result.linear_V)}"
    yield f'[board] of the rig: driver = "serial", {values}'
