# SPDX-License-Identifier: Apache-2.0
"""Pages: every text is escaped, what is missing is said, light and dark are legible."""

import re
from pathlib import Path

import jinja2
import pytest

from stickslip_ros.base.reporting import page as pages
from stickslip_ros.base.reporting.page import PageError, page, plot_parts

TEMPLATES = Path(pages.__file__).parent / "templates"


def test_a_missing_part_is_an_error() -> None:
    """Rather than a hole in the page."""
    with pytest.raises(jinja2.UndefinedError):
        page("compare.html")


def test_data_cannot_end_their_script() -> None:
    packed = plot_parts({"a": {"data": [], "layout": {"title": "</script><b>"}}})
    assert "<" not in packed["data"]
    assert "\\u003c/script>" in packed["data"]


def test_without_plotly_the_error_names_the_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    pages.plotly_script.cache_clear()
    monkeypatch.setitem(__import__("sys").modules, "plotly.offline", None)
    with pytest.raises(PageError, match="pip install plotly"):
        plot_parts({})
    pages.plotly_script.cache_clear()


def luminance(colour: str) -> float:
    """Return the relative luminance of #rgb or #rrggbb after WCAG 2.1."""
    digits = colour.lstrip("#")
    digits = "".join(2 * digit for digit in digits) if len(digits) == 3 else digits
    linear = []
    for k in (0, 2, 4):
        part = int(digits[k : k + 2], 16) / 255.0
        linear.append(part / 12.92 if part <= 0.03928 else ((part + 0.055) / 1.055) ** 2.4)
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(first: str, second: str) -> float:
    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_texts_stand_out_as_the_web_accessibility_guidelines_ask(scheme: int) -> None:
    """WCAG 2.1, 1.4.3: 4.5 to 1 for text, on the page and on the badges."""
    style = (TEMPLATES / "base.html").read_text(encoding="utf-8")
    colours = dict(re.findall(r"--([a-z-]+): (#\w+)", style.split(":root {")[1 + scheme]))
    for ink, ground in (
        ("ink", "page"), ("soft", "page"), ("link", "page"), ("good", "page"), ("bad", "page"),
        ("soft", "fill"), ("good", "good-fill"), ("bad", "bad-fill"),
    ):  # fmt: skip
        found = contrast(colours[ink], colours[ground])
        assert found >= 4.5, f"{ink} on {ground}: {found:.2f}"
