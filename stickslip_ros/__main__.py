# SPDX-License-Identifier: Apache-2.0
"""``python -m stickslip_ros`` is the command ``stickslip``."""

import sys

from stickslip_ros.cli.main import main

sys.exit(main())
