# SPDX-License-Identifier: Apache-2.0
"""The server of the page: this machine alone, answers, files, and what it refuses."""

import contextlib
import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from table_1 import TABLE_1

from stickslip_ros.cli.main import main
from stickslip_ros.cli.workbench.server import HOST, Workbench, WorkbenchServer
from stickslip_ros.physics.parameters import Parameters

SAMPLES = Path(__file__).parents[3] / "examples" / "samples"


@pytest.fixture
def server() -> Iterator[WorkbenchServer]:
    with WorkbenchServer(Workbench(Parameters.of(TABLE_1))) as found:
        thread = threading.Thread(target=found.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield found
        found.shutdown()
        thread.join()


def ask(
    server: WorkbenchServer, path: str, body: bytes | None = None, **headers: str
) -> tuple[int, str, http.client.HTTPMessage]:
    connection = http.client.HTTPConnection(HOST, server.server_port, timeout=60)
    connection.request("GET" if body is None else "POST", path, body, headers)
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, text, answer.headers


def curves(server: WorkbenchServer, query: str) -> dict[str, Any]:
    status, text, _ = ask(server, f"/curves?{query}")
    assert status == 200
    found: dict[str, Any] = json.loads(text)
    return found


def test_the_page_has_everything_it_asks_for(server: WorkbenchServer) -> None:
    status, text, headers = ask(server, "/")
    assert status == 200
    for script in ("/chart.js", "/explore.js"):
        assert f'src="{script}"' in text
        assert ask(server, script)[0] == 200
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "https://" not in text


def test_what_cannot_be_is_answered_with_the_reason(server: WorkbenchServer) -> None:
    for query, complaint in (
        ("preload=1e9", "preload is 1e+09 N; it has to lie between"),
        ("frequency=200000", "frequency is 200000 Hz"),
        ("hysteresis_file=/etc/passwd", "there is no control"),
        ("z_ba=0.1", "z_ba"),
    ):
        assert complaint in curves(server, query)["error"]


def test_a_foreign_name_for_this_machine_is_refused(server: WorkbenchServer) -> None:
    """A page of another site could bind its name to 127.0.0.1 and read the answers."""
    status, text, _ = ask(server, "/curves", Host="evil.example")
    assert (status, text) == (403, "this page is for this machine only\n")
    assert ask(server, "/", Host=f"localhost:{server.server_port}")[0] == 200


@pytest.mark.parametrize(
    "headers",
    [{"Origin": "http://evil.example"}, {"Origin": "null"}, {"Sec-Fetch-Site": "cross-site"}],
)
def test_nothing_is_computed_for_another_page(
    server: WorkbenchServer, headers: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A picture of another page could have curves computed, whose answer it cannot read."""
    asked: list[object] = []
    curves = "stickslip_ros.cli.workbench.server.curves"
    monkeypatch.setattr(curves, lambda *given: asked.append(given))
    assert ask(server, "/curves", None, **headers)[0] == 403
    assert asked == []
    link = {"Sec-Fetch-Site": "cross-site"}
    assert ask(server, "/", None, **link)[0] == 200  # it is followed


def test_files_are_taken_from_the_page_only(server: WorkbenchServer) -> None:
    for headers in ({}, {"Origin": "http://evil.example"}, {"Origin": "null"}):
        assert ask(server, "/open?name=a.csv", b"t,x\n", **headers)[0] == 403
    assert ask(server, "/nothing")[0] == 404


def test_it_listens_on_this_machine_only(server: WorkbenchServer) -> None:
    assert server.server_address[0] == "127.0.0.1"
    other = socket.socket()
    other.settimeout(0.5)
    mine = socket.gethostbyname_ex(socket.gethostname())[2]
    for address in (one for one in mine if not one.startswith("127.")):
        with pytest.raises(OSError):
            other.connect((address, server.server_port))
    other.close()


def post(server: WorkbenchServer, name: str, content: bytes) -> dict[str, Any]:
    origin = server.address.rstrip("/")
    status, text, _ = ask(server, f"/open?name={name}", content, Origin=origin)
    assert status == 200
    found: dict[str, Any] = json.loads(text)
    return found


def test_a_fit_needs_a_measurement_and_a_request_of_the_page(server: WorkbenchServer) -> None:
    origin = server.address.rstrip("/")
    assert json.loads(ask(server, "/fit")[1]) == {"state": "idle"}
    assert ask(server, "/fit", b"", Origin="http://evil.example")[0] == 403
    answer = json.loads(ask(server, "/fit", b"", Origin=origin)[1])
    assert answer == {"error": "there is no measurement to fit to; open one below"}


def test_a_measurement_from_the_page_is_laid_over(server: WorkbenchServer) -> None:
    name = "steps_100hz.csv"
    answer = post(server, name, (SAMPLES / name).read_bytes())
    assert answer == {"measurement": name, "frequency": pytest.approx(100.0, rel=1e-4)}
    assert curves(server, "")["numbers"]["step measured"].startswith("133.")
    assert name in ask(server, "/")[1]


def test_parameters_from_the_page_are_its_new_start(server: WorkbenchServer) -> None:
    text = b"/**:\n  ros__parameters:\n    preload: 1.0\n    z_ba: 2.0e-8\n"
    assert post(server, "fitted.yaml", text) == {"parameters": "fitted.yaml"}
    found = curves(server, "")
    assert (found["values"]["preload"], found["set"]) == (1.0, ["z_ba"])


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("a.yaml", b"x:\n  preload: 1.0\n", "ros__parameters"),
        ("a.yaml", b"/**:\n  ros__parameters:\n    preload: 1000000000.0\n", "preload is 1e+09"),
        ("..%2f..%2fa.csv", b"t,x\n1,2\n", "a.csv"),
        ("empty.csv", b"", "empty.csv"),
        ("..", b"t,x\n1,2\n", "file"),
        ("a%00b.csv", b"t,x\n1,2\n", "a_b.csv"),
        (300 * "%C3%A4" + ".csv", b"t,x\n1,2\n", "\u00e4.csv"),
        ("noise.bin", bytes(range(256)) * 10, "noise.bin"),
    ],
)
def test_a_bad_file_is_refused_and_nothing_changes(
    server: WorkbenchServer, name: str, content: bytes, complaint: str
) -> None:
    assert isinstance(server.panel, Workbench)
    before = server.panel.state
    error = post(server, name, content)["error"]
    assert complaint in error
    assert "stickslip-explore-" not in error
    assert server.panel.state == before


def test_what_is_no_request_is_refused_without_a_traceback(
    server: WorkbenchServer, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ask(server, "/open?name=a.csv", b"t,x\n", Origin="http://[")[0] == 403
    assert ask(server, "//[")[0] == 404
    ours = {"Origin": server.address.rstrip("/")}
    assert ask(server, "/open?name=a.csv", b"", **ours, **{"Content-Length": 5000 * "9"})[0] == 413
    assert "Traceback" not in capsys.readouterr().err


def test_a_request_that_stalls_holds_up_nobody(server: WorkbenchServer) -> None:
    """Half of a file kept all others out for two minutes."""
    origin = server.address.rstrip("/")
    with socket.create_connection((HOST, server.server_port)) as slow:
        head = f"POST /open?name=a.csv HTTP/1.1\r\nHost: {origin[7:]}\r\nOrigin: {origin}\r\n"
        slow.sendall(f"{head}Content-Length: 1000\r\n\r\nt,x".encode())
        assert "error" in post(server, "b.csv", b"0")
        assert curves(server, "")["set"] == []


def test_one_thing_is_computed_at_a_time(
    server: WorkbenchServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A page that asked for curves again and again kept every processor busy."""
    at_once, most = [0], [0]

    def count(*given: Any) -> dict[str, Any]:
        at_once[0] += 1
        most[0] = max(most[0], at_once[0])
        time.sleep(0.02)
        at_once[0] -= 1
        return {}

    monkeypatch.setattr("stickslip_ros.cli.workbench.server.curves", count)
    threads = [threading.Thread(target=ask, args=(server, "/curves")) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1]


def test_more_connections_than_it_takes_are_closed(server: WorkbenchServer) -> None:
    open_ones = [socket.create_connection((HOST, server.server_port)) for _ in range(33)]
    open_ones[-1].settimeout(10.0)
    assert open_ones[-1].recv(1) == b""
    for one in open_ones:
        one.close()
    for _ in range(100):
        with contextlib.suppress(ConnectionError):
            assert ask(server, "/chart.js")[0] == 200
            return
        time.sleep(0.05)
    pytest.fail("the places of those that left are not free again")


def test_a_port_in_use_is_told(server: WorkbenchServer, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explore", "--no-browser", "--port", str(server.server_port)]) == 2
    assert "choose another --port" in capsys.readouterr().err
