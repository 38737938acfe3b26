"""Instruments that use SCPI over VISA: a session by its resource name, queries, blocks of bytes, errors.

PyVISA opens a resource such as ``TCPIP::192.168.0.5::5025::SOCKET``, ``USB0::…::INSTR`` or ``ASRL3::INSTR`` with a
manufacturer's library or with PyVISA-py, which is pure Python. Errors of either become a `BenchError`.

Public name: `Scpi`. Extra ``visa``.
"""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from solen.errors import BenchError
from solen.extras import need


class Scpi:
    """A session with an instrument.

    Parameters
    ----------
    address, backend
        Resource name, and PyVISA's name of the library: ``@py``, ``@ivi``, or a path.
    answer_s
        Longest duration of an answer.

    Raises
    ------
    BenchError
        If PyVISA is not installed, or no instrument answers at that name.
    """

    def __init__(self, address: str, *, backend: str = "@py", answer_s: float = 5.0) -> None:
        modules = ("pyvisa", "pyvisa_py") if backend == "@py" else ("pyvisa",)
        need(*modules, what="meter", value=address, error=BenchError)
        self.address = address
        with self._translated():
            self._manager, self._session = _opened(address, backend)
        try:
            with self._translated():
                self._session.timeout = 1e3 * answer_s
                self._session.read_termination = self._session.write_termination = "\n"
            self.identity = self.ask("*IDN?")
            self.say("*CLS")
        except BaseException:
            self.close()
            raise

    def say(self, text: str) -> None:
        """Send a command."""
        with self._translated():
            self._session.write(text)

    def ask(self, text: str) -> str:
        """Send a query and return its answer."""
        self.say(text)
        return self.heard()

    def heard(self) -> str:
        """Return the answer to a query that was sent before."""
        with self._translated():
            return str(self._session.read()).strip()

    def block(self, text: str) -> bytes:
        """Return the bytes that answer a query, without the header that states their number."""
        with self._translated():
            answer = self._session.query_binary_values(text, datatype="B", container=bytes)
        return bytes(answer)

    def commanded(self, commands: tuple[str, ...]) -> None:
        """Send commands; raise `BenchError` with the instrument's reason if one was rejected."""
        for command in commands:
            self.say(command)
            answer = self.ask("SYST:ERR?")
            if answer.lstrip("+").partition(",")[0] != "0":
                raise self.refusal(f"{command}: {answer}", "see its programming guide")

    def close(self) -> None:
        """Close the session."""
        with contextlib.suppress(BenchError), self._translated():
            self._session.close()

    def refusal(self, limit: str, remedy: str) -> BenchError:
        """Return the error for a problem of the instrument."""
        return BenchError(self.address, limit=limit, remedy=remedy)

    @contextlib.contextmanager
    def _translated(self) -> Iterator[None]:
        import pyvisa

        try:
            yield
        except (pyvisa.errors.Error, OSError, ValueError) as bad:
            words = " ".join(str(bad).split())[:120] or type(bad).__name__
            raise self.refusal(words, "check its name, its cable, its power, and answer_s in [meter]") from None


def _opened(address: str, backend: str) -> tuple[Any, Any]:
    """Return the resource manager, which is closed with the session, and the session."""
    import pyvisa

    manager = pyvisa.ResourceManager(backend)
    return manager, manager.open_resource(address)


@contextlib.contextmanager
def all_or_none(opened: list[Scpi]) -> Iterator[None]:
    """Close the open instruments if the body fails."""
    try:
        yield
    except BaseException:
        for one in opened:
            one.close()
        raise


def opened_all(addresses: tuple[str, ...], open_one: Callable[[str], Scpi]) -> list[Scpi]:
    """Open sessions with several instruments; if one is missing, the others are closed."""
    found: list[Scpi] = []
    with all_or_none(found):
        found.extend(open_one(address) for address in addresses)
    return found
