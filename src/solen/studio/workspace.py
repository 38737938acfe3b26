"""A document's work in the tabs next to the design: dropped files, offered commands, and jobs."""

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import Field

from solen.errors import SolenError, SpecError
from solen.spec.strict import Strict
from solen.studio import tabs
from solen.studio.calls import Shown, perform
from solen.studio.commands import assigned
from solen.studio.document import Document
from solen.studio.jobs import Job
from solen.studio.storage import JOB, Storage, safe_name


class Order(Strict):
    """Request of a page to run a command of a tab."""

    command: str = Field(max_length=60, description="Name of an offered command, such as resin cure.")
    asked: dict[str, Any] = Field(default_factory=dict, max_length=200, description="Values of its form.")


@dataclass(eq=False)
class Workspace:
    """Files and jobs of a document; ``shown`` gives the lines that a command prints."""

    document: Document
    shown: Shown | None = None
    storage: Storage = field(init=False)

    def __post_init__(self) -> None:
        path = self.document.path
        self.storage = Storage(path.with_name(f"{path.stem}-studio"))
        for job in self.storage.jobs():
            self.document.jobs.ended(job["name"], job["about"], job["news"])

    def forms(self, name: str) -> dict[str, Any]:
        """Return the forms that a tab offers and the available files; a process is prepared for its commands."""
        offers = tabs.offers_of(name)
        self.document.jobs.warm(["solen.report.canvas", *dict.fromkeys(offer.module for offer in offers)])
        return {"tab": name, "offers": [offer.form() for offer in offers], "files": self.storage.names()}

    def commands_for(self, tab: str, name: str) -> dict[str, Any]:
        """Return which commands in a tab accept a file, or why none does."""
        try:
            return {"name": name, "suits": tabs.commands_for(tab, self.storage.path(name)), "why": ""}
        except SolenError as bad:
            return {"name": name, "suits": (), "why": str(bad)}

    def begin(self, order: Order) -> Job:
        """Start the requested job in the background.

        Raises
        ------
        SolenError
            If a value is rejected, a file does not exist, or the design must be saved first.
        """
        offer = tabs.offer(order.command)
        folder = self.storage.new_folder(offer.short)
        try:
            changes = self._changes() if offer.design else []
            call = offer.call(order.asked, self.storage.path, folder, self.document.path, changes)
            about = {"shell": call.shell, "python": call.python, "folder": folder.name, "label": offer.label}
            return self.document.jobs.begin(offer.name, perform, (call, self.shown, about, folder / JOB), about)
        except SolenError:
            self.storage.drop(folder)
            raise

    def _changes(self) -> list[str]:
        """Return the changes to the design's file, as ``--set`` accepts them; `SpecError` if it must be saved first."""
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
        """Return the path of a file that a job wrote, by its name in the result; `SpecError` if there is none."""
        files: Mapping[str, str] = self.document.jobs.of(number).news.get("files", {})
        if name not in files:
            raise SpecError("file", limit="was not written by this job")
        return Path(files[name])

    def inside(self, number: int, name: str, part: str) -> bytes:
        """Return the content of a member of an archive that a job wrote; `SpecError` if there is none."""
        path = self.file_of(number, name)
        if path.suffix != ".zip":
            raise SpecError(name, limit="is no archive")
        with zipfile.ZipFile(path) as archive:
            if part not in archive.namelist():
                raise SpecError("part", value=safe_name(part), limit=f"is not in {path.name}")
            return archive.read(part)
