# SPDX-License-Identifier: Apache-2.0
"""A DDS domain that nobody else on this machine uses."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

_DOMAINS = 100  # 1 to 100: those that Fast DDS has ports for on every system

# Fast DDS announces a new participant five times, 100 ms apart, and one that was missed costs
# seconds; more and quicker announcements make the first contact short and even. A writer asks for
# acknowledgement every 3 s, which is what waiting for it would take.
_FAST_DISCOVERY = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
  <participant profile_name="quick" is_default_profile="true"><rtps><builtin><discovery_config>
    <initialAnnouncements><count>20</count><period><nanosec>50000000</nanosec></period>
    </initialAnnouncements>
  </discovery_config></builtin></rtps></participant>
  <data_writer profile_name="asking" is_default_profile="true"><times>
    <heartbeatPeriod><nanosec>20000000</nanosec></heartbeatPeriod>
  </times></data_writer>
</profiles></dds>
"""


@contextmanager
def own_domain(folder: Path, setenv: Callable[[str, str], None]) -> Iterator[int]:
    """Reserve a domain for as long as the block lasts, tell the environment, return its number.

    folder is where logs and the profile of Fast DDS go. The test is skipped where ROS is missing.
    """
    cure = "source a ROS 2 installation, or pip install stickslip_ros[ros]"
    pytest.importorskip("rclpy", reason=f"no rclpy: {cure}")
    coordinator = pytest.importorskip(
        "domain_coordinator", reason=f"no domain_coordinator (of ament_cmake_ros): {cure}"
    )
    start = random.randrange(_DOMAINS)
    attempts = iter(range(_DOMAINS))
    profile = folder / "fast_discovery.xml"
    profile.write_text(_FAST_DISCOVERY, encoding="utf-8")
    with coordinator.domain_id(lambda: (start + next(attempts)) % _DOMAINS + 1) as domain:
        setenv("ROS_DOMAIN_ID", str(domain))
        setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        setenv("ROS_LOG_DIR", str(folder / "ros_log"))
        setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(profile))
        yield int(domain)
