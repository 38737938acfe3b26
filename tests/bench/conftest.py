"""A small simulated rig: one traced sensor and its control, quick enough to run many times."""

import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from solen.spec import template
from tests.bench.rig_support import PROTOCOL, RIG


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """Folder with rig.toml, protocol.toml and sensor.toml."""
    (tmp_path / "sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    (tmp_path / "protocol.toml").write_text(PROTOCOL, encoding="utf-8")
    return tmp_path


@pytest.fixture
def heeded() -> Iterator[None]:
    """Signals that end a program are heeded, here and in programs that are started, even where tests run with nohup."""
    with contextlib.ExitStack() as undone:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_IGN:
                default = signal.default_int_handler if name == "SIGINT" else signal.SIG_DFL
                undone.callback(signal.signal, number, signal.signal(number, default))
        yield
