"""Signals that end a run: the first one ends it, later ones are ignored, and protected code is completed first."""

import signal
import sys
import threading

import pytest

from solen.bench.interrupts import Ended, ended_by_signals, uninterrupted

pytestmark = pytest.mark.usefixtures("signals")

SIGNALS = [name for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)]


def raise_twice(number: int, steps: list[str]) -> None:
    """Raise a signal, and another one during the clean-up."""
    with ended_by_signals():
        try:
            signal.raise_signal(number)
            steps.append("continued")
        finally:
            signal.raise_signal(signal.SIGINT)
            steps.append("cleaned up")


@pytest.mark.parametrize("name", SIGNALS)
def test_first_signal_ends_run(name: str) -> None:
    number = getattr(signal, name)
    steps: list[str] = []
    handler = signal.getsignal(number)
    with pytest.raises(Ended, match=f"ended by {name}") as end:
        raise_twice(number, steps)
    assert steps == ["cleaned up"]
    assert end.value.exit_code == 128 + number
    assert signal.getsignal(number) is handler


def raise_in_protected_code(steps: list[int]) -> None:
    with ended_by_signals():
        with uninterrupted():
            signal.raise_signal(signal.SIGTERM)
            with uninterrupted():
                steps.append(1)
            steps.append(2)
        steps.append(3)


def test_protected_code_is_completed_before_end() -> None:
    steps: list[int] = []
    with pytest.raises(Ended):
        raise_in_protected_code(steps)
    assert steps == [1, 2]


def test_error_in_protected_code_takes_precedence() -> None:
    def fail() -> None:
        with uninterrupted():
            signal.raise_signal(signal.SIGTERM)
            raise ValueError("first")

    with pytest.raises(ValueError, match="first"), ended_by_signals():
        fail()


@pytest.mark.skipif(sys.platform == "win32", reason="there is no nohup")
def test_signal_ignored_by_nohup_stays_ignored() -> None:
    handler = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_by_signals():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, handler)


def test_handlers_do_not_change_outside_main_thread() -> None:
    handlers = []

    def work() -> None:
        with ended_by_signals():
            handlers.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert handlers == [signal.getsignal(signal.SIGTERM)]
