# SPDX-License-Identifier: Apache-2.0
"""The one error of this package."""


class BagError(Exception):
    """A bag cannot be made or written; the text is one line that names the path and the cure."""
