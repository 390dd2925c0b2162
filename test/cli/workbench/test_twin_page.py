# SPDX-License-Identifier: Apache-2.0
"""The page of a twin that runs, in a real Chromium: it follows what the twin says."""

from __future__ import annotations

import http.client
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from stickslip_ros.cli.workbench.server import HOST, TwinPanel, WorkbenchServer
from stickslip_ros.measurement.twin import TrackedParameter
from stickslip_ros.measurement.twin.story import TwinStory

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PATIENCE_MS = 60_000.0


@pytest.fixture
def story() -> TwinStory:
    return TwinStory("/stickslip_twin")


@pytest.fixture
def server(story: TwinStory) -> Iterator[WorkbenchServer]:
    with WorkbenchServer(TwinPanel(story)) as found:
        thread = threading.Thread(target=found.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield found
        found.shutdown()
        thread.join()


def test_the_page_follows_the_twin(
    browser: Browser, server: WorkbenchServer, story: TwinStory
) -> None:
    said: list[str] = []
    page = browser.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.on("console", lambda message: said.append(message.text))
    page.goto(server.address)
    page.wait_for_selector("body[data-drawn] #residual .main-svg")
    assert "nothing was heard of the twin yet" in page.inner_text("#known")
    story.readings.extend((0.1 * k, 1e-7 * k, 1e-7 * k + 1e-9, 2e-9) for k in range(30))
    for t in (1.0, 2.0):
        story.history.append((t, [TrackedParameter("preload", "N", 0.4, 0.38, 0.42, True)]))
    story.changes.append((1.0, 1.5, "step 1 nm to 2 nm <b>"))
    story.level, story.troubles = "changed", {"gaps": 3}
    page.wait_for_selector("#estimate-0 .main-svg")  # a plot that was not there before
    text = page.inner_text("#known")
    for part in ("changed", "step 1 nm to 2 nm <b>", "3 gaps", "0.38000 N to 0.42000 N"):
        assert part in text
    marked, lines = page.evaluate(
        "(() => { const p = document.getElementById('estimate-0');"
        " return [p.layout.shapes.length, p.data.length]; })()"
    )
    assert marked == 1 and lines == 3
    story.readings.append((9.0, 5e-6, 5e-6, 2e-9))
    page.wait_for_function("document.getElementById('position').data[0].x.at(-1) === 9")
    assert said == []
    page.close()


def test_a_twin_takes_no_files(server: WorkbenchServer) -> None:
    connection = http.client.HTTPConnection(HOST, server.server_port, timeout=60)
    origin = {"Origin": server.address.rstrip("/")}
    connection.request("POST", "/open", b"preload: 1", origin)
    assert connection.getresponse().status == 403
    connection.close()
