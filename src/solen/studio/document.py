"""The edited design: changed, undone, and saved into its file with its comments.

This document writes unsaved changes into a new file next to the design; an older file of unsaved changes is offered but
never replaced. Several pages may edit one document. The saved text is the opened text with the changed values; if
another program has changed the file meanwhile, nothing is written.
"""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

from solen import files
from solen.errors import OutputError, SolenError, SpecError
from solen.files import read_text
from solen.sensor import Sensor
from solen.spec import Design, loads, template, with_values
from solen.spec.edited import edited
from solen.studio.jobs import Jobs

if TYPE_CHECKING:
    from solen.studio.search import Search

MAX_STATES = 500
"""Largest number of states kept for undo."""
EXAMPLE = "solen-860"


@dataclass(frozen=True)
class State:
    """A design, and its values that differ from the opened text."""

    sensor: Sensor
    changes: Mapping[str, Any]

    @property
    def design(self) -> Design:
        """The design."""
        return self.sensor.design


class Document:
    """A design file that is being changed.

    Parameters
    ----------
    path
        The file; if it does not exist yet, an example is opened and saved there.

    Raises
    ------
    SpecError, DesignError, DataError
        If the file is not a valid design.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.lock = path, RLock()
        self.version = 0
        self.kept: Path | None = None
        self.kept_text = self.why_not_kept = ""
        self.jobs = Jobs()
        self.search: Search | None = None
        self.beside: State | None = None
        self._open()
        self.offered = self._unsaved_earlier()

    def _open(self) -> None:
        self.is_new = not self.path.exists()
        self.text = template(EXAMPLE) if self.is_new else read_text(self.path, SpecError)
        self.on_disk: str | None = None if self.is_new else self.text
        design = loads(self.text, what=str(self.path), folder=self.path.absolute().parent)
        self.opened = State(Sensor.of(design), {})
        self.states, self.place, self.gesture = [self.opened], 0, ""
        self.saved: State | None = None if self.is_new else self.states[0]
        self.version += 1

    @property
    def state(self) -> State:
        """The current state."""
        return self.states[self.place]

    @property
    def is_saved(self) -> bool:
        """Whether the file contains the current state."""
        return self.saved is not None and self.state.changes == self.saved.changes

    def change(self, values: Mapping[str, Any], gesture: str = "", at: float = 0.0) -> State:
        """Set values by dotted keys; changes of one gesture are undone together.

        ``at`` is the angle, or value of whatever else the motion drives, at which the body must be possible.

        Raises
        ------
        SolenError
            If the design would be invalid, or its lens or body cannot be made; it is then left unchanged.
        """
        with self.lock:
            before = self.state
            sensor = Sensor.of(with_values(before.design, values))
            if sensor.design == before.design and not values.keys() - before.changes.keys():
                return before
            sensor.body(at)
            return self._push(State(sensor, {**before.changes, **values}), gesture)

    def open_state(self, base: State, values: Mapping[str, Any]) -> State:
        """Open an earlier state of this file with values set; the current state can be restored by undo."""
        with self.lock:
            sensor = Sensor.of(with_values(base.design, values))
            return self._push(State(sensor, {**base.changes, **values}))

    def _push(self, state: State, gesture: str = "") -> State:
        same = gesture != "" and gesture == self.gesture and self.place > 0
        first = max(0, self.place + 1 - MAX_STATES)
        self.states = [*self.states[first : self.place + (0 if same else 1)], state]
        self.place, self.gesture = len(self.states) - 1, gesture
        self.version += 1
        return state

    def step(self, by: int) -> State:
        """Undo (−1) or redo (+1) a step, if there is one."""
        with self.lock:
            self.place = min(max(self.place + by, 0), len(self.states) - 1)
            self.gesture = ""
            self.version += 1
            return self.state

    def save(self) -> Path:
        """Write the file with the current values, atomically.

        Raises
        ------
        OutputError
            If it cannot be written, or another program changed it since it was opened or saved.
        """
        with self.lock:
            if self._now_on_disk() != self.on_disk:
                limit = "was changed by another program since it was opened"
                raise OutputError(str(self.path), limit=limit, remedy="reload it, or save a copy of it elsewhere first")
            text = self._written()
            files.write_text(self.path, text)
            self.on_disk, self.saved = text, self.state
            self.version += 1
            return self.path

    def pin(self) -> None:
        """Keep the current state for comparison with later ones, or stop comparing."""
        with self.lock:
            self.beside = self.state if self.beside is None else None
            self.version += 1

    def compare_with(self, path: Path) -> None:
        """Compare this design with another one; raises as `Document` does."""
        design = loads(read_text(path, SpecError), what=str(path), folder=path.absolute().parent)
        self.beside = State(Sensor.of(design), {})

    def reload(self) -> State:
        """Open the file again; unsaved changes are lost."""
        with self.lock:
            self._open()
            return self.state

    def keep_unsaved(self) -> None:
        """Write unsaved changes into a file next to the design (``kept``); remove that file once the design is saved.

        A file that another program made or changed is left untouched, and another one is made.
        """
        with self.lock:
            own = self.kept is not None and self.kept.exists()
            own = own and read_text(self.kept, OutputError) == self.kept_text  # type: ignore[arg-type]  # it is one
            if not self.is_saved and (self.state.changes or self.saved is not None):
                text = self._written()
                beside = self.kept if own and self.kept else next(path for path in self._beside() if not path.exists())
                if not own or text != self.kept_text:
                    self.kept, self.kept_text = files.write_text(beside, text), text
            elif own and self.kept:
                files.remove(self.kept)
                self.kept = None

    def restore(self) -> State:
        """Apply changes left unsaved by an earlier session, as one step; their file is the one updated from now on.

        Raises
        ------
        SolenError
            If there are none, or they do not belong to the open file.
        """
        with self.lock:
            if self.offered is None:
                raise SpecError("restore", limit="there are no unsaved changes from an earlier session")
            text = read_text(self.offered, SpecError)
            values = _differences(tomllib.loads(self.text), tomllib.loads(text))
            left = loads(text, what=str(self.offered), folder=self.path.absolute().parent)
            if with_values(self.opened.design, values) != left:
                limit = f"cannot be applied to {self.path.name}"
                raise SpecError(str(self.offered), limit=limit, remedy="open it separately")
            state = self.open_state(self.opened, values)
            self.kept, self.kept_text, self.offered = self.offered, text, None
            return state

    def leave(self) -> None:
        """Stop offering the changes left unsaved; their file is kept."""
        with self.lock:
            self.offered = None
            self.version += 1

    def _beside(self) -> Iterator[Path]:
        """Yield candidate names for files of unsaved changes, in order."""
        for number in count(1):
            yield self.path.with_name(f"{self.path.stem}-unsaved{'' if number == 1 else f'-{number}'}.toml")

    def _unsaved_earlier(self) -> Path | None:
        """Return the newest file of changes left unsaved by an earlier session, if it differs from the design."""
        for path in sorted(takewhile(Path.exists, self._beside()), key=lambda one: one.stat().st_mtime, reverse=True):
            try:
                left = loads(read_text(path, SpecError), what=str(path), folder=self.path.absolute().parent)
            except SolenError:
                continue  # a design that cannot be opened is not offered
            return None if left == self.opened.design else path
        return None

    def _written(self) -> str:
        folder = self.path.absolute().parent
        return edited(self.text, self.state.changes, what=str(self.path), folder=folder)

    def _now_on_disk(self) -> str | None:
        return read_text(self.path, OutputError) if self.path.exists() else None


def _differences(before: Mapping[str, Any], after: Mapping[str, Any], table: str = "") -> dict[str, Any]:
    """Return the values by dotted key that change one document into the other; None removes a value."""
    found: dict[str, Any] = {}
    for name in dict.fromkeys([*before, *after]):
        old, new = before.get(name), after.get(name)
        if isinstance(old or new, Mapping):
            found |= _differences(old or {}, new or {}, f"{table}{name}.")
        elif old != new:
            found[f"{table}{name}"] = new
    return found
