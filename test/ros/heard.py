# SPDX-License-Identifier: Apache-2.0
"""All that an axis says, heard by somebody who does not use our client."""

from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus


def stamp(message: Any) -> int:
    """Return the stamp of a message, ns."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def values(status: DiagnosticStatus) -> dict[str, str]:
    """Return the values of a status by key."""
    return {pair.key: pair.value for pair in status.values}
