"""Fixtures: a folder with a small simulated rig, and a function that starts runs in separate processes."""

import contextlib
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from solen.spec import template
from tests.bench.fork_support import Start, fork_server, start_process
from tests.bench.rig_support import PROTOCOL, RIG


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """Folder with rig.toml, protocol.toml and sensor.toml: a sensor and its control, traced quickly."""
    (tmp_path / "sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    (tmp_path / "protocol.toml").write_text(PROTOCOL, encoding="utf-8")
    return tmp_path


@pytest.fixture(scope="session")
def start() -> Iterator[Start]:
    """Function that starts the program: by a fork where possible, because loading the program takes seconds."""
    if sys.platform == "win32":
        yield start_process
    else:
        with fork_server() as forks:
            yield forks.start


@pytest.fixture
def signals() -> Iterator[None]:
    """Signals that end a program have their default handlers, also in child processes and under nohup."""
    with contextlib.ExitStack() as restored:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_IGN:
                default = signal.default_int_handler if name == "SIGINT" else signal.SIG_DFL
                restored.callback(signal.signal, number, signal.signal(number, default))
        yield
