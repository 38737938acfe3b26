"""One page's session: the newest request is answered, older ones of a drag are dropped, idle time refines results."""

import asyncio
import contextlib
import json
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from dataclasses import dataclass, field
from typing import Any

from solen.errors import SolenError, SpecError
from solen.sensor.picture import dragged
from solen.studio.answers import (
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
from solen.studio.document import Document
from solen.studio.frames import encoded
from solen.studio.search import adopt, begin

MAX_PENDING = 16
"""Largest number of different requests that may wait; all requests from one drag count as one."""
WATCHED_S = 0.2
"""Time between checks of background work."""
REST_S = 0.08
"""Time without a request after which results are refined; during a drag the CPU is needed for the drag itself."""
Sender = Callable[[bytes], Awaitable[None]]


def request_of(message: str | bytes) -> dict[str, Any]:
    """Return the JSON object in a message; `SpecError` if there is none."""
    try:
        data = json.loads(message)
    except (ValueError, RecursionError):
        data = None
    if not isinstance(data, dict):
        raise SpecError("message", limit="must be a JSON object", remedy="reload the page")
    return data


def merged(waiting: list[PageRequest], new: PageRequest) -> list[PageRequest]:
    """Return the waiting requests with a new one, which replaces the last if both belong to one drag."""
    last = waiting[-1] if waiting else None
    if last is None or _is_order(last) or _is_order(new) or last.gesture != new.gesture or last.handle != new.handle:
        return [*waiting, new]
    both = {"values": {**last.values, **new.values}, "view": new.view or last.view}
    return [*waiting[:-1], new.model_copy(update=both)]


def _is_order(asked: PageRequest) -> bool:
    return bool(asked.do or asked.search or asked.take)


@dataclass(eq=False)
class Session:
    """A connected page; ``others`` are all sessions of the document."""

    document: Document
    send: Sender
    others: set["Session"]
    view: View = field(default_factory=View)
    waiting: list[PageRequest] = field(default_factory=list)
    awake: asyncio.Event = field(default_factory=asyncio.Event)
    seen: int = -1
    traced: tuple[int, View] | None = None
    finished: tuple[int, View] | None = None
    tolerance_frames: tuple[int, View] | None = None
    known: dict[int, int] = field(default_factory=dict)

    async def take(self, message: str) -> None:
        """Accept a message of the page; a malformed one is rejected, and the session continues."""
        try:
            waiting = merged(self.waiting, PageRequest(**request_of(message)))
            if len(waiting) > MAX_PENDING:
                raise SpecError("requests", limit=f"at most {MAX_PENDING} may wait", remedy="wait for an answer")
        except SolenError as bad:
            await self.send(_refusal(0, bad))
            return
        self.waiting = waiting
        self.awake.set()

    async def work(self) -> None:
        """Answer requests until cancelled."""
        await self.send(hello_frame(self.document))
        self.waiting.append(PageRequest())
        while True:
            self.awake.clear()
            asked = self.waiting.pop(0) if self.waiting else PageRequest()
            await self._answer(asked)
            if not self.waiting and await self._at_rest():
                await self._improve()
            await self._next()

    async def watch(self) -> None:
        """Send changes in background work until cancelled."""
        while True:
            for job in self.document.jobs.all:
                if self.known.get(job.number) != (version := job.version):
                    self.known[job.number] = version
                    await self.send(encoded(job.head()))
            await asyncio.sleep(WATCHED_S)

    async def _at_rest(self) -> bool:
        """Return whether no request has arrived for a moment."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self.awake.wait(), REST_S)
        return not self.awake.is_set()

    async def _next(self) -> None:
        if not self.waiting:
            await self.awake.wait()

    async def _answer(self, asked: PageRequest) -> None:
        try:
            frames = await asyncio.to_thread(self._frames, asked)
        except SolenError as bad:
            frames = [_refusal(asked.id, bad)]
        for frame in frames:
            await self.send(frame)
        for other in self.others - {self}:
            if other.seen != self.document.version:
                other.awake.set()

    def _frames(self, asked: PageRequest) -> list[bytes]:
        """Carry out the requests, and draw."""
        document, view = self.document, asked.view or self.view
        notes = [encoded({"kind": "saved", "file": str(document.path)})] if self._ordered(asked) else []
        if asked.do == "suggest":
            notes.append(suggestion_frame(document.state))
        values = asked.values
        if asked.handle is not None and asked.to is not None:
            angle, values = dragged(lit_sensor(document.state, view), asked.handle, asked.to, view.angle_deg)
            view = view.model_copy(update={"angle_deg": angle})
        if values:
            document.change(values, asked.gesture, nearest_value(document.state, view.angle_deg))
        state, version = document.state, document.version
        frame = picture_frame(
            document, state, view, asked.id, whole=version != self.seen, curve=self._key(view) != self.traced
        )
        self.view, self.seen, self.traced = view, version, self._key(view)
        return [frame, *notes]

    def _key(self, view: View) -> tuple[int, View]:
        """Return the inputs on which the response depends."""
        return self.document.version, view.model_copy(
            update={"angle_deg": 0.0, "rays": 1, "split": False, "tolerances": False}
        )

    def _ordered(self, asked: PageRequest) -> bool:
        """Carry out an order; return whether the file was saved."""
        document = self.document
        if asked.do in {"undo", "redo"}:
            document.step(-1 if asked.do == "undo" else 1)
        elif asked.do in {"reload", "restore", "leave", "pin"}:
            getattr(document, asked.do)()
        elif asked.do == "save":
            document.save()
        if asked.search is not None:
            begin(document, asked.search)
        if asked.take is not None:
            adopt(document, asked.take)
        return asked.do == "save"

    async def _improve(self) -> None:
        """Send refined responses, and what matters, until a new request arrives."""
        key = self._key(self.view)
        state, view, stop = self.document.state, self.view, self.awake.is_set
        if key != self.finished and await self._sent(refined_frames(state, key[0], view, stop, self.document.beside)):
            self.finished = key
        if view.tolerances and key != self.tolerance_frames and await self._sent(tolerance_frames(state, view, stop)):
            self.tolerance_frames = key

    async def _sent(self, steps: Iterator[bytes]) -> bool:
        """Send frames as they are made; return whether all were sent before a new request arrived."""
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
        """Return the result of a step; None as soon as a new request arrives, while the step ends on its own."""
        working, waiting = asyncio.ensure_future(step), asyncio.ensure_future(self.awake.wait())
        await asyncio.wait({working, waiting}, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        if working.done():
            return working.result()
        working.add_done_callback(asyncio.Future.exception)  # its result is no longer needed
        return None


def _refusal(asked: int, bad: SolenError) -> bytes:
    head: dict[str, Any] = {"kind": "refused", "id": asked, "what": str(bad)}
    return encoded(head)
