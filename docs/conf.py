# SPDX-License-Identifier: Apache-2.0
"""The site: `make site` builds it into docs/_build/site and takes every warning for an error."""

import re
from typing import Any

from stickslip_ros import __version__

project = "stickslip_ros"
author = "The stickslip_ros maintainers"
copyright = author
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinxcontrib.mermaid"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"stickslip_ros {__version__}"
html_copy_source = False

myst_fence_as_directive = ["mermaid"]
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath", "amsmath"]
#: A word in single backquotes is code in our docstrings, as everywhere else.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "exclude-members": "__init__, __new__"}


def _offer_files_beside(app: Any, page: str, source: list[str]) -> None:
    """Turn links to Markdown outside the site, which works on GitHub, into downloads."""
    source[0] = re.sub(r"\]\((\.\./[\w./-]+\.md)\)", r"](path:\1)", source[0])


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("source-read", _offer_files_beside)
