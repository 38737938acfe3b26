"""Workspace of a document in the tabs: dropped files, commands and jobs."""

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import Field

from solen.errors import SolenError, SpecError
from solen.spec.strict import Strict
from solen.studio import tabs
from solen.studio.calls import PrintedLines, run_call
from solen.studio.commands import assigned
from solen.studio.document import Document
from solen.studio.jobs import Job
from solen.studio.storage import JOB, Storage, safe_name


class CommandRequest(Strict):
    """Request from a page to run a command of a tab."""

    command: str = Field(max_length=60, description="Name of a command in a tab, such as resin cure.")
    asked: dict[str, Any] = Field(default_factory=dict, max_length=200, description="Values of its form.")


@dataclass(eq=False)
class Workspace:
    """Files and jobs of a document; ``printed_lines`` returns the lines that a command prints."""

    document: Document
    printed_lines: PrintedLines | None = None
    storage: Storage = field(init=False)

    def __post_init__(self) -> None:
        path = self.document.path
        self.storage = Storage(path.with_name(f"{path.stem}-studio"))
        for job in self.storage.jobs():
            self.document.jobs.add_finished(job["name"], job["about"], job["news"])

    def forms(self, name: str) -> dict[str, Any]:
        """Return the forms of a tab and the available files; prepare a process for its commands."""
        page_commands = tabs.commands_of(name)
        self.document.jobs.prepare(["solen.report.canvas", *dict.fromkeys(command.module for command in page_commands)])
        return {"tab": name, "offers": [command.form() for command in page_commands], "files": self.storage.names()}

    def suitable_commands(self, tab: str, name: str) -> dict[str, Any]:
        """Return the commands of a tab that accept a file, or why none does."""
        try:
            return {"name": name, "suits": tabs.suitable_commands(tab, self.storage.path(name)), "why": ""}
        except SolenError as bad:
            return {"name": name, "suits": (), "why": str(bad)}

    def start(self, request: CommandRequest) -> Job:
        """Start the requested job in the background.

        Raises
        ------
        SolenError
            If a value is invalid, a file does not exist, or the design must be saved first.
        """
        command = tabs.command(request.command)
        folder = self.storage.new_folder(command.last_word)
        try:
            changes = self._changes() if command.design else []
            call = command.call(request.asked, self.storage.path, folder, self.document.path, changes)
            details = {"shell": call.shell, "python": call.python, "folder": folder.name, "label": command.label}
            return self.document.jobs.start(
                command.name, run_call, (call, self.printed_lines, details, folder / JOB), details
            )
        except SolenError:
            self.storage.remove_if_empty(folder)
            raise

    def _changes(self) -> list[str]:
        """Return the changes of the design as arguments of ``--set``; raise `SpecError` if it must be saved first."""
        document = self.document
        changes: Mapping[str, Any] = {} if document.is_saved else document.state.changes
        if document.saved is None or None in changes.values():
            raise SpecError(
                str(document.path),
                limit="does not contain the design shown on the page",
                remedy="save the design first",
            )
        return assigned(changes)[1::2]

    def file_of(self, number: int, name: str) -> Path:
        """Return the path of a file that a job wrote, given its name; raise `SpecError` if there is none."""
        files: Mapping[str, str] = self.document.jobs.by_number(number).status.get("files", {})
        if name not in files:
            raise SpecError("file", limit="was not written by this job")
        return Path(files[name])

    def member(self, number: int, name: str, name_in_archive: str) -> bytes:
        """Return the content of a member of an archive that a job wrote; raise `SpecError` if there is none."""
        path = self.file_of(number, name)
        if path.suffix != ".zip":
            raise SpecError(name, limit="is not an archive")
        with zipfile.ZipFile(path) as archive:
            if name_in_archive not in archive.namelist():
                raise SpecError("part", value=safe_name(name_in_archive), limit=f"is not in {path.name}")
            return archive.read(name_in_archive)
