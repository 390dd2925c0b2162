# SPDX-License-Identifier: Apache-2.0
"""A twin: the model beside a real axis, told the same commands, which says what has changed."""

from stickslip_ros.twin.settings import TwinSettings
from stickslip_ros.twin.timeline import Command
from stickslip_ros.twin.twin import Change, Estimate, Forecast, Twin, Update

__all__ = ["Change", "Command", "Estimate", "Forecast", "Twin", "TwinSettings", "Update"]
