# SPDX-License-Identifier: Apache-2.0
"""Drives and contacts that random campaigns found, by what was wrong with them."""

from pathlib import Path
from typing import Any

import yaml

#: Parameters by the name of each case, by the test that reads them
FOUND: dict[str, dict[str, dict[str, Any]]] = yaml.safe_load(
    Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
)
