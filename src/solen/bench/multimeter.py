"""Multimeters as receivers: one for each input, by VISA and SCPI, in steady light.

All meters are queried at once and read one after the other, and thus measure simultaneously. A reading beyond the range
is 9.9E37 in SCPI, and counts as clipped (SCPI-1999, volume 1, 7.2.1.5).

Public name: `Multimeters`.
"""

import math

import numpy as np

from solen.bench.clock import Clock
from solen.bench.meter import AskingMeter, Reading, steady
from solen.bench.visa import Scpi, all_or_none, opened_all

OVER = 9.0e37
"""Values above this mean overrange, or not a number."""


class Multimeters(AskingMeter):
    """Multimeters, one for each input.

    Parameters
    ----------
    clock
        Clock of the run.
    addresses
        VISA address of the meter of each input.
    ask
        The query that is answered by a reading: ``READ?``, ``MEAS:VOLT:DC?``, ``FETC?``.
    setup
        Commands to each meter before the first reading.
    unit
        Unit of the readings.
    backend, answer_s
        PyVISA's name of the library, and longest duration of an answer.

    Raises
    ------
    BenchError
        If a meter does not answer, or rejects a command.
    """

    def __init__(
        self,
        clock: Clock,
        addresses: tuple[str, ...],
        *,
        ask: str = "READ?",
        setup: tuple[str, ...] = (),
        unit: str = "V",
        backend: str = "@py",
        answer_s: float = 5.0,
    ) -> None:
        self._all = opened_all(addresses, lambda name: Scpi(name, backend=backend, answer_s=answer_s))
        with all_or_none(self._all):
            for one in self._all:
                one.commanded(setup)
        self._question = ask
        name = " and ".join(dict.fromkeys(one.identity for one in self._all))
        super().__init__(name, clock, inputs=len(addresses), unit=unit, switched=False)

    def measure(self) -> Reading:
        """Return one reading of each meter."""
        sent_s = self._clock.now_s()
        for one in self._all:
            one.say(self._question)
        values = np.array([_value(one, self._question) for one in self._all])
        beyond = np.abs(values) > OVER
        return steady(sent_s, self._clock.now_s(), np.where(beyond, np.nan, values), beyond)

    def release(self) -> None:
        """Close the sessions."""
        for one in self._all:
            one.close()


def _value(one: Scpi, question: str) -> float:
    """Return the number in an answer; raise `BenchError` for anything else."""
    answer = one.heard()
    try:
        value = float(answer)
    except ValueError:
        raise one.refusal(
            f"answered {answer[:40]!r} to {question}", "use a query that is answered by one reading: meter.ask"
        ) from None
    return math.inf if math.isnan(value) else value
