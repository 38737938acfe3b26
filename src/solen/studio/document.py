"""The edited design: changes, undo, and saving into its file with all comments.

A document writes unsaved changes into a new file next to the design. An older file of unsaved changes is offered to the
user but never replaced. Several pages may edit one document. The saved text is the opened text with the changed values;
if another program has changed the file meanwhile, nothing is written.
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
"""Maximum number of states kept for undo."""
EXAMPLE = "solen-860"


@dataclass(frozen=True)
class State:
    """A design, and the values that were changed in the opened text."""

    sensor: Sensor
    changes: Mapping[str, Any]

    @property
    def design(self) -> Design:
        """The design."""
        return self.sensor.design


class Document:
    """A design file that is being edited.

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
        self.unsaved_file: Path | None = None
        self.unsaved_text = self.unsaved_error = ""
        self.jobs = Jobs()
        self.search: Search | None = None
        self.comparison: State | None = None
        self._open()
        self.earlier_changes = self._earlier_changes()

    def _open(self) -> None:
        self.is_new = not self.path.exists()
        self.text = template(EXAMPLE) if self.is_new else read_text(self.path, SpecError)
        self.on_disk: str | None = None if self.is_new else self.text
        design = loads(self.text, what=str(self.path), folder=self.path.absolute().parent)
        self.opened = State(Sensor.of(design), {})
        self.states, self.position, self.gesture = [self.opened], 0, ""
        self.saved: State | None = None if self.is_new else self.states[0]
        self.version += 1

    @property
    def state(self) -> State:
        """The current state."""
        return self.states[self.position]

    @property
    def is_saved(self) -> bool:
        """Whether the file contains the current state."""
        return self.saved is not None and self.state.changes == self.saved.changes

    def change(self, values: Mapping[str, Any], gesture: str = "", at: float = 0.0) -> State:
        """Set values, keyed by dotted key; changes of one gesture are undone together.

        ``at`` is the angle, or other value of the motion, at which the body must be valid.

        Raises
        ------
        SolenError
            If the design would be invalid, or its lens or body cannot be built; it then remains unchanged.
        """
        with self.lock:
            before = self.state
            sensor = Sensor.of(with_values(before.design, values))
            if sensor.design == before.design and not values.keys() - before.changes.keys():
                return before
            sensor.body(at)
            return self._push(State(sensor, {**before.changes, **values}), gesture)

    def open_state(self, base: State, values: Mapping[str, Any]) -> State:
        """Open an earlier state of this file and set values; undo restores the current state."""
        with self.lock:
            sensor = Sensor.of(with_values(base.design, values))
            return self._push(State(sensor, {**base.changes, **values}))

    def _push(self, state: State, gesture: str = "") -> State:
        same_gesture = gesture != "" and gesture == self.gesture and self.position > 0
        first = max(0, self.position + 1 - MAX_STATES)
        self.states = [*self.states[first : self.position + (0 if same_gesture else 1)], state]
        self.position, self.gesture = len(self.states) - 1, gesture
        self.version += 1
        return state

    def step(self, offset: int) -> State:
        """Undo (−1) or redo (+1) a step, if possible."""
        with self.lock:
            self.position = min(max(self.position + offset, 0), len(self.states) - 1)
            self.gesture = ""
            self.version += 1
            return self.state

    def save(self) -> Path:
        """Write the file with the current values, atomically.

        Raises
        ------
        OutputError
            If it cannot be written, or another program has changed it since it was opened or saved.
        """
        with self.lock:
            if self._text_on_disk() != self.on_disk:
                limit = "has been changed by another program since it was opened or saved"
                remedy = "reload the file, which discards your unsaved changes"
                raise OutputError(str(self.path), limit=limit, remedy=remedy)
            text = self._edited_text()
            files.write_text(self.path, text)
            self.on_disk, self.saved = text, self.state
            self.version += 1
            return self.path

    def pin(self) -> None:
        """Keep the current state for comparison with later ones, or end the comparison."""
        with self.lock:
            self.comparison = self.state if self.comparison is None else None
            self.version += 1

    def compare_with(self, path: Path) -> None:
        """Compare this design with another one; raises the same errors as `Document`."""
        design = loads(read_text(path, SpecError), what=str(path), folder=path.absolute().parent)
        self.comparison = State(Sensor.of(design), {})

    def reload(self) -> State:
        """Open the file again; unsaved changes are lost."""
        with self.lock:
            self._open()
            return self.state

    def keep_unsaved(self) -> None:
        """Write unsaved changes into a file next to the design, and remove that file once the design is saved.

        A file that another program created or changed is left untouched, and a new one is created.
        """
        with self.lock:
            file = self.unsaved_file
            is_own = file is not None and file.exists() and read_text(file, OutputError) == self.unsaved_text
            if not self.is_saved and (self.state.changes or self.saved is not None):
                text = self._edited_text()
                target = file if is_own and file else next(path for path in self._unsaved_names() if not path.exists())
                if not is_own or text != self.unsaved_text:
                    self.unsaved_file, self.unsaved_text = files.write_text(target, text), text
            elif is_own and file:
                files.remove(file)
                self.unsaved_file = None

    def restore(self) -> State:
        """Apply the unsaved changes of an earlier session as one step; their file is updated from now on.

        Raises
        ------
        SolenError
            If there are none, or they cannot be applied to the open file.
        """
        with self.lock:
            if self.earlier_changes is None:
                raise SpecError("restore", limit="requires unsaved changes from an earlier session")
            text = read_text(self.earlier_changes, SpecError)
            values = _differences(tomllib.loads(self.text), tomllib.loads(text))
            unsaved = loads(text, what=str(self.earlier_changes), folder=self.path.absolute().parent)
            if with_values(self.opened.design, values) != unsaved:
                limit = f"cannot be applied to {self.path.name}"
                raise SpecError(str(self.earlier_changes), limit=limit, remedy="open it separately")
            state = self.open_state(self.opened, values)
            self.unsaved_file, self.unsaved_text, self.earlier_changes = self.earlier_changes, text, None
            return state

    def leave(self) -> None:
        """Stop offering the unsaved changes of an earlier session; their file is kept."""
        with self.lock:
            self.earlier_changes = None
            self.version += 1

    def _unsaved_names(self) -> Iterator[Path]:
        """Yield the names for files of unsaved changes, in order."""
        for number in count(1):
            yield self.path.with_name(f"{self.path.stem}-unsaved{'' if number == 1 else f'-{number}'}.toml")

    def _earlier_changes(self) -> Path | None:
        """Return the newest file of unsaved changes of an earlier session, if it differs from the design."""
        existing = takewhile(Path.exists, self._unsaved_names())
        for path in sorted(existing, key=lambda file: file.stat().st_mtime, reverse=True):
            try:
                unsaved = loads(read_text(path, SpecError), what=str(path), folder=self.path.absolute().parent)
            except SolenError:
                continue  # invalid designs are not offered
            return None if unsaved == self.opened.design else path
        return None

    def _edited_text(self) -> str:
        folder = self.path.absolute().parent
        return edited(self.text, self.state.changes, what=str(self.path), folder=folder)

    def _text_on_disk(self) -> str | None:
        return read_text(self.path, OutputError) if self.path.exists() else None


def _differences(before: Mapping[str, Any], after: Mapping[str, Any], table: str = "") -> dict[str, Any]:
    """Return the values, keyed by dotted key, that change one document into another; None removes a value."""
    differences: dict[str, Any] = {}
    for name in dict.fromkeys([*before, *after]):
        old, new = before.get(name), after.get(name)
        if isinstance(old or new, Mapping):
            differences |= _differences(old or {}, new or {}, f"{table}{name}.")
        elif old != new:
            differences[f"{table}{name}"] = new
    return differences
