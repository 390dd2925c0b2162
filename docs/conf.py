# SPDX-License-Identifier: Apache-2.0
"""The site: `make site` builds it into docs/_build/site and takes every warning for an error."""

import re
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import ziamath
from docutils import nodes

from stickslip_ros.version import __version__

project = "stickslip_ros"
author = "The stickslip_ros maintainers"
copyright = author
release = version = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinxcontrib.mermaid",
]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"stickslip_ros {__version__}"
html_copy_source = False
html_static_path = ["_static"]
html_js_files = [("accessible.js", {"defer": "defer"})]

myst_fence_as_directive = ["mermaid"]
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
# The pages are read without a network, too: equations and diagrams become pictures here, so that no
# page asks for a script from elsewhere.
html_math_renderer = "svg"
#: Glyphs are drawn as paths: ids of symbols would occur in every equation of a page again.
ziamath.config.svg2 = False
mermaid_output_format = "svg"
mermaid_cmd = f"'{Path(sys.executable).as_posix()}' -m mermaidx"
#: On white, because a picture cannot know whether the page around it is dark.
mermaid_params = ["--theme", "neutral", "--background", "white"]
#: A word in single backquotes is code in our docstrings, as everywhere else.
default_role = "code"
napoleon_google_docstring = False
napoleon_use_rtype = False  # type and meaning in one line
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "exclude-members": "__init__, __new__"}


#: What readers search for, by the page that answers: the search shows these first.
SOUGHT = {
    "faults": ["fault", "stuck", "mock"],
    "testing": ["mock", "my own node"],
    "effects": ["simulate noise", "noise"],
    "tutorials/first_step": ["units"],
    "compare": ["units of a file"],
    "index": ["cite"],
}


def _prepare(app: Any, page: str, source: list[str]) -> None:
    """Turn links to Markdown outside the site, which works on GitHub, into downloads; add words."""
    source[0] += "".join(f"\n```{{index}} ! {word}\n```\n" for word in SOUGHT.get(page, []))
    source[0] = re.sub(r"\]\((\.\./[\w./-]+\.md)(?:#[\w-]+)?\)", r"](path:\1)", source[0])


def _drawn(node: nodes.math | nodes.math_block, inline: bool) -> str:
    """Return an equation as SVG in the colour of the text around it; its LaTeX is read aloud."""
    equation = ziamath.Latex(node.astext(), size=17, color="currentColor", inline=inline)
    svg = equation.svgxml()
    svg.set("role", "img")
    svg.set("aria-label", node.astext())
    if inline:
        svg.set("style", f"vertical-align: {equation.getyofst():.1f}px")
    return ElementTree.tostring(svg, encoding="unicode")


def _inline_equation(page: Any, node: nodes.math) -> None:
    """Write an equation within a line."""
    page.body.append(_drawn(node, inline=True))
    raise nodes.SkipNode


def _displayed_equation(page: Any, node: nodes.math_block) -> None:
    """Write an equation that stands alone; on a narrow screen it scrolls by itself."""
    style = "overflow-x: auto; text-align: center"
    page.body.append(f'<div class="math" style="{style}">{_drawn(node, inline=False)}</div>')
    raise nodes.SkipNode


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("source-read", _prepare)
    app.add_html_math_renderer("svg", (_inline_equation, None), (_displayed_equation, None))
