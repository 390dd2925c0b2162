# SPDX-License-Identifier: Apache-2.0
"""Long studies of what the quick tests only sample; `python -m validation.campaigns` runs them."""

import sys
from pathlib import Path

_TESTS = Path(__file__).resolve().parents[2] / "test"
# The integrators that share nothing with the package belong to the tests, and what makes bags.
sys.path[:0] = [str(_TESTS / room) for room in ("", "measurement/identification", "recordings")]
