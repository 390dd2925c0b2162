# SPDX-License-Identifier: Apache-2.0
"""Serves the page on this machine alone.

Any page that a browser shows may send requests to this machine. So a request has to name the
address that the server listens on (or a foreign name that was bound to it could read along), none
may come from another page, and one that changes something has to come from this one. One thing is
computed at a time, so that no page keeps more than one processor busy, and nothing waits for bytes
meanwhile.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import parse_qsl

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.base.reporting.page import page
from stickslip_ros.cli.pages.twin import live_parts, twin_page
from stickslip_ros.cli.workbench.controls import (
    CHOICES,
    GROUPS,
    SLIDERS,
    read_changes,
    set_names,
    shown_values,
)
from stickslip_ros.cli.workbench.curves import Overlay, curves
from stickslip_ros.cli.workbench.fitting import Fitting
from stickslip_ros.measurement.bags.load_motion import load_motion
from stickslip_ros.measurement.reading import Reading
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.measurement.twin.story import TwinStory
from stickslip_ros.physics.parameters import PARAMETERS, Parameters, read_yaml

HOST = "127.0.0.1"
_SCRIPTS = ("/chart.js", "/explore.js")
#: Bytes of a file that the page may send, and that are taken at a time.
_LARGEST, _CHUNK = 200_000_000, 1_000_000
#: Characters of a file name that are kept; systems take 255 bytes, up to four of them a character
_LONGEST_NAME = 60
#: Connections at once: a browser opens six
_MOST_CONNECTIONS = 32
#: What browsers say of a request of the page itself, and of an address that was typed
_OWN_SITE = ("same-origin", "none")
#: Options of a command that the page has fields for.
_FIELDS = ("columns", "units", "scale", "rate")
_OPTION = f"--({'|'.join(_FIELDS)})"
Answers = Mapping[str, Callable[[dict[str, str]], dict[str, Any]]]
_POLICY = (
    "default-src 'none'; script-src 'self'; connect-src 'self'; style-src 'unsafe-inline'; "
    "img-src data: blob:; frame-ancestors 'none'; form-action 'none'; base-uri 'none'"
)


class Panel:
    """A page that the server shows; `answers` are what its paths say to what they are asked."""

    policy = _POLICY

    def __init__(self, answers: Answers) -> None:
        """Answer on these paths."""
        self.answers = answers

    def html(self) -> str:
        """Return the page."""
        raise NotImplementedError


class TwinPanel(Panel):
    """What a twin says, while it says it."""

    policy = _POLICY.replace("script-src 'self'", "script-src 'unsafe-inline' 'unsafe-eval'")

    def __init__(self, story: TwinStory) -> None:
        """Show this, as it is when it is asked for."""
        super().__init__({"/twin": lambda _: live_parts(story)})
        self._story = story

    def html(self) -> str:
        """Return the page."""
        return twin_page(self._story, live=True).html("stickslip twin --page")


class AxesPanel(Panel):
    """Where simulated axes are, anew each second."""

    def __init__(
        self, what: str, heads: Sequence[str], rows: Callable[[], Sequence[Sequence[str]]]
    ) -> None:
        """Say what they are; a table with these heads, and the rows as they are when asked for."""
        super().__init__({})
        self._what, self._heads, self._rows = what, heads, rows

    def html(self) -> str:
        """Return the page."""
        return page("axes.html", what=self._what, heads=self._heads, rows=self._rows())


class Workbench(Panel):
    """The start of the page: parameters, and a measurement if there is one."""

    def __init__(self, base: Parameters, overlay: Overlay | None = None) -> None:
        """Start from these."""
        super().__init__({"/curves": self.answer, "/fit": lambda _: self.fitting.state})
        self._lock = threading.Lock()
        self._computes = threading.Lock()
        self._base, self._overlay = base, overlay
        self.fitting = Fitting(self._set)

    @property
    def state(self) -> tuple[Parameters, Overlay | None]:
        """Parameters and measured step."""
        with self._lock:
            return self._base, self._overlay

    def answer(self, texts: dict[str, str]) -> dict[str, Any]:
        """Return the curves for changes to the parameters. Raises StickslipError."""
        base, overlay = self.state
        with self._computes:
            return curves(base.replace(**read_changes(texts)), overlay)

    def fit(self, texts: dict[str, str]) -> dict[str, Any]:
        """Start to fit the contact to the measurement; say how far it is. Raises StickslipError."""
        base, overlay = self.state
        if overlay is None:
            raise TraceError("there is no measurement to fit to; open one below")
        return self.fitting.start(base.replace(**read_changes(texts)), overlay.motion)

    def _set(self, p: Parameters) -> None:
        with self._lock:
            self._base = p

    def open(self, path: Path, how: dict[str, str]) -> dict[str, Any]:
        """Take a parameter file or a measurement; say which. Raises StickslipError.

        how is what the page says of the columns of a measurement, as typed.
        """
        typed: Any = {name: text for name in _FIELDS if (text := how.get(name))}
        try:
            with self._computes:
                if path.suffix.lower() in (".yaml", ".yml"):
                    base = read_yaml(path)
                    curves(base)
                    self._set(base)
                    return {"parameters": path.name}
                overlay = Overlay.of(load_motion(path, Reading(**typed)).motion)
        except StickslipError as error:
            text = str(error).replace(f"{path.parent}/", "")
            raise TraceError(re.sub(_OPTION, r"\1 (below)", text)) from None
        with self._lock:
            self._overlay = overlay
        return {"measurement": path.name, "frequency": float(f"{overlay.frequency:.6g}")}

    def html(self) -> str:
        """Return the page."""
        base, overlay = self.state
        return page(
            "explore.html",
            groups=GROUPS,
            choices=CHOICES,
            values=shown_values(base),
            optional=[name for name in SLIDERS if PARAMETERS[name].optional],
            set_names=set_names(base),
            overlay=overlay,
        )


def _file_name(name: str) -> str:
    """Return the last part of a name that a browser sent, as one that every system takes."""
    last = re.sub(r"[^\w.,() +-]", "_", name.replace("\\", "/").rpartition("/")[2])
    return last[-_LONGEST_NAME:] if last.strip(".") else "file"


class WorkbenchServer(ThreadingHTTPServer):
    """Listens on this machine; `serve_forever` answers."""

    daemon_threads = True

    def __init__(self, panel: Panel, port: int = 0) -> None:
        """Listen on a port (0: a free one). Raises OSError."""
        self.panel = panel
        self._free = threading.BoundedSemaphore(_MOST_CONNECTIONS)
        super().__init__((HOST, port), _Handler)

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self.server_port}/"

    @property
    def names(self) -> set[str]:
        """The host names that a request may use for the server."""
        return {f"{host}:{self.server_port}" for host in (HOST, "localhost")}

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer a connection in a thread of its own, or close it where too many are open."""
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer it, and give its place free."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a browser that went away; log everything else."""
        if not isinstance(sys.exc_info()[1], ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Answers one connection."""

    server: WorkbenchServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "stickslip", ""
    disable_nagle_algorithm = True  # or an answer in two parts waits 40 ms for the first one's
    wbufsize = -1  # headers and body in one piece
    timeout = 20.0  # s, of a connection that says nothing

    def do_GET(self) -> None:
        """Answer with a part of the page, or with curves."""
        if not self._is_ours():
            return
        path, _, query = self.path.partition("?")
        if path == "/":
            self._send(self.server.panel.html().encode(), "text/html; charset=utf-8")
        elif path in _SCRIPTS:
            script = (Path(__file__).parent / path[1:]).read_bytes()
            self._send(script, "text/javascript; charset=utf-8")
        elif answer := self.server.panel.answers.get(path):
            self._say(lambda: answer(dict(parse_qsl(query, True))))
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such page")

    def do_POST(self) -> None:
        """Take a file, or start or cancel a fit."""
        if not self._is_ours():
            return
        path, _, query = self.path.partition("?")
        length, workbench = self.headers.get("Content-Length", ""), self.server.panel
        known = path in ("/open", "/fit", "/cancel") and "Origin" in self.headers
        if not (known and isinstance(workbench, Workbench)):
            self._refuse(HTTPStatus.FORBIDDEN, "files and fits are taken from the page only")
        elif path == "/fit":
            self._say(lambda: workbench.fit(dict(parse_qsl(query, True))))
        elif path == "/cancel":
            self._say(workbench.fitting.cancel)
        elif not re.fullmatch("[0-9]{1,12}", length) or int(length) > _LARGEST:
            limit = f"{_LARGEST // 1_000_000} MB"
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a file may have {limit}")
        else:
            how = dict(parse_qsl(query))
            with tempfile.TemporaryDirectory(prefix="stickslip-explore-") as folder:
                sent = Path(folder) / _file_name(how.pop("name", ""))
                with sent.open("wb") as file:
                    self._take(int(length), file)
                self._say(lambda: workbench.open(sent, how))

    def log_message(self, *_: Any) -> None:
        """Keep the terminal quiet."""

    def _take(self, length: int, file: BinaryIO) -> None:
        """Write so many bytes of the request to a file. ConnectionError if they end before."""
        while length:
            part = self.rfile.read(min(length, _CHUNK))
            if not part:
                raise ConnectionError("the connection ended within a file")
            file.write(part)
            length -= len(part)

    def _is_ours(self) -> bool:
        """Refuse what comes from elsewhere; a link to the page, of whatever page, is followed."""
        if self.headers.get("Host", "") not in self.server.names:
            self._refuse(HTTPStatus.FORBIDDEN, "this page is for this machine only")
            return False
        origin = self.headers.get("Origin", self.server.address)
        own = origin.removeprefix("http://").rstrip("/") in self.server.names
        own &= self.path == "/" or self.headers.get("Sec-Fetch-Site", "none") in _OWN_SITE
        if not own:
            self._refuse(HTTPStatus.FORBIDDEN, "this is answered to its own page only")
        return own

    def _say(self, make: Any) -> None:
        try:
            content = make()
        except StickslipError as error:
            content = {"error": str(error)}  # to a browser, another status is a fault of the page
        self._send(json.dumps(content, allow_nan=False).encode(), "application/json")

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        self.close_connection = True  # what else the request holds is not read
        self._send(f"{text}\n".encode(), "text/plain; charset=utf-8", status)

    def _send(self, content: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", self.server.panel.policy)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(content)
