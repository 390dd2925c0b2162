# SPDX-License-Identifier: Apache-2.0
"""The report as one page of HTML that needs nothing beside itself."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from string import Template

from stickslip_ros.paper.errata import ERRATA
from stickslip_ros.paper.item import Check, Item, Result, Verdict

_CITATION = (
    "C. Edeler, I. Meyer, S. Fatikow, Modeling of stick-slip micro-drives, J. Micro-Nano "
    "Mechatronics 6 (2011), doi 10.1007/s12213-011-0034-9"
)
#: Classes of the style sheet.
_CLASS = {
    Verdict.AGREES: "agrees",
    Verdict.IN_KIND: "kind",
    Verdict.DISAGREES: "disagrees",
    Verdict.UNTOLD: "untold",
}
FAILED = "could not be computed"


@dataclass(frozen=True)
class Entry:
    """An item with what came of it; a failed one has a fault and nothing else."""

    item: Item
    result: Result | None = None
    picture: bytes | None = None  #: PNG
    files: tuple[str, ...] = ()  #: names beside the page
    fault: str = ""

    @property
    def verdict(self) -> str:
        """The verdict as text."""
        return self.result.verdict.value if self.result else FAILED


def page(entries: Sequence[Entry], version: str) -> str:
    """Return the whole page."""
    return _PAGE.substitute(
        version=escape(version),
        citation=escape(_CITATION),
        counts=_counts(entries),
        overview="\n".join(_overview_row(entry) for entry in entries),
        sections="\n".join(_section(entry) for entry in entries),
        errata="\n".join(_row(_ERRATA_NAMES, map(_marked_up, row)) for row in ERRATA),
    )


_ERRATA_NAMES = ("where", "printed", "used here", "why")
_CHECK_NAMES = ("what", "paper", "ours", "bounds", "holds")


def _marked_up(text: str) -> str:
    """Return the HTML of a text with `code` and [links](to pages that are not here)."""
    plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", text)
    return re.sub("`([^`]*)`", r"<code>\1</code>", escape(plain))


def _counts(entries: Sequence[Entry]) -> str:
    found = [entry.verdict for entry in entries]
    order = [*(verdict.value for verdict in Verdict), FAILED]
    return ", ".join(f"{found.count(name)} {name}" for name in order if name in found)


def _badge(entry: Entry) -> str:
    style = _CLASS[entry.result.verdict] if entry.result else "failed"
    return f'<span class="badge {style}">{escape(entry.verdict)}</span>'


def _overview_row(entry: Entry) -> str:
    item = entry.item
    link = f'<a href="#{item.name}">{escape(item.title)}</a>'
    return _row(("place", "what", "verdict"), (escape(item.place), link, _badge(entry)))


def _section(entry: Entry) -> str:
    item, result = entry.item, entry.result
    parts = [
        f'<section id="{item.name}">',
        f"<h2>{escape(item.title)} {_badge(entry)}</h2>",
        f'<p class="place">{escape(item.place)}</p>',
        f"<p><b>The paper:</b> {escape(item.statement)}</p>",
        f"<p><b>Simulated:</b> {escape(item.setup)}</p>",
    ]
    if entry.fault:
        parts.append(f'<p class="fault"><b>{FAILED}:</b> {escape(entry.fault)}</p>')
    if entry.picture is not None:
        data = base64.b64encode(entry.picture).decode("ascii")
        parts.append(
            f'<img alt="{escape(item.title)}, as simulated" src="data:image/png;base64,{data}">'
        )
    if result:
        if result.checks:
            parts.append(_checks(result.checks))
        if result.remark:
            parts.append(f"<p>{escape(result.remark)}</p>")
    if entry.files:
        names = ", ".join(f"<code>{escape(name)}</code>" for name in entry.files)
        parts.append(f'<p class="files">Files: {names}</p>')
    parts.append("</section>")
    return "\n".join(parts)


def _checks(checks: Sequence[Check]) -> str:
    rows = "\n".join(_check_row(check) for check in checks)
    head = f'<table class="checks"><thead>{_head(_CHECK_NAMES)}</thead>'
    return f"{head}<tbody>\n{rows}\n</tbody></table>"


def _check_row(check: Check) -> str:
    ours = f"{check.ours:.4g} {check.unit}".strip()
    holds = ("yes" if check.holds else "no") if check.judged else "ours alone"
    mark = {"yes": ' class="yes"', "no": ' class="no"'}.get(holds, ' class="alone"')
    texts = (check.what, check.paper, ours, check.bounds, holds)
    return _row(_CHECK_NAMES, map(escape, texts), mark)


def _head(names: Sequence[str]) -> str:
    return "<tr>" + "".join(f"<th>{escape(name)}</th>" for name in names) + "</tr>"


def _row(names: Sequence[str], cells: object, mark: str = "") -> str:
    """Return a row; the names show in front of the cells where the window is narrow."""
    texts = [
        f'<td data-name="{escape(name)}">{cell}</td>'
        for name, cell in zip(names, cells, strict=True)  # type: ignore[call-overload]
    ]
    return f"<tr{mark}>{''.join(texts)}</tr>"


_PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>The paper, simulated</title>
<style>
:root { color-scheme: light; --line: #d5d9de; --soft: #f5f6f8; --text: #1c2126; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 60rem; padding: 1.2rem; color: var(--text); background: #fff;
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: .4rem 0; }
h2 { font-size: 1.2rem; line-height: 1.3; margin: 0 0 .2rem; }
section { border-top: 1px solid var(--line); padding: 1.4rem 0 .6rem; }
p { margin: .5rem 0; overflow-wrap: anywhere; }
.place, .files { color: #5b646d; font-size: .9rem; }
img { display: block; width: 100%; max-width: 44rem; height: auto; margin: .8rem auto; }
table { border-collapse: collapse; width: 100%; margin: .8rem 0; font-size: .88rem; }
th, td { text-align: left; vertical-align: top; padding: .3rem .6rem .3rem 0;
  border-bottom: 1px solid var(--line); overflow-wrap: anywhere; }
.checks td:nth-child(n+3) { white-space: nowrap; }
th { color: #5b646d; font-weight: 600; }
tr.yes td:last-child { color: #1b6e3c; font-weight: 600; }
tr.no td:last-child { color: #a3271d; font-weight: 600; }
tr.alone td { color: #5b646d; }
.badge { display: inline-block; padding: .05rem .55rem; border-radius: 1rem; font-size: .8rem;
  font-weight: 600; white-space: nowrap; border: 1px solid; vertical-align: .1em; }
.agrees { color: #145c31; background: #e2f4e8; }
.kind { color: #1f4e9c; background: #e6eefb; }
.disagrees { color: #96261d; background: #fdebe8; }
.untold { color: #5b5b5b; background: #f0f0f0; }
.failed { color: #fff; background: #96261d; }
.fault { color: #96261d; }
code { font-size: .85em; background: var(--soft); padding: .05rem .25rem; }
ul { padding-left: 1.2rem; margin: .4rem 0; }
a { color: #1f4e9c; }
@media (max-width: 640px) {
  body { padding: .8rem; }
  thead { display: none; }
  table, tbody, tr, td { display: block; }
  tr { border-bottom: 1px solid var(--line); padding: .4rem 0; }
  td { border: 0; padding: .05rem 0; }
  td:empty { display: none; }
  td::before { content: attr(data-name) ": "; color: #5b646d; }
  td:first-child { font-weight: 600; }
  td:first-child::before { content: none; }
}
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; }
  a { color: inherit; text-decoration: none; }
  h2, .place { break-after: avoid; }
  img, tr { break-inside: avoid; }
  img { max-width: 15cm; }
  .badge { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
</style>
</head>
<body>
<h1>The paper, simulated</h1>
<p>$citation. Every figure, table and finding that a simulation can be put beside: what the paper
says, in other words; what stickslip_ros $version computes; and a verdict that follows from the
numbers by the rule below.</p>
<p><b>$counts.</b></p>
<table><thead><tr><th>place</th><th>what</th><th>verdict</th></tr></thead><tbody>
$overview
</tbody></table>
<h2>How a verdict comes about</h2>
<p>Each row of an item's table has a number of ours and bounds that it has to keep, set before the
run. It stands for a trend in words (such as larger than) or for a number that the paper prints.
Rows that are ours alone are for the reader and never count.</p>
<ul>
<li><b>agrees</b>: all trends hold, and the printed numbers are all met</li>
<li><b>agrees in kind</b>: all trends hold, but there is no printed number, or some are off</li>
<li><b>disagrees</b>: a trend is missed, or no printed number is met</li>
<li><b>cannot be told</b>: the paper gives nothing that can be compared</li>
</ul>
$sections
<section id="errata">
<h2>Mistakes in the paper, and what is used here</h2>
<table><thead><tr><th>where</th><th>printed</th><th>used here</th><th>why</th></tr></thead><tbody>
$errata
</tbody></table>
</section>
</body>
</html>
""")
