# SPDX-License-Identifier: Apache-2.0
"""Thousands of broken bags: each is read, or refused in one line; no crash, no hang, no gigabytes.

``STICKSLIP_MUTATIONS=5000`` in the environment tries that many instead of a few.
"""

import json
import os
from pathlib import Path

import pytest
from child import python

from . import mutations


@pytest.mark.long
def test_mutated_bags_do_no_harm(tmp_path: Path) -> None:
    count = int(os.environ.get("STICKSLIP_MUTATIONS", "300"))
    child = python(mutations.__file__, str(tmp_path), "0", str(count))
    assert child.returncode == 0, child.stderr
    found = json.loads(child.stdout)
    print(found)
    assert found["failures"] == []
    assert found["memory (MB)"] < mutations.MEMORY / 1e6
    assert found["read"] + found["refused"] == count
    assert found["recovered"] + found["lost"] == count
    # The mutations are of the right strength: some do harm, some do not.
    assert min(found["read"], found["refused"], found["recovered"]) > count / 20
