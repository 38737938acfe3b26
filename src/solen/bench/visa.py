"""Instruments with SCPI over VISA: sessions, queries, blocks of bytes, errors.

PyVISA opens a resource such as ``TCPIP::192.168.0.5::5025::SOCKET``, ``USB0::…::INSTR`` or ``ASRL3::INSTR`` with the
library of a manufacturer or with PyVISA-py, which is pure Python. Errors of either are raised as `BenchError`.

Public name: `Scpi`. Extra ``visa``.
"""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from solen.bench.drivers import on_failure
from solen.errors import BenchError
from solen.extras import need


class Scpi:
    """A session with an instrument.

    Parameters
    ----------
    address, backend
        Resource name, and PyVISA's name of the library: ``@py``, ``@ivi``, or a path.
    timeout_s
        Time limit in s for a reply.

    Raises
    ------
    BenchError
        If PyVISA is not installed, or no instrument replies at that address.
    """

    def __init__(self, address: str, *, backend: str = "@py", timeout_s: float = 5.0) -> None:
        modules = ("pyvisa", "pyvisa_py") if backend == "@py" else ("pyvisa",)
        need(*modules, what="meter", value=address, error=BenchError)
        self.address = address
        with self._translated():
            self._manager, self._session = _open(address, backend)
        with on_failure(self.close):
            with self._translated():
                self._session.timeout = 1e3 * timeout_s
                self._session.read_termination = self._session.write_termination = "\n"
            self.identity = self.query("*IDN?")
            self.write("*CLS")

    def write(self, text: str) -> None:
        """Send a command or a query."""
        with self._translated():
            self._session.write(text)

    def query(self, text: str) -> str:
        """Send a query and return the reply."""
        self.write(text)
        return self.read()

    def read(self) -> str:
        """Return the reply to a query that was sent before."""
        with self._translated():
            return str(self._session.read()).strip()

    def query_block(self, text: str) -> bytes:
        """Send a query whose reply is a binary block, and return its data."""
        with self._translated():
            data = self._session.query_binary_values(text, datatype="B", container=bytes)
        return bytes(data)

    def send_commands(self, commands: tuple[str, ...]) -> None:
        """Send commands; raise `BenchError` with the instrument's reason if one is rejected."""
        for command in commands:
            self.write(command)
            status = self.query("SYST:ERR?")
            if status.lstrip("+").partition(",")[0] != "0":
                raise self.error(f"{command}: {status}", "see its programming guide")

    def close(self) -> None:
        """Close the session."""
        with contextlib.suppress(BenchError), self._translated():
            self._session.close()

    def error(self, limit: str, remedy: str) -> BenchError:
        """Return an error of this instrument."""
        return BenchError(self.address, limit=limit, remedy=remedy)

    @contextlib.contextmanager
    def _translated(self) -> Iterator[None]:
        import pyvisa

        try:
            yield
        except (pyvisa.errors.Error, OSError, ValueError) as bad:
            reason = " ".join(str(bad).split())[:120] or type(bad).__name__
            remedy = "check address and answer_s in [meter], the cable and the power"
            raise self.error(reason, remedy) from None


def _open(address: str, backend: str) -> tuple[Any, Any]:
    """Return the resource manager, which must be kept as long as the session, and the session."""
    import pyvisa

    manager = pyvisa.ResourceManager(backend)
    return manager, manager.open_resource(address)


def open_all(addresses: tuple[str, ...], open_session: Callable[[str], Scpi]) -> list[Scpi]:
    """Open sessions with several instruments; if one fails, the others are closed."""
    with contextlib.ExitStack() as opened:
        sessions = [opened.enter_context(contextlib.closing(open_session(address))) for address in addresses]
        opened.pop_all()
    return sessions
