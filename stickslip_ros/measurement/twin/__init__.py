# SPDX-License-Identifier: Apache-2.0
"""A twin: the model beside a real axis, given the same commands, which says what has changed."""

from typing import TYPE_CHECKING

from stickslip_ros.base.lazy_names import lazy_names

_PLACES = {
    "settings": "TwinSettings",
    "timeline": "TwinCommand",
    "twin": "Change Forecast TrackedParameter Twin Update",
}

if TYPE_CHECKING:
    from stickslip_ros.measurement.twin.settings import TwinSettings
    from stickslip_ros.measurement.twin.timeline import TwinCommand
    from stickslip_ros.measurement.twin.twin import Change, Forecast, TrackedParameter, Twin, Update
else:
    __getattr__ = lazy_names(__name__, _PLACES)

__all__ = [
    "Change",
    "Forecast",
    "TrackedParameter",
    "Twin",
    "TwinCommand",
    "TwinSettings",
    "Update",
]
