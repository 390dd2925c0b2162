# SPDX-License-Identifier: Apache-2.0
"""The page in a real Chromium: sliders, keyboard, light and dark, wide and narrow, its speed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from table_1 import TABLE_1

import stickslip_ros as ss
from stickslip_ros.cli.workbench.curves import Overlay
from stickslip_ros.cli.workbench.server import Workbench, WorkbenchServer
from stickslip_ros.physics.parameters import Parameters

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

#: s, a browser may take on a machine that is busy
PATIENCE_MS = 60_000.0
Open = Callable[..., "Page"]


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    overlay = Overlay.of(ss.read_measurement("steps_100hz.csv"))
    with WorkbenchServer(Workbench(Parameters.of(TABLE_1), overlay)) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.address
        server.shutdown()
        thread.join()


@pytest.fixture
def open_page(browser: Browser, address: str) -> Iterator[Open]:
    """Open the page; at the end there must have been no message on its console."""
    said: list[str] = []
    pages = []

    def opened(width: int = 1400, scheme: str = "light") -> Page:
        chosen: Any = scheme
        page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=chosen)
        page.set_default_timeout(PATIENCE_MS)
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.goto(address)
        drawn(page, 1)
        pages.append(page)
        return page

    yield opened
    for page in pages:
        page.close()
    assert said == []


def drawn(page: Page, count: int | None = None) -> int:
    """Wait until the page has drawn so many answers, or one more; return how many."""
    if count is None:
        count = int(page.get_attribute("body", "data-drawn") or 0) + 1
    page.wait_for_selector(f"body[data-drawn='{count}']")
    return count


def number(page: Page, what: str) -> str:
    return page.locator(".card", has_text=what).first.locator(".value").inner_text()


@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (390, "dark")])
def test_it_fits_and_stands_out(open_page: Open, width: int, scheme: str) -> None:
    page = open_page(width, scheme)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for place in ("step", "slip", "over-preload", "over-amplitude", "over-frequency"):
        box = page.locator(f"#{place} svg").bounding_box()
        assert box
        assert box["width"] > 150
        assert page.locator(f"#{place} path.runner").count() == 1
    for name in ("step", "slip"):
        assert page.locator(f"#{name} path.measured").count() == 1
    assert number(page, "step size") == "133.8 nm"
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (background == "rgb(255, 255, 255)") == (scheme == "light")
    for selector, of, least in (
        ("h1", "color", 7.0),
        (".entry", "color", 4.5),
        (".hint", "color", 4.5),
        ("#step path.runner", "stroke", 3.0),
        ("#step path.actuator", "stroke", 3.0),
        ("#step path.measured", "stroke", 3.0),
    ):
        assert contrast(page, selector, of) >= least, selector


def contrast(page: Page, selector: str, of: str) -> float:
    """Return the contrast of an element's colour and the page, as WCAG 2.1 defines it."""

    def luminance(text: str) -> float:
        parts = [int(one) / 255 for one in text[text.index("(") + 1 : -1].split(",")[:3]]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
        return float(sum(w * c for w, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True)))

    script = "([s, of]) => getComputedStyle(document.querySelector(s))[of]"
    pair = (
        luminance(page.evaluate(script, [selector, of])),
        luminance(page.evaluate(script, ["body", "backgroundColor"])),
    )
    return (max(pair) + 0.05) / (min(pair) + 0.05)


@pytest.mark.parametrize(
    ("scheme", "width"), [("dark", 390), pytest.param("light", 1400, marks=pytest.mark.long)]
)
def test_axe_finds_no_violation(browser: Browser, address: str, scheme: Any, width: int) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    context = browser.new_context(
        viewport={"width": width, "height": 900}, color_scheme=scheme, bypass_csp=True
    )  # the policy of the page would refuse the script of axe
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(address)
    drawn(page, 1)
    found = axe.Axe().run(page)
    context.close()
    assert found.violations_count == 0, found.generate_report()


def test_everything_can_be_done_with_the_keyboard(open_page: Open) -> None:
    page = open_page()
    page.keyboard.press("Tab")
    reached = []
    for _ in range(60):
        where = page.evaluate("document.activeElement.id || document.activeElement.dataset.kind")
        if where in reached or where is None:
            break
        reached.append(where)
        outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        assert outline != "none", where  # where one is can be seen
        page.keyboard.press("Tab")
    assert reached[:2] == ["n-amplitude", "r-amplitude"]
    for name in ("r-preload", "n-mass", "c-model", "c-waveform", "YAML", "Command", "file-p"):
        assert name in reached
    page.focus("#r-preload")
    before = number(page, "step size")
    count = int(page.get_attribute("body", "data-drawn") or 0)
    page.keyboard.press("End")
    drawn(page, count + 1)
    assert page.input_value("#n-preload") == "10"
    assert number(page, "step size") != before
    assert page.get_attribute("#r-preload", "aria-valuetext") == "10 N"


def test_a_number_can_be_typed_and_what_cannot_be_is_explained(open_page: Open) -> None:
    page = open_page()
    count = int(page.get_attribute("body", "data-drawn") or 0)
    page.fill("#n-preload", "1")
    drawn(page, count + 1)
    assert number(page, "step size") == "113.2 nm"
    page.fill("#n-preload", "1e6")
    page.wait_for_selector("#trouble:not([hidden])")
    assert "it has to lie between" in page.inner_text("#trouble")
    page.fill("#n-preload", "1")
    page.wait_for_selector("#trouble", state="hidden")


def test_the_laws_own_value_can_be_set_and_given_back(open_page: Open) -> None:
    page = open_page()
    own = page.locator("[data-name=z_ba] button.own")
    assert own.is_disabled()
    count = int(page.get_attribute("body", "data-drawn") or 0)
    page.fill("#n-z_ba", "60")
    drawn(page, count + 1)
    assert own.is_enabled()
    own.click()
    page.wait_for_selector("[data-name=z_ba].unset")
    drawn(page, count + 2)
    assert page.input_value("#n-z_ba") == "18"


def test_what_is_copied_stands_below(open_page: Open) -> None:
    page = open_page()
    page.click("text=Copy as Command")
    page.wait_for_selector("#text:not([hidden])")
    assert page.input_value("#text").startswith("stickslip simulate --steps 30")


def test_a_measurement_is_read_as_the_fields_say(open_page: Open) -> None:
    page = open_page()
    rows = "".join(f"{k}\t5\n" for k in range(2000))
    file: Any = {"name": "raw.csv", "mimeType": "text/csv", "buffer": ("a\tb\n" + rows).encode()}
    page.set_input_files("#file-m", file)
    page.wait_for_selector("#trouble:not([hidden])")
    assert "units (below) t=ms,x=nm" in page.inner_text("#trouble")
    page.click("#how")
    page.fill("#how-units", "t=us,x=nm")
    page.set_input_files("#file-m", file)
    page.wait_for_selector("#trouble:has-text('no steps are found in raw.csv')")


def test_the_address_holds_the_changes_and_reset_ends_them(open_page: Open) -> None:
    page = open_page()
    count = int(page.get_attribute("body", "data-drawn") or 0)
    page.fill("#n-preload", "1")
    page.select_option("#c-waveform", "triangle")
    drawn(page, count + 2)
    size = number(page, "step size")
    page.reload()
    drawn(page, 1)
    assert page.input_value("#n-preload") == "1"
    assert page.input_value("#c-waveform") == "triangle"
    assert number(page, "step size") == size
    with page.expect_navigation():
        page.click("#reset")
    drawn(page, 1)
    assert page.evaluate("location.hash") == ""
    assert number(page, "step size") == "133.8 nm"


@pytest.mark.long
def test_a_plot_is_moved_and_zoomed(open_page: Open) -> None:
    page = open_page()

    def ticks() -> list[str]:
        return page.locator("#step svg text[text-anchor=middle]:not(.label)").all_text_contents()

    whole = ticks()
    page.focus("#step")
    page.keyboard.press("+")
    page.keyboard.press("+")
    assert ticks() != whole
    near = page.locator("#step path.runner").get_attribute("d")
    page.keyboard.press("ArrowRight")
    assert page.locator("#step path.runner").get_attribute("d") != near
    count = int(page.get_attribute("body", "data-drawn") or 0)
    seen = ticks()
    page.fill("#n-preload", "0.5")
    drawn(page, count + 1)
    assert ticks() == seen  # what is looked at stays while a slider moves
    page.focus("#step")
    page.keyboard.press("0")
    assert ticks() == whole
    box = page.locator("#slip").bounding_box()
    assert box
    before = page.locator("#slip path.runner").get_attribute("d")
    page.mouse.move(box["x"] + 150, box["y"] + 150)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 150)
    page.mouse.up()
    assert page.locator("#slip path.runner").get_attribute("d") != before
    page.dblclick("#slip")
    assert page.locator("#slip path.runner").get_attribute("d") == before


def test_a_plot_is_saved_as_picture_and_data(open_page: Open, tmp_path: Path) -> None:
    page = open_page()
    begins = {"SVG": b"<svg", "PNG": b"\x89PNG", "CSV": b"time (ms),runner (nm),actuator (nm)\n"}
    for kind, begin in begins.items():
        with page.expect_download() as download:
            page.click(f"text=as {kind}")
        file = tmp_path / download.value.suggested_filename
        download.value.save_as(file)
        assert file.name == f"stickslip-step.{kind.lower()}"
        assert file.read_bytes().startswith(begin)
    text = (tmp_path / "stickslip-step.svg").read_text()
    assert "stroke: rgb(" in text  # the colours are in the file
    rows = (tmp_path / "stickslip-step.csv").read_text().splitlines()
    assert len(rows) > 500


@pytest.mark.long
@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.long)])
def test_the_contact_is_fitted_to_the_measurement(browser: Browser, whole: bool) -> None:
    """From a wrong stiffness back to that of the sample, then shown by the sliders."""
    overlay = Overlay.of(ss.read_measurement("steps_100hz.csv"))
    start = Parameters.of({**TABLE_1, "sigma_0": 1.5 * 9.0e6, "sigma_1": 12.0})
    with WorkbenchServer(Workbench(start, overlay)) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        page = browser.new_page()
        page.set_default_timeout(2 * PATIENCE_MS)
        page.goto(server.address)
        drawn(page, 1)
        page.click("#fit")
        page.wait_for_selector("#cancel:not([hidden])")
        page.click("#cancel")
        page.wait_for_selector("#cancel", state="hidden")
        assert page.locator("#fit").is_enabled()
        if whole:
            page.click("#fit")
            page.wait_for_selector("#report:not([hidden])")
            assert "sigma_0 " in page.inner_text("#report")
            assert isinstance(server.panel, Workbench)
            fitted = server.panel.state[0].friction.sigma_0
            assert fitted == pytest.approx(9.0e6, rel=0.1)
            shown = float(page.input_value("#n-sigma_0"))
            assert shown == pytest.approx(1e-6 * (fitted or 0.0), rel=1e-3)
        page.close()
        server.shutdown()
        thread.join()
