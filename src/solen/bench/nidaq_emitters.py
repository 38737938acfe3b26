"""Tasks of NI-DAQmx that switch the emitters synchronously with the samples: with counters, or with digital lines.

A counter generates pulses from the first sample on; on devices that support it, digital lines follow the sampling
clock. Both then run without further commands.

Public names: `counter_task`, `lines_task` and `clear`.
"""

import contextlib
from typing import Any

import numpy as np

from solen.bench.daq import Setup
from solen.bench.drivers import on_failure


def counter_task(ni: Any, device: str, setup: Setup, emitter: int, counter: str, terminal: str) -> tuple[Any, float]:
    """Return the task of a counter that switches an emitter on in the first half of its slot, and its rate in Hz."""
    constants, task = ni.constants, ni.Task()
    with on_failure(lambda: clear(task, ni)):
        channel = task.co_channels.add_co_pulse_chan_freq(
            f"{device}/{counter}",
            idle_state=constants.Level.LOW,
            initial_delay=emitter / (setup.emitters * setup.switch_hz),
            freq=setup.switch_hz,
            duty_cycle=0.5 / setup.emitters,
        )
        if terminal:
            channel.co_pulse_term = f"/{device}/{terminal}"
        task.timing.cfg_implicit_timing(sample_mode=constants.AcquisitionType.CONTINUOUS)
        task.triggers.start_trigger.cfg_dig_edge_start_trig(f"/{device}/ai/StartTrigger")
        task.control(constants.TaskMode.TASK_COMMIT)
        return task, float(channel.co_pulse_freq)


def lines_task(ni: Any, device: str, setup: Setup) -> Any:
    """Return the task of lines that follow the sampling clock: one second of switching, repeated."""
    constants, task = ni.constants, ni.Task()
    half = setup.frame // (2 * setup.emitters)
    period = np.zeros((setup.emitters, setup.frame), bool)
    for emitter in range(setup.emitters):
        period[emitter, 2 * emitter * half : (2 * emitter + 1) * half] = True
    pattern = np.tile(period, max(1, round(setup.switch_hz)))
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
