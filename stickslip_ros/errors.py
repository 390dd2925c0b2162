# SPDX-License-Identifier: Apache-2.0
"""The base of every error that this package raises on purpose."""

from __future__ import annotations


class StickslipError(Exception):
    """Something that the caller can put right; the text is one line with the cure."""


#: Exit code after Ctrl-C, as of any program that a signal has ended: 128 and the signal
INTERRUPTED = 130
#: What is said where memory is short
OUT_OF_MEMORY = (
    "out of memory; ask for less at once, close other programs or raise the limit (ulimit -v)"
)
