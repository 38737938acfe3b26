"""The server of the studio: requests from elsewhere are refused, and connected pages continue."""

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
    """A running studio."""

    page: str
    file: Path

    @property
    def origin(self) -> str:
        """Origin of the page."""
        return self.page.rsplit("/", 2)[0]

    @property
    def page_connection(self) -> str:
        """Address of the WebSocket."""
        return f"ws{self.page.removeprefix('http')}ws"

    def connect_page(self, **options: Any) -> ClientConnection:
        """A connection like that of the page."""
        return connection(self.page_connection, **{"origin": self.origin, **options})


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
    assert load(file.with_name("sensor-unsaved.toml")).material.index == 1.44, "a change was undone after saving"


def connection(address: str, **options: Any) -> ClientConnection:
    """A connection to a WebSocket."""
    return connect(address, max_size=None, proxy=None, legacy=True, **options)


def receive_until(page_connection: ClientConnection, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Header of the next frame that satisfies a condition."""
    for _ in range(200):
        frame = page_connection.recv(timeout=120)
        assert isinstance(frame, bytes)
        head, _ = decoded(frame)
        if condition(head):
            return head
    raise AssertionError("no such frame was received")


def ask(page_connection: ClientConnection, number: int, **request: Any) -> dict[str, Any]:
    """Send a request, and wait for the reply: a drawing or an error."""
    page_connection.send(json.dumps({"id": number, **request}))
    return receive_until(page_connection, lambda head: head.get("id") == number)


@pytest.fixture
def page_connection(served: Served) -> Iterator[ClientConnection]:
    with served.connect_page() as connection:
        receive_until(connection, lambda head: head["kind"] == "drawn")
        yield connection


def test_page_loads_nothing_from_elsewhere(served: Served) -> None:
    page = httpx.get(served.page)
    assert page.status_code == 200
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in page.text.replace('"http-equiv"', "")
    assert httpx.get(f"{served.page}studio.js").headers["content-type"].startswith("text/javascript")


@pytest.mark.parametrize("path", ["../server.py", "%2e%2e/server.py", "..%2fserver.py", "/etc/passwd", "__init__.py"])
def test_serves_only_files_of_page(served: Served, path: str) -> None:
    host, port = served.origin.removeprefix("http://").split(":")
    token = served.page.rsplit("/", 2)[1]
    with closing(socket.create_connection((host, int(port)))) as raw:  # an HTTP client would normalise the path
        raw.sendall(f"GET /{token}/{path} HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: close\r\n\r\n".encode())
        reply = b"".join(iter(lambda: raw.recv(65536), b""))
    assert reply.split()[1] == b"404"
    assert b"root" not in reply
    assert b"import" not in reply


def test_accepts_files_and_requests_only_from_own_page_within_limits(served: Served) -> None:
    own_origin, foreign = {"Origin": served.origin}, {"Origin": "http://studio.example"}
    dropped = f"{served.page}files/resin/"
    assert httpx.put(f"{dropped}a.csv", content=b"1").status_code == 403
    assert httpx.put(f"{dropped}a.csv", content=b"1", headers=foreign).status_code == 403
    for name in ("..%2F..%2Fa.csv", "%2e%2e", "a%5Cb.csv"):
        httpx.put(f"{dropped}{name}", content=b"a,b\n1,2\n2,3\n", headers=own_origin)
    folder = served.file.with_name("sensor-studio")
    assert {
        connection_in_crowd.parent
        for connection_in_crowd in served.file.parent.rglob("*")
        if connection_in_crowd.suffix == ".csv"
    } <= {folder}
    for message in (b"{", b"[]", b'{"command": "doctor"}', b'{"command": "resin cure", "asked": 3}', b"x" * 2**17):
        reply = httpx.post(f"{served.page}jobs", content=message, headers=own_origin)
        assert reply.status_code == 400
        assert reply.json()["what"]
    assert httpx.get(f"{served.page}jobs/7").status_code == 400
    assert httpx.get(f"{served.page}tabs/server").status_code == 400


def test_refuses_requests_from_elsewhere(served: Served) -> None:
    wrong = f"{served.origin}/{'x' * 32}/"
    assert httpx.get(wrong).status_code == 404
    assert httpx.get(f"{served.origin}/").status_code == 404
    assert httpx.get(served.page, headers={"Host": "studio.example"}).status_code == 403, "DNS rebinding"
    assert httpx.get(served.page, headers={"Origin": "http://studio.example"}).status_code == 403
    assert httpx.post(served.page, content=b"x" * 1000).status_code == 403, "no Origin"
    assert httpx.patch(served.page, content=b"x" * 1000).status_code == 405


@pytest.mark.parametrize(
    "options",
    [
        {"origin": None},
        {"origin": "http://studio.example"},
        {"origin": "null"},
        {"additional_headers": {"Host": "studio.example"}},
    ],
)
def test_foreign_page_cannot_connect(served: Served, options: dict[str, Any]) -> None:
    with pytest.raises(InvalidStatus) as refusal:
        served.connect_page(**options)
    assert refusal.value.response.status_code in {400, 403}


def test_wrong_token_cannot_connect(served: Served) -> None:
    token = served.page.rsplit("/", 2)[1]
    with pytest.raises(InvalidStatus):
        connection(served.page_connection.replace(token, "x" * len(token)), origin=served.origin)


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


def test_session_continues_after_malformed_message(page_connection: ClientConnection) -> None:
    for message in MALFORMED:
        page_connection.send(message)
        assert receive_until(page_connection, lambda head: head["kind"] == "refused")["what"], message
    assert ask(page_connection, 5, view={"angle_deg": 1.0})["angle_deg"] == 1.0


def test_message_of_100_MB_ends_only_its_connection(served: Served, page_connection: ClientConnection) -> None:
    with served.connect_page() as second:
        head = bytes([0x81, 0xFF, *(100_000_000).to_bytes(8), 0, 0, 0, 0])
        second.socket.sendall(head + b" " * MAX_MESSAGE_BYTES)
        with pytest.raises(ConnectionClosed):
            receive_until(second, lambda _: False)
    assert ask(page_connection, 1, view={"angle_deg": -1.0})["angle_deg"] == -1.0
    assert MAX_MESSAGE_BYTES < 100_000


CONNECTIONS = 1000


def test_thousand_connections_do_not_disturb_session(served: Served, page_connection: ClientConnection) -> None:
    resource = pytest.importorskip("resource")  # both ends of each connection are in this process
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 4 * CONNECTIONS)), hard))
    host, port = served.origin.removeprefix("http://").split(":")
    connections = [socket.create_connection((host, int(port))) for _ in range(CONNECTIONS)]
    try:
        assert ask(page_connection, 2, view={"angle_deg": 2.0})["angle_deg"] == 2.0
        assert httpx.get(served.page).status_code == 503
    finally:
        for connection_in_crowd in connections:
            connection_in_crowd.close()


def test_number_of_pages_is_limited(
    served: Served, page_connection: ClientConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("solen.studio.server.MAX_PAGES", 1)
    with pytest.raises(InvalidStatus):
        served.connect_page()
    assert ask(page_connection, 1)["kind"] == "drawn"


def test_drag_is_not_queued(page_connection: ClientConnection) -> None:
    """Most of a hundred consecutive requests are dropped, and the last reply is to the last request."""
    for number in range(1, 101):
        page_connection.send(
            json.dumps({"id": number, "values": {"emitter.offset_mm": number / 1000}, "gesture": "a drag"})
        )
    replied: list[int] = []
    while not replied or replied[-1] < 100:
        replied.append(receive_until(page_connection, lambda head: head["kind"] == "drawn")["id"])
    assert len(replied) < 50
    assert replied == sorted(replied)
    page_connection.send(json.dumps({"id": 101, "do": "undo"}))
    after_undo = receive_until(page_connection, lambda head: head["kind"] == "drawn")
    assert after_undo["id"] == 101, "nothing was queued"
    assert after_undo["values"]["emitter"]["offset_mm"] == 0.0, "a drag is one step"


def test_second_page_receives_change(served: Served, page_connection: ClientConnection) -> None:
    with served.connect_page() as second:
        receive_until(second, lambda head: head["kind"] == "rest")
        ask(page_connection, 1, values={"lens.focus_mm": 25.0})
        head = receive_until(second, lambda head: head["kind"] == "drawn" and "values" in head)
        assert head["values"]["lens"]["focus_mm"] == 25.0
    assert ask(page_connection, 2, do="undo")["values"]["lens"]["focus_mm"] == 20.0


def test_invalid_change_is_refused_and_has_no_effect(page_connection: ClientConnection) -> None:
    refusal = ask(page_connection, 1, values={"lens.focus_mm": -1.0})
    assert refusal["kind"] == "refused"
    assert "lens.focus_mm" in refusal["what"]
    refusal = ask(page_connection, 2, values={"emitter.offset_mm": 0.0, "body.arm_width_mm": 50.0})
    assert refusal["kind"] == "refused"
    assert "body.arm_width_mm" in refusal["what"]
    assert ask(page_connection, 3)["kind"] == "drawn"


def test_error_ends_only_its_session(
    served: Served, page_connection: ClientConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> bytes:
        raise ZeroDivisionError("a defect")

    with monkeypatch.context() as patch, served.connect_page() as second:
        patch.setattr("solen.studio.session.picture_frame", fail)
        second.send(json.dumps({"id": 1, "view": {"angle_deg": 0.5}}))
        with pytest.raises(ConnectionClosed):
            receive_until(second, lambda _: False)
    assert ask(page_connection, 7)["kind"] == "drawn"


def test_saving_keeps_comments(served: Served, page_connection: ClientConnection) -> None:
    ask(page_connection, 1, values={"material.index": 1.5}, gesture="x")
    page_connection.send(json.dumps({"id": 2, "do": "save"}))
    receive_until(page_connection, lambda head: head["kind"] == "saved")
    text = served.file.read_text(encoding="utf-8")
    assert text == DESIGN.replace("1.44 ", "1.5 ")
    assert load(served.file).material.index == 1.5
    assert ask(page_connection, 3, do="undo")["is_saved"] is False


def test_unsaved_changes_are_written_while_editing(
    served: Served, page_connection: ClientConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("solen.studio.server.UNSAVED_CHECK_S", 0.05)
    ask(page_connection, 1, values={"lens.half_width_mm": 1.9})
    unsaved_file = served.file.with_name("sensor-unsaved.toml")
    for _ in range(400):
        if unsaved_file.exists() and load(unsaved_file).lens.half_width_mm == 1.9:
            break
        time.sleep(0.02)
    else:
        raise AssertionError("the file was not written")
    ask(page_connection, 2, do="undo")


def test_refuses_address_of_other_computer(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"192\.0\.2\.1"):
        server_at(Document(tmp_path / "sensor.toml"), "192.0.2.1")


@pytest.mark.evidence
def test_killed_studio_leaves_valid_design(tmp_path: Path) -> None:
    """A studio that is killed while saving repeatedly leaves one of the saved designs, with comments."""
    file = tmp_path / "sensor.toml"
    for delay in (0.05, 0.1, 0.2, 0.4):
        file.write_text(DESIGN, encoding="utf-8")
        command = [sys.executable, "-m", "solen", "studio", str(file), "--no-browser", "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
            assert running.stdout is not None
            page = json.loads(running.stdout.readline())["address"]
            with Served(page, file).connect_page() as page_connection:
                receive_until(page_connection, lambda head: head["kind"] == "drawn")
                threading.Timer(delay, running.kill).start()
                with suppress(ConnectionClosed, OSError):
                    for number in range(10_000):
                        page_connection.send(
                            json.dumps({"id": number, "values": {"lens.focus_mm": 20 + number / 1000}})
                        )
                        page_connection.send(json.dumps({"id": number, "do": "save"}))
                        receive_until(page_connection, lambda head: head["kind"] == "saved")
        kept = load(file).lens.focus_mm
        print(f"killed after {delay} s: focus {kept} mm, {len(list(tmp_path.iterdir()))} files")
        assert 20.0 <= kept < 30.0
        assert file.read_text(encoding="utf-8").startswith(DESIGN.removesuffix("\n"))
