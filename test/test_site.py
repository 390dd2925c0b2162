# SPDX-License-Identifier: Apache-2.0
"""The site: built without a warning, no dead link within it, every public name on its page."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import stickslip_ros as ss

ROOT = Path(__file__).parent.parent
#: Public names that the page only mentions: data, and what needs ROS.
MENTIONED = {"PARAMETERS", "AxisClient", "AxisFault"}


def test_every_public_name_is_on_the_page() -> None:
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\.\. auto\w+:: stickslip_ros\.(\w+)$", text, re.MULTILINE)
    assert sorted(listed) == sorted(set(ss.__all__) - MENTIONED)
    assert [name for name in MENTIONED if f"`{name}`" not in text] == []


class Links(HTMLParser):
    """The targets of the links of a page, and the places in it that links may lead to."""

    def __init__(self, text: str) -> None:
        """Read a page."""
        super().__init__()
        self.targets: list[str] = []
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take a tag."""
        for name, value in attrs:
            if name == "id" and value:
                self.places.add(value)
            if name in ("href", "src") and value:
                self.targets.append(value)


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


def test_a_dead_link_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        "<a id='x' href='b.html'></a><a href='a.html#x'></a><a href='#y'></a>", encoding="utf-8"
    )
    assert list(dead_links(tmp_path)) == ["a.html: b.html", "a.html: #y"]


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_has_no_dead_link(tmp_path: Path) -> None:
    site = tmp_path / "site"
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    run = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html",
         "-d", str(tmp_path / "trees"), str(ROOT / "docs"), str(site)],
        capture_output=True, text=True, check=False, timeout=300,
        env={**os.environ, "PYTHONPATH": paths},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert list(dead_links(site)) == []
    # Equations are rendered, each with the number that it has in the paper.
    physics = (site / "friction.html").read_text(encoding="utf-8")
    assert physics.count('class="math') > 20
    assert "$" not in re.sub(r"<script.*?</script>|<[^>]*>", "", physics, flags=re.DOTALL)
    places = Links((site / "api.html").read_text(encoding="utf-8")).places
    # A class that stands elsewhere is found under the name of its own module.
    found = {place.rpartition(".")[2] for place in places}
    assert sorted(set(ss.__all__) - MENTIONED - found) == []
