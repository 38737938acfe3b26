"""Multimeters, one for each input, by VISA and SCPI, in steady light.

The queries are sent to all meters before the first reply is read; the meters thus measure almost simultaneously. For a
reading outside the range SCPI specifies the value 9.9E37, which is treated as clipped (SCPI-1999, volume 1, 7.2.1.5).

Public name: `Multimeters`.
"""

import math

import numpy as np

from solen.bench.clock import Clock
from solen.bench.drivers import on_failure
from solen.bench.meter import PolledMeter, Reading, steady_reading
from solen.bench.visa import Scpi, open_all

OVERRANGE = 9.0e37
"""Absolute value above which a reading means overrange, or not a number."""


class Multimeters(PolledMeter):
    """Multimeters, one for each input.

    Parameters
    ----------
    clock
        Clock of the run.
    addresses
        VISA address of the meter of each input.
    query
        Query whose reply is a reading: ``READ?``, ``MEAS:VOLT:DC?``, ``FETC?``.
    setup
        Commands to each meter before the first reading.
    unit
        Unit of the readings.
    backend, timeout_s
        PyVISA's name of the library, and time limit in s for a reply.

    Raises
    ------
    BenchError
        If a meter does not reply, or rejects a command.
    """

    def __init__(
        self,
        clock: Clock,
        addresses: tuple[str, ...],
        *,
        query: str = "READ?",
        setup: tuple[str, ...] = (),
        unit: str = "V",
        backend: str = "@py",
        timeout_s: float = 5.0,
    ) -> None:
        self._meters = open_all(addresses, lambda name: Scpi(name, backend=backend, timeout_s=timeout_s))
        with on_failure(self.release):
            for meter in self._meters:
                meter.send_commands(setup)
        self._query = query
        name = " and ".join(dict.fromkeys(meter.identity for meter in self._meters))
        super().__init__(name, clock, inputs=len(addresses), unit=unit, switched=False)

    def measure(self) -> Reading:
        """Return one reading of each meter."""
        sent_s = self._clock.now_s()
        for meter in self._meters:
            meter.write(self._query)
        values = np.array([_value(meter, self._query) for meter in self._meters])
        overrange = np.abs(values) > OVERRANGE
        return steady_reading(sent_s, self._clock.now_s(), np.where(overrange, np.nan, values), overrange)

    def release(self) -> None:
        """Close the sessions."""
        for meter in self._meters:
            meter.close()


def _value(meter: Scpi, query: str) -> float:
    """Return the number in a reply; raise `BenchError` if the reply is not a number."""
    reply = meter.read()
    try:
        value = float(reply)
    except ValueError:
        limit = f"replied {reply[:40]!r} to {query}, which is not one number"
        raise meter.error(limit, "set meter.ask to a query whose reply is one reading") from None
    return math.inf if math.isnan(value) else value
