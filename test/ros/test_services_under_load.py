# SPDX-License-Identifier: Apache-2.0
"""Many clients call one service at once: all of them are answered."""

from collections.abc import Callable
from typing import Any

import pytest
from live import MakeAxis, Ros
from rcl_interfaces.srv import GetParameters
from std_srvs.srv import Trigger

ROUNDS = 10


@pytest.mark.parametrize(
    ("count", "kind", "service", "request_of"),
    [
        (25, Trigger, "stop", Trigger.Request),
        (25, GetParameters, "get_parameters", lambda: GetParameters.Request(names=["mass"])),
        pytest.param(100, Trigger, "stop", Trigger.Request, marks=pytest.mark.long),
    ],
    ids=["25", "25 for parameters", "100"],
)
def test_all_are_answered(
    ros: Ros,
    make_axis: MakeAxis,
    count: int,
    kind: type[Any],
    service: str,
    request_of: Callable[[], Any],
) -> None:
    """Half of 25 clients waited for ever, for ten requests had room."""
    make_axis()
    nodes = [ros.node(f"caller_{k}") for k in range(5)]
    name = f"/stickslip_axis/{service}"
    clients = [nodes[k % len(nodes)].create_client(kind, name) for k in range(count)]
    ros.wait_until(lambda: all(one.service_is_ready() for one in clients), "the service")
    for number in range(ROUNDS):
        answers = [one.call_async(request_of()) for one in clients]
        ros.wait_until(lambda: all(a.done() for a in answers), f"all, {number}", 20.0)  # noqa: B023
