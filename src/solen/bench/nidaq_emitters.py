"""Tasks of NI-DAQmx that switch emitters in step with the samples: with counters, or with digital lines.

A counter generates pulses by itself from the first sample on; if a device supports it, lines follow the clock of the
samples, sample by sample. Both then run without further commands.

Public names: `pulses`, `turns` and `clear`.
"""

import contextlib
from typing import Any

import numpy as np

from solen.bench.daq import Setup
from solen.bench.drivers import on_failure


def pulses(ni: Any, device: str, setup: Setup, place: int, counter: str, terminal: str) -> tuple[Any, float]:
    """Return the pulses for an emitter, on for the first half of its slot from the first sample, and their rate."""
    constants, task = ni.constants, ni.Task()
    with on_failure(lambda: clear(task, ni)):
        channel = task.co_channels.add_co_pulse_chan_freq(
            f"{device}/{counter}",
            idle_state=constants.Level.LOW,
            initial_delay=place / (setup.emitters * setup.switch_hz),
            freq=setup.switch_hz,
            duty_cycle=0.5 / setup.emitters,
        )
        if terminal:
            channel.co_pulse_term = f"/{device}/{terminal}"
        task.timing.cfg_implicit_timing(sample_mode=constants.AcquisitionType.CONTINUOUS)
        task.triggers.start_trigger.cfg_dig_edge_start_trig(f"/{device}/ai/StartTrigger")
        task.control(constants.TaskMode.TASK_COMMIT)
        return task, float(channel.co_pulse_freq)


def turns(ni: Any, device: str, setup: Setup) -> Any:
    """Return the task of lines that follow the clock of the samples: one second of switching, repeated."""
    constants, task = ni.constants, ni.Task()
    half = setup.frame // (2 * setup.emitters)
    turn = np.zeros((setup.emitters, setup.frame), bool)
    for emitter in range(setup.emitters):
        turn[emitter, 2 * emitter * half : (2 * emitter + 1) * half] = True
    pattern = np.tile(turn, max(1, round(setup.switch_hz)))
    with on_failure(lambda: clear(task, ni)):
        for line in setup.lines:
            task.do_channels.add_do_chan(f"{device}/{line}", line_grouping=constants.LineGrouping.CHAN_PER_LINE)
        task.timing.cfg_samp_clk_timing(
            setup.rate_hz,
            source=f"/{device}/ai/SampleClock",
            sample_mode=constants.AcquisitionType.CONTINUOUS,
            samps_per_chan=pattern.shape[1],
        )
        task.write(pattern if setup.emitters > 1 else pattern[0], auto_start=False)
        return task


def clear(task: Any, ni: Any) -> None:
    """Release a task, whatever its state."""
    with contextlib.suppress(ni.errors.Error):
        task.close()
