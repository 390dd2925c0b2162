# SPDX-License-Identifier: Apache-2.0
"""An emulated controller and the topics show the same axis at once."""

import socket
from collections.abc import Callable
from typing import Any

import pytest
from live import wait_until

from stickslip_ros.ros.client import AxisClient
from stickslip_ros.ros.nodes.axis_host import main


@pytest.mark.long
def test_a_client_and_the_topics_command_one_axis(start_node: Callable[..., Any]) -> None:
    """One of two, which are the channels of the controller."""
    node = start_node(
        "axis_node", axes="[x, 'y']", emulate="anc300", emulate_port=0, frequency=1000.0
    )
    node.wait_for("listens on 127.0.0.1 port")
    port = int(node.output.partition(" port ")[2].split()[0])
    with AxisClient("/y") as axis, socket.create_connection(("127.0.0.1", port), 20.0) as client:
        answers = client.makefile("rb")

        def tell(line: bytes) -> bytes:
            client.sendall(line + b"\r\n")
            said = b""
            while not said.endswith((b"OK\r\n", b"ERROR\r\n")):
                said += answers.readline()
            return said

        client.sendall(b"123456\r\n")
        tell(b"echo off")
        tell(b"setm 2 stp")
        tell(b"setv 2 80")
        tell(b"stepu 2 25")
        tell(b"stepw 2")
        # What the client did is told on the topics,
        wait_until(lambda: axis.steps_done == 25 and axis.state == "stopped")
        wait_until(lambda: axis.position > 1e-7, "a position on joint_states")
        # and the other way round.
        axis.send("amplitude", 120.0)
        assert tell(b"getv 2").startswith(b"voltage = 120.000000 V")
        axis.send("jog", -500.0)
        assert tell(b"stop 2") == b"OK\r\n"
        axis.wait_for_state("stopped")
        assert tell(b"stepu 2 x").endswith(b"ERROR\r\n")
    assert node.terminate() == 0


@pytest.mark.usefixtures("ros_domain")
def test_a_port_that_is_taken_and_an_unknown_controller_are_bad_use(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for word, given in (
            ("emulate_port", ("emulate:=mcs2", f"emulate_port:={port}")),
            ("anc350", ("emulate:=anc350",)),
        ):
            parameters = [part for one in given for part in ("-p", one)]
            assert main(["axis_node", "--ros-args", *parameters]) == 2
            assert word in capfd.readouterr().err
