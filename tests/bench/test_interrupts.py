"""Requests to end: one is answered, later ones are passed over, and what must not be left half-way is not."""

import signal
import sys
import threading

import pytest

from solen.bench.interrupts import Ended, ended_by_signals, uninterrupted

pytestmark = pytest.mark.usefixtures("heeded")

ENDING = [name for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)]


def interrupted(number: int, steps: list[str]) -> None:
    """Asked to end once, and again while it cleans up."""
    with ended_by_signals():
        try:
            signal.raise_signal(number)
            steps.append("went on")
        finally:
            signal.raise_signal(signal.SIGINT)
            steps.append("cleaned")


@pytest.mark.parametrize("name", ENDING)
def test_each_request_ends_once(name: str) -> None:
    number = getattr(signal, name)
    steps: list[str] = []
    before = signal.getsignal(number)
    with pytest.raises(Ended, match=f"ended by {name}") as request:
        interrupted(number, steps)
    assert steps == ["cleaned"]
    assert request.value.exit_code == 128 + number
    assert signal.getsignal(number) is before


def held(done: list[int]) -> None:
    with ended_by_signals():
        with uninterrupted():
            signal.raise_signal(signal.SIGTERM)
            with uninterrupted():
                done.append(1)
            done.append(2)
        done.append(3)


def test_what_must_not_be_left_half_way_is_done_first() -> None:
    done: list[int] = []
    with pytest.raises(Ended):
        held(done)
    assert done == [1, 2]


def test_an_error_on_the_way_is_what_is_seen() -> None:
    def fail() -> None:
        with uninterrupted():
            signal.raise_signal(signal.SIGTERM)
            raise ValueError("first")

    with pytest.raises(ValueError, match="first"), ended_by_signals():
        fail()


@pytest.mark.skipif(sys.platform == "win32", reason="there is no nohup")
def test_nohup_is_left_alone() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_by_signals():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_outside_the_main_thread_nothing_changes() -> None:
    seen = []

    def work() -> None:
        with ended_by_signals():
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.getsignal(signal.SIGTERM)]
