"""Multimeters as receivers: one for each input, by VISA and SCPI, in steady light.

The idea: all are asked at once and then heard one after the other, so that they measure side by side. A reading beyond
the range is what SCPI says it is, 9.9E37, and clipped (SCPI-1999, volume 1, 7.2.1.5).

The interface: `Multimeters`, a `Meter`.
"""

import math

import numpy as np

from solen.bench.clock import Clock
from solen.bench.meter import AskingMeter, Reading, steady
from solen.bench.visa import Scpi, all_or_none, opened_all

OVER = 9.0e37
"""Larger values mean overrange, or not a number."""


class Multimeters(AskingMeter):
    """Multimeters, one for each input.

    Parameters
    ----------
    clock
        Clock of the run.
    addresses
        Of each input's, as VISA calls it.
    ask
        The question that is answered by a reading: ``READ?``, ``MEAS:VOLT:DC?``, ``FETC?``.
    setup
        Commands to each, before the first reading.
    unit
        Unit of what they read.
    backend, answer_s
        PyVISA's name of the library, and how long an answer may take.

    Raises
    ------
    BenchError
        If one is not there, or takes a command not.
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
        """One reading of each meter."""
        sent_s = self._clock.now_s()
        for one in self._all:
            one.say(self._question)
        values = np.array([_value(one, self._question) for one in self._all])
        beyond = np.abs(values) > OVER
        return steady(sent_s, self._clock.now_s(), np.where(beyond, np.nan, values), beyond)

    def release(self) -> None:
        """End the sessions."""
        for one in self._all:
            one.close()


def _value(one: Scpi, question: str) -> float:
    """The number that answers; `BenchError` for anything else."""
    answer = one.heard()
    try:
        value = float(answer)
    except ValueError:
        raise one.refusal(f"answered {answer[:40]!r} to {question}", "ask for one reading: meter.ask") from None
    return math.inf if math.isnan(value) else value
