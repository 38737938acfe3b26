"""The studio's server: what strangers send is refused, and a page that is connected goes on."""

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from solen.errors import SpecError
from solen.spec import load
from solen.studio.document import Document
from solen.studio.frames import decoded
from solen.studio.server import MAX_MESSAGE_BYTES, server_at

DESIGN = """# kept
schema = 1
name = "flat"

[material]
index = 1.44  # of the batch

[motion]
step_deg = 1.0
"""


@dataclass
class Served:
    """A studio that runs."""

    page: str
    file: Path

    @property
    def origin(self) -> str:
        """Origin of its page."""
        return self.page.rsplit("/", 2)[0]

    @property
    def talk(self) -> str:
        """Address of its WebSocket."""
        return f"ws{self.page.removeprefix('http')}ws"

    def join(self, **more: Any) -> ClientConnection:
        """A connection as its own page makes it."""
        return connection(self.talk, **{"origin": self.origin, **more})


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    file = tmp_path_factory.mktemp("studio") / "sensor.toml"
    file.write_text(DESIGN, encoding="utf-8")
    server, listening, page = server_at(Document(file))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    yield Served(page, file)
    server.should_exit = True
    thread.join(10)
    listening.close()
    assert not thread.is_alive()
    assert load(file.with_name("sensor-unsaved.toml")).material.index == 1.44, (
        "of a change that was undone after saving"
    )


def connection(address: str, **more: Any) -> ClientConnection:
    """A connection to a WebSocket."""
    return connect(address, max_size=None, proxy=None, legacy=True, **more)


def until(talk: ClientConnection, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Header of the next frame that is wanted."""
    for _ in range(200):
        frame = talk.recv(timeout=120)
        assert isinstance(frame, bytes)
        head, _ = decoded(frame)
        if wanted(head):
            return head
    raise AssertionError("it never came")


def ask(talk: ClientConnection, number: int, **asked: Any) -> dict[str, Any]:
    """Ask, and wait for the answer: a picture or a refusal."""
    talk.send(json.dumps({"id": number, **asked}))
    return until(talk, lambda head: head.get("id") == number)


@pytest.fixture
def talk(served: Served) -> Iterator[ClientConnection]:
    with served.join() as connection:
        until(connection, lambda head: head["kind"] == "drawn")
        yield connection


def test_the_page_loads_nothing_from_elsewhere(served: Served) -> None:
    page = httpx.get(served.page)
    assert page.status_code == 200
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in page.text.replace('"http-equiv"', "")
    assert httpx.get(f"{served.page}studio.js").headers["content-type"].startswith("text/javascript")


@pytest.mark.parametrize("path", ["../server.py", "%2e%2e/server.py", "..%2fserver.py", "/etc/passwd", "__init__.py"])
def test_only_files_of_the_page_are_served(served: Served, path: str) -> None:
    host, port = served.origin.removeprefix("http://").split(":")
    token = served.page.rsplit("/", 2)[1]
    with closing(socket.create_connection((host, int(port)))) as raw:  # a client would tidy the path up
        raw.sendall(f"GET /{token}/{path} HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: close\r\n\r\n".encode())
        answer = b"".join(iter(lambda: raw.recv(65536), b""))
    assert answer.split()[1] == b"404"
    assert b"root" not in answer
    assert b"import" not in answer


def test_files_and_orders_come_from_its_own_page_alone_and_keep_to_their_limits(served: Served) -> None:
    own, foreign = {"Origin": served.origin}, {"Origin": "http://studio.example"}
    dropped = f"{served.page}files/resin/"
    assert httpx.put(f"{dropped}a.csv", content=b"1").status_code == 403
    assert httpx.put(f"{dropped}a.csv", content=b"1", headers=foreign).status_code == 403
    for name in ("..%2F..%2Fa.csv", "%2e%2e", "a%5Cb.csv"):
        httpx.put(f"{dropped}{name}", content=b"a,b\n1,2\n2,3\n", headers=own)
    folder = served.file.with_name("sensor-studio")
    assert {one.parent for one in served.file.parent.rglob("*") if one.suffix == ".csv"} <= {folder}
    for message in (b"{", b"[]", b'{"command": "doctor"}', b'{"command": "resin cure", "asked": 3}', b"x" * 2**17):
        answer = httpx.post(f"{served.page}jobs", content=message, headers=own)
        assert answer.status_code == 400
        assert answer.json()["what"]
    assert httpx.get(f"{served.page}jobs/7").status_code == 400
    assert httpx.get(f"{served.page}tabs/server").status_code == 400


def test_strangers_are_refused(served: Served) -> None:
    wrong = f"{served.origin}/{'x' * 32}/"
    assert httpx.get(wrong).status_code == 404
    assert httpx.get(f"{served.origin}/").status_code == 404
    assert httpx.get(served.page, headers={"Host": "studio.example"}).status_code == 403, "a name pointed here"
    assert httpx.get(served.page, headers={"Origin": "http://studio.example"}).status_code == 403
    assert httpx.post(served.page, content=b"x" * 1000).status_code == 403, "no Origin"
    assert httpx.patch(served.page, content=b"x" * 1000).status_code == 405


@pytest.mark.parametrize(
    "given",
    [
        {"origin": None},
        {"origin": "http://studio.example"},
        {"origin": "null"},
        {"additional_headers": {"Host": "studio.example"}},
    ],
)
def test_a_foreign_page_cannot_connect(served: Served, given: dict[str, Any]) -> None:
    with pytest.raises(InvalidStatus) as refused:
        served.join(**given)
    assert refused.value.response.status_code in {400, 403}


def test_a_wrong_token_cannot_connect(served: Served) -> None:
    token = served.page.rsplit("/", 2)[1]
    with pytest.raises(InvalidStatus):
        connection(served.talk.replace(token, "x" * len(token)), origin=served.origin)


MALFORMED: list[str | bytes] = [
    "no JSON",
    b"\x01\x02",
    "[1]",
    '{"id": "one"}',
    '{"id": 3, "view": {"angle_deg": NaN}}',
    '{"id": 3, "view": {"rays": 1e9}}',
    '{"id": 3, "open": "a"}',
    "[" * 30_000,
]


def test_a_malformed_message_is_refused_and_the_session_goes_on(talk: ClientConnection) -> None:
    for message in MALFORMED:
        talk.send(message)
        assert until(talk, lambda head: head["kind"] == "refused")["what"], message
    assert ask(talk, 5, view={"angle_deg": 1.0})["angle_deg"] == 1.0


def test_a_message_of_100_MB_ends_its_own_connection_alone(served: Served, talk: ClientConnection) -> None:
    with served.join() as other:
        head = bytes([0x81, 0xFF, *(100_000_000).to_bytes(8), 0, 0, 0, 0])
        other.socket.sendall(head + b" " * MAX_MESSAGE_BYTES)
        with pytest.raises(ConnectionClosed):
            until(other, lambda _: False)
    assert ask(talk, 1, view={"angle_deg": -1.0})["angle_deg"] == -1.0
    assert MAX_MESSAGE_BYTES < 100_000


CROWD = 1000


def test_a_thousand_connections_leave_a_session_alone(served: Served, talk: ClientConnection) -> None:
    resource = pytest.importorskip("resource")  # both ends of a connection are in this process
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 4 * CROWD)), hard))
    host, port = served.origin.removeprefix("http://").split(":")
    crowd = [socket.create_connection((host, int(port))) for _ in range(CROWD)]
    try:
        assert ask(talk, 2, view={"angle_deg": 2.0})["angle_deg"] == 2.0
        assert httpx.get(served.page).status_code == 503
    finally:
        for one in crowd:
            one.close()


def test_pages_are_few(served: Served, talk: ClientConnection, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("solen.studio.server.MAX_PAGES", 1)
    with pytest.raises(InvalidStatus):
        served.join()
    assert ask(talk, 1)["kind"] == "drawn"


def test_a_drag_never_queues(talk: ClientConnection) -> None:
    """Of a hundred requests in a row most are dropped, and the answer to the last is the last one."""
    for number in range(1, 101):
        talk.send(json.dumps({"id": number, "values": {"emitter.offset_mm": number / 1000}, "gesture": "a drag"}))
    answered: list[int] = []
    while not answered or answered[-1] < 100:
        answered.append(until(talk, lambda head: head["kind"] == "drawn")["id"])
    assert len(answered) < 50
    assert answered == sorted(answered)
    talk.send(json.dumps({"id": 101, "do": "undo"}))
    undone = until(talk, lambda head: head["kind"] == "drawn")
    assert undone["id"] == 101, "nothing was queued"
    assert undone["values"]["emitter"]["offset_mm"] == 0.0, "a drag is one step"


def test_a_second_page_sees_the_change(served: Served, talk: ClientConnection) -> None:
    with served.join() as other:
        until(other, lambda head: head["kind"] == "rest")
        ask(talk, 1, values={"lens.focus_mm": 25.0})
        seen = until(other, lambda head: head["kind"] == "drawn" and "values" in head)
        assert seen["values"]["lens"]["focus_mm"] == 25.0
    assert ask(talk, 2, do="undo")["values"]["lens"]["focus_mm"] == 20.0


def test_what_cannot_be_is_refused_and_changes_nothing(talk: ClientConnection) -> None:
    refused = ask(talk, 1, values={"lens.focus_mm": -1.0})
    assert refused["kind"] == "refused"
    assert "lens.focus_mm" in refused["what"]
    refused = ask(talk, 2, values={"emitter.offset_mm": 0.0, "body.arm_width_mm": 50.0})
    assert refused["kind"] == "refused"
    assert "body.arm_width_mm" in refused["what"]
    assert ask(talk, 3)["kind"] == "drawn"


def test_what_fails_in_a_session_ends_it_alone(
    served: Served, talk: ClientConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> bytes:
        raise ZeroDivisionError("a defect")

    with monkeypatch.context() as patch, served.join() as other:
        patch.setattr("solen.studio.session.picture_frame", fail)
        other.send(json.dumps({"id": 1, "view": {"angle_deg": 0.5}}))
        with pytest.raises(ConnectionClosed):
            until(other, lambda _: False)
    assert ask(talk, 7)["kind"] == "drawn"


def test_saving_keeps_comments_and_reads_back(served: Served, talk: ClientConnection) -> None:
    ask(talk, 1, values={"material.index": 1.5}, gesture="x")
    talk.send(json.dumps({"id": 2, "do": "save"}))
    until(talk, lambda head: head["kind"] == "saved")
    text = served.file.read_text(encoding="utf-8")
    assert text == DESIGN.replace("1.44 ", "1.5 ")
    assert load(served.file).material.index == 1.5
    assert ask(talk, 3, do="undo")["is_saved"] is False


def test_what_is_not_saved_is_kept_while_it_is_changed(
    served: Served, talk: ClientConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("solen.studio.server.UNSAVED_CHECK_S", 0.05)
    ask(talk, 1, values={"lens.half_width_mm": 1.9})
    beside = served.file.with_name("sensor-unsaved.toml")
    for _ in range(400):
        if beside.exists() and load(beside).lens.half_width_mm == 1.9:
            break
        time.sleep(0.02)
    else:
        raise AssertionError("it was never kept")
    ask(talk, 2, do="undo")


def test_an_address_of_another_computer_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"192\.0\.2\.1"):
        server_at(Document(tmp_path / "sensor.toml"), "192.0.2.1")


@pytest.mark.evidence
def test_a_killed_studio_leaves_a_whole_design(tmp_path: Path) -> None:
    """It saves again and again until it is killed: the file is the design of some save, with its comments."""
    file = tmp_path / "sensor.toml"
    for delay in (0.05, 0.1, 0.2, 0.4):
        file.write_text(DESIGN, encoding="utf-8")
        command = [sys.executable, "-m", "solen", "studio", str(file), "--no-browser", "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
            assert running.stdout is not None
            page = json.loads(running.stdout.readline())["address"]
            with Served(page, file).join() as talk:
                until(talk, lambda head: head["kind"] == "drawn")
                threading.Timer(delay, running.kill).start()
                with suppress(ConnectionClosed, OSError):
                    for number in range(10_000):
                        talk.send(json.dumps({"id": number, "values": {"lens.focus_mm": 20 + number / 1000}}))
                        talk.send(json.dumps({"id": number, "do": "save"}))
                        until(talk, lambda head: head["kind"] == "saved")
        kept = load(file).lens.focus_mm
        print(f"killed after {delay} s: focus {kept} mm, {len(list(tmp_path.iterdir()))} files")
        assert 20.0 <= kept < 30.0
        assert file.read_text(encoding="utf-8").startswith(DESIGN.removesuffix("\n"))
