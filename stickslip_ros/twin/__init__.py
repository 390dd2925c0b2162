# SPDX-License-Identifier: Apache-2.0
"""A twin: the model beside a real axis, told the same commands, which says what has changed."""

from typing import TYPE_CHECKING

from stickslip_ros.lazy_names import lazy_names

if TYPE_CHECKING:
    from stickslip_ros.twin.settings import TwinSettings
    from stickslip_ros.twin.timeline import Command
    from stickslip_ros.twin.twin import Change, Estimate, Forecast, Twin, Update
else:
    __getattr__ = lazy_names(
        __name__,
        {
            "settings": ["TwinSettings"],
            "timeline": ["Command"],
            "twin": ["Change", "Estimate", "Forecast", "Twin", "Update"],
        },
    )

__all__ = ["Change", "Command", "Estimate", "Forecast", "Twin", "TwinSettings", "Update"]
