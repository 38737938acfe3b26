"""Session of one page: it handles the newest request, drops older requests of a drag, and refines results when idle."""

import asyncio
import contextlib
import json
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from dataclasses import dataclass, field
from typing import Any

from solen.errors import SolenError, SpecError
from solen.sensor.picture import dragged
from solen.studio.document import Document
from solen.studio.frames import encoded
from solen.studio.replies import (
    PageRequest,
    View,
    hello_frame,
    lit_sensor,
    nearest_value,
    picture_frame,
    refined_frames,
    suggestion_frame,
    tolerance_frames,
)
from solen.studio.search import adopt, start

MAX_PENDING = 16
"""Maximum number of waiting requests; all requests of one drag are one."""
WATCH_INTERVAL_S = 0.2
"""Interval between checks of background jobs."""
IDLE_S = 0.08
"""Time without a request after which results are refined; during a drag, the drag itself requires the CPU."""
Sender = Callable[[bytes], Awaitable[None]]


def request_of(message: str | bytes) -> dict[str, Any]:
    """Return the JSON object in a message; raise `SpecError` if it is not one."""
    try:
        data = json.loads(message)
    except (ValueError, RecursionError):
        data = None
    if not isinstance(data, dict):
        raise SpecError("message", limit="must be a JSON object", remedy="reload the page")
    return data


def merged(waiting: list[PageRequest], new: PageRequest) -> list[PageRequest]:
    """Return the waiting requests and a new one, which replaces the last if both belong to the same drag."""
    last = waiting[-1] if waiting else None
    if last is None or _is_order(last) or _is_order(new) or last.gesture != new.gesture or last.handle != new.handle:
        return [*waiting, new]
    update = {"values": {**last.values, **new.values}, "view": new.view or last.view}
    return [*waiting[:-1], new.model_copy(update=update)]


def _is_order(request: PageRequest) -> bool:
    return bool(request.do or request.search or request.take)


@dataclass(eq=False)
class Session:
    """Session of a connected page; ``others`` contains all sessions of the document."""

    document: Document
    send: Sender
    others: set["Session"]
    view: View = field(default_factory=View)
    waiting: list[PageRequest] = field(default_factory=list)
    awake: asyncio.Event = field(default_factory=asyncio.Event)
    version_sent: int = -1
    response_sent: tuple[int, View] | None = None
    response_refined: tuple[int, View] | None = None
    tolerance_frames: tuple[int, View] | None = None
    job_versions: dict[int, int] = field(default_factory=dict)

    async def receive(self, message: str) -> None:
        """Accept a message from the page; a malformed one is rejected, and the session continues."""
        try:
            waiting = merged(self.waiting, PageRequest(**request_of(message)))
            if len(waiting) > MAX_PENDING:
                raise SpecError("requests", limit=f"at most {MAX_PENDING} may wait", remedy="wait for a reply")
        except SolenError as bad:
            await self.send(_error_frame(0, bad))
            return
        self.waiting = waiting
        self.awake.set()

    async def work(self) -> None:
        """Handle requests until cancelled."""
        await self.send(hello_frame(self.document))
        self.waiting.append(PageRequest())
        while True:
            self.awake.clear()
            request = self.waiting.pop(0) if self.waiting else PageRequest()
            await self._reply(request)
            if not self.waiting and await self._is_idle():
                await self._refine()
            await self._wait_for_request()

    async def watch(self) -> None:
        """Send changes of background jobs until cancelled."""
        while True:
            for job in self.document.jobs.all:
                if self.job_versions.get(job.number) != (version := job.version):
                    self.job_versions[job.number] = version
                    await self.send(encoded(job.head()))
            await asyncio.sleep(WATCH_INTERVAL_S)

    async def _is_idle(self) -> bool:
        """Return whether no request arrives within `IDLE_S`."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self.awake.wait(), IDLE_S)
        return not self.awake.is_set()

    async def _wait_for_request(self) -> None:
        if not self.waiting:
            await self.awake.wait()

    async def _reply(self, request: PageRequest) -> None:
        try:
            frames = await asyncio.to_thread(self._frames, request)
        except SolenError as bad:
            frames = [_error_frame(request.id, bad)]
        for frame in frames:
            await self.send(frame)
        for other in self.others - {self}:
            if other.version_sent != self.document.version:
                other.awake.set()

    def _frames(self, request: PageRequest) -> list[bytes]:
        """Carry out a request, and draw the design."""
        document, view = self.document, request.view or self.view
        notes = [encoded({"kind": "saved", "file": str(document.path)})] if self._carry_out(request) else []
        if request.do == "suggest":
            notes.append(suggestion_frame(document.state))
        values = request.values
        if request.handle is not None and request.to is not None:
            angle, values = dragged(lit_sensor(document.state, view), request.handle, request.to, view.angle_deg)
            view = view.model_copy(update={"angle_deg": angle})
        if values:
            document.change(values, request.gesture, nearest_value(document.state, view.angle_deg))
        state, version = document.state, document.version
        frame = picture_frame(
            document,
            state,
            view,
            request.id,
            all_values=version != self.version_sent,
            curve=self._key(view) != self.response_sent,
        )
        self.view, self.version_sent, self.response_sent = view, version, self._key(view)
        return [frame, *notes]

    def _key(self, view: View) -> tuple[int, View]:
        """Return the state on which the response depends."""
        return self.document.version, view.model_copy(
            update={"angle_deg": 0.0, "rays": 1, "split": False, "tolerances": False}
        )

    def _carry_out(self, request: PageRequest) -> bool:
        """Carry out an action; return whether the file was saved."""
        document = self.document
        if request.do in {"undo", "redo"}:
            document.step(-1 if request.do == "undo" else 1)
        elif request.do in {"reload", "restore", "leave", "pin"}:
            getattr(document, request.do)()
        elif request.do == "save":
            document.save()
        if request.search is not None:
            start(document, request.search)
        if request.take is not None:
            adopt(document, request.take)
        return request.do == "save"

    async def _refine(self) -> None:
        """Send refined responses and the effects of tolerances until a new request arrives."""
        key = self._key(self.view)
        state, view, stop = self.document.state, self.view, self.awake.is_set
        if key != self.response_refined and await self._send_all(
            refined_frames(state, key[0], view, stop, self.document.comparison)
        ):
            self.response_refined = key
        if (
            view.tolerances
            and key != self.tolerance_frames
            and await self._send_all(tolerance_frames(state, view, stop))
        ):
            self.tolerance_frames = key

    async def _send_all(self, steps: Iterator[bytes]) -> bool:
        """Send frames as they become available; return whether all were sent before a new request arrived."""
        while not self.awake.is_set():
            try:
                frame = await self._unless_awake(asyncio.to_thread(next, steps, None))
            except SolenError as bad:
                await self.send(encoded({"kind": "no_curve", "what": str(bad)}))
                return True
            if frame is None:
                return not self.awake.is_set()
            await self.send(frame)
        return False

    async def _unless_awake(self, step: Coroutine[Any, Any, bytes | None]) -> bytes | None:
        """Return the result of a step, or None as soon as a new request arrives; the step then continues unused."""
        working, waiting = asyncio.ensure_future(step), asyncio.ensure_future(self.awake.wait())
        await asyncio.wait({working, waiting}, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        if working.done():
            return working.result()
        working.add_done_callback(asyncio.Future.exception)  # the result is not needed
        return None


def _error_frame(request: int, bad: SolenError) -> bytes:
    head: dict[str, Any] = {"kind": "refused", "id": request, "what": str(bad)}
    return encoded(head)
