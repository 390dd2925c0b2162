# SPDX-License-Identifier: Apache-2.0
"""SECURITY.md promises nothing untested: the tests it names are there, and each row has one."""

import re
from pathlib import Path

TESTS = Path(__file__).parent
#: Those that are campaigns stand beside the studies.
PLACES = (TESTS, TESTS.parent / "validation")
PAGE = (TESTS.parent / "SECURITY.md").read_text(encoding="utf-8")


def test_every_test_that_is_named_is_there() -> None:
    named = re.findall(r"`([\w/]*test_\w+\.py)(?:::(\w+))?`", PAGE)
    assert len(named) > 30
    for file, test in named:
        (found,) = (one for one in PLACES if (one / file).is_file())
        text = (found / file).read_text(encoding="utf-8")
        assert f"def {test}(" in text or not test, (file, test)


def test_every_row_but_of_what_is_trusted_names_a_test() -> None:
    rows = [line for line in PAGE.splitlines() if line.startswith("| ") and "---" not in line]
    heads = ("| input |", "| a peer cannot |", "| fault |")
    for row in rows:
        trusted = row.split("|")[2].strip() == "yes"
        assert ".py::test_" in row or trusted or row.startswith(heads), row
