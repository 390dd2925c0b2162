# SPDX-License-Identifier: Apache-2.0
"""The site: built without a warning, whole without a network, no dead link, every public name."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

import pytest
from child import python

if TYPE_CHECKING:
    from playwright.sync_api import Browser

ROOT = Path(__file__).parents[2]


class Links(HTMLParser):
    """The targets of the links of a page, the places in it, and what it loads from elsewhere."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.loaded: list[str] = []
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id" and value:
                self.places.add(value)
            if name in ("href", "src") and value:
                self.targets.append(value)
            if tag != "a" and name in ("href", "src", "data") and urlsplit(value or "").netloc:
                self.loaded.append(value or "")


def dead_links(folder: Path) -> Iterator[str]:
    """Yield what leads nowhere within a site."""
    pages = {
        file.resolve(): Links(file.read_text(encoding="utf-8")) for file in folder.rglob("*.html")
    }
    for page, links in pages.items():
        for target in links.targets:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            file = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            known = pages.get(file)
            anchor = unquote(parts.fragment)
            if not file.exists() or (anchor and known and anchor not in known.places):
                yield f"{page.name}: {target}"


@pytest.fixture(scope="module")
def site() -> Path:
    """Give the folder of ``make site``, which has just built it; build it where it is missing.

    Built a second time, it would lose the entries of the index that its search knows.
    """
    folder = ROOT / "docs" / "_build" / "site"
    if (folder / "searchindex.js").exists():
        return folder
    run = python("-m", "sphinx", "-q", "-W", "-b", "html", str(ROOT / "docs"), str(folder))
    assert run.returncode == 0, run.stderr
    return folder


def test_the_site_has_no_dead_link_and_every_public_name(site: Path) -> None:
    assert list(dead_links(site)) == []
    pages = [Links(file.read_text(encoding="utf-8")) for file in site.rglob("*.html")]
    assert [one for page in pages for one in page.loaded] == []
    api = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\.\. auto\w+:: stickslip_ros\.(\w+)$", api, re.MULTILINE)
    places = Links((site / "api.html").read_text(encoding="utf-8")).places
    # A class that stands elsewhere is found under the name of its own module.
    assert sorted(set(listed) - {place.rpartition(".")[2] for place in places}) == []


#: What the search of a page needs of a browser.
BROWSER = """
globalThis.window = globalThis; window.location = {search: ""}; window.setTimeout = () => null;
const nothing = {dataset: {content_root: ""}, appendChild: () => nothing, firstChild: null};
const document = {documentElement: nothing, body: nothing, getElementById: () => nothing};
const SPHINX_HIGHLIGHT_ENABLED = false, _ready = () => null, _ = (text) => text;
"""


@pytest.mark.parametrize(
    ("words", "page"),
    [
        ("fault", "faults"),
        ("mock", "testing"),
        ("stuck", "faults"),
        ("simulate noise", "effects"),
        ("my own node", "testing"),
        ("units", "tutorials/first_step"),
        ("cite", "index"),
    ],
)
def test_the_search_finds_what_readers_look_for(site: Path, words: str, page: str) -> None:
    engine = pytest.importorskip("quickjs").Context()
    for name in ("_static/language_data.js", "_static/searchtools.js", "searchindex.js"):
        engine.eval((BROWSER if "language" in name else "") + (site / name).read_text("utf-8"))
    found = engine.eval(f"""
        globalThis.Stemmer = window.Stemmer;
        JSON.stringify(Search._performSearch(...Search._parseQuery({words!r})).reverse())
    """)
    assert page in [one[0] for one in json.loads(found)][:2]


@pytest.mark.parametrize("page", ["index", "effects", "prediction", "states", "architecture"])
def test_a_page_is_whole_without_a_network(site: Path, browser: Browser, page: str) -> None:
    """Chromium asks for nothing outside and says nothing; equations and pictures are there."""
    context = browser.new_context(viewport={"width": 390, "height": 900}, offline=True)
    opened = context.new_page()
    asked: list[str] = []
    said: list[str] = []
    opened.on("request", lambda request: asked.append(request.url))
    opened.on("console", lambda message: said.append(message.text))
    opened.on("pageerror", lambda error: said.append(str(error)))
    opened.goto((site / f"{page}.html").as_uri(), timeout=120_000)
    assert [url for url in asked if not url.startswith("file:")] == []
    assert said == []
    assert opened.evaluate("document.documentElement.scrollWidth") <= 390
    equations = opened.locator("svg[aria-label]").evaluate_all(
        "all => all.map(one => one.querySelectorAll('path').length * one.clientWidth)"
    )
    diagrams = [frame.locator("path").count() for frame in opened.frames[1:]]
    context.close()
    assert all(equations)
    assert (len(equations) > 20) == (page in ("effects", "prediction"))
    assert all(paths > 10 for paths in diagrams)
    assert len(diagrams) == (page in ("states", "architecture"))


@pytest.mark.parametrize("page", ["index", "node", "states", "api"])
def test_axe_finds_nothing_serious(site: Path, browser: Browser, page: str) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    opened = browser.new_page(viewport={"width": 700, "height": 900})
    opened.goto((site / f"{page}.html").as_uri(), timeout=120_000)
    found = axe.Axe().run(opened).response["violations"]
    opened.close()
    assert [one["id"] for one in found if one["impact"] in ("serious", "critical")] == []
