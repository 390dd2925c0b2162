# SPDX-License-Identifier: Apache-2.0
"""What the machine may do to the nodes: no shared memory, no network, a clock that is set, no time.

Each is a real one, in a namespace of its own where it would concern others.
"""

import contextlib
import os
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest
from child import in_namespace
from live import Process, Ros, Start

from stickslip_ros.recordings import open_bag, resimulate
from stickslip_ros.ros.client import AxisClient
from validation.campaigns.processes import FAKETIME, with_clock_of

#: Time (s) for a node to start where seven others compute on each core: it took more than 60.
STARTING = 200.0

#: For a shell: runs a program given to Python.
RUN = 'exec "$0" -c "$1"'
#: Commands an axis in a process of its own; MEANWHILE is done in the middle of it.
DIALOGUE = """
import subprocess, sys, time
from stickslip_ros.ros.client import AxisClient
axis = subprocess.Popen(
    [sys.executable, "-m", "stickslip_ros.executables", "axis_node", "--ros-args",
     "-p", "frequency:=1000.0"]
)
with AxisClient(timeout=60.0) as client:
    assert client.send("steps", 20).wait().steps_done == 20
    MEANWHILE
    assert client.send("steps", -20).wait().steps_done == -20
axis.terminate()
assert axis.wait(60.0) == 0
print("all is well")
"""


@pytest.mark.long
@pytest.mark.usefixtures("ros_domain")
def test_full_shared_memory_is_done_without(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fast DDS moves its messages there; where there is no room, they go by UDP."""
    monkeypatch.delenv("FASTDDS_BUILTIN_TRANSPORTS")
    mount = "mount -t tmpfs -o size=64k tmpfs /dev/shm"
    done = in_namespace("mount", mount, RUN, sys.executable, DIALOGUE.replace("MEANWHILE", "pass"))
    assert done.stdout.endswith("all is well\n"), done.stdout + done.stderr


@pytest.mark.long
@pytest.mark.usefixtures("ros_domain")
def test_a_network_that_is_gone_for_a_while_is_outlived() -> None:
    """With UDP alone, as all tests: shared memory would go on without the network."""
    if not shutil.which("ip"):
        pytest.skip("the command ip is not installed")
    gone = "; ".join(
        (
            "subprocess.run(['ip', 'link', 'set', 'lo', 'down'], check=True)",
            "stamp = client.stamp",
            "time.sleep(3.0)",
            "subprocess.run(['ip', 'link', 'set', 'lo', 'up'], check=True)",
        )
    )
    done = in_namespace(
        "net", "ip link set lo up", RUN, sys.executable, DIALOGUE.replace("MEANWHILE", gone)
    )
    assert done.stdout.endswith("all is well\n"), done.stdout + done.stderr


@contextlib.contextmanager
def starved(*processes: Process) -> Iterator[None]:
    """Put processes on one core, behind four others that compute there all the time."""
    core = min(os.sched_getaffinity(0))
    loop = f"import os, time; os.sched_setaffinity(0, [{core}]); end = time.monotonic() + 120\n"
    loop += "while time.monotonic() < end: pass"
    others = [subprocess.Popen([sys.executable, "-c", loop]) for _ in range(4)]
    try:
        for process in processes:
            for thread in Path(f"/proc/{process.pid}/task").iterdir():
                with contextlib.suppress(ProcessLookupError):
                    os.sched_setaffinity(int(thread.name), [core])
                    os.setpriority(os.PRIO_PROCESS, int(thread.name), 5)
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


@pytest.mark.long
def test_without_processor_time_it_is_late_and_loses_nothing_in_silence(
    ros: Ros, start_node: Start, tmp_path: Path
) -> None:
    """What is missing in the bag is what the recorder says, and the run comes out again."""
    recorder = start_node("recorder_node", output="run")
    recorder.wait_for("recording all topics", STARTING)
    axis = start_node("axis_node", frequency=1000.0)
    recorder.wait_for("first message of /joint_states", STARTING)
    with AxisClient(node=ros.node("user"), timeout=60.0, listeners=2) as client:
        with starved(axis, recorder):
            for direction in (1, -1, 1, -1):
                steps = direction * 200
                assert client.send("steps", steps).wait().steps_done == steps
        missed = client.report()["timing"]["missed deadlines"]
    assert axis.terminate() == 0
    assert recorder.terminate() == 0
    numbers = defaultdict(list)
    with open_bag(tmp_path / "run") as bag:
        for message in bag.messages():
            if message.topic in ("/joint_states", "/stickslip_axis/contact"):  # of one publisher
                numbers[message.topic].append(message.sequence)
        (again,) = resimulate(bag)
        told = int(bag.metadata.custom_data["lost_messages"])
    missing = {topic: found[-1] - found[0] + 1 - len(found) for topic, found in numbers.items()}
    print(f"{missed} deadlines missed; missing {missing}, said to be lost {told}")
    assert sum(missing.values()) <= told
    assert len(numbers["/joint_states"]) > 50
    assert again.bit_for_bit, again.as_json()


@pytest.mark.long
@pytest.mark.skipif(FAKETIME is None, reason="libfaketime is not installed")
def test_a_bag_stays_in_order_though_the_clock_is_set(
    ros: Ros, start_node: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a day, on and back, in the middle of the recording; the steady clock goes on.

    The run could not be computed again: what came before seemed to come after.
    """
    clock = tmp_path / "clock"
    clock.write_text("+0d\n")
    with monkeypatch.context() as patch:
        for name, value in with_clock_of(clock).items():
            patch.setenv(name, value)
        recorder = start_node("recorder_node", output="run")
        axis = start_node("axis_node", frequency=1000.0)
    recorder.wait_for("first message of /joint_states")
    client = AxisClient(node=ros.node("user"), listeners=2)
    for number, jump in enumerate(("+1d", "-1d", "+0d"), 1):
        clock.write_text(f"{jump}\n")
        said = "the clock of the machine was set by"
        ros.wait_until(lambda: recorder.output.count(said) >= number, jump)  # noqa: B023
        assert client.send("steps", 20).wait().steps_done == 20
    assert axis.terminate() == 0
    assert recorder.terminate() == 0
    last: dict[str, int] = {}
    with open_bag(tmp_path / "run") as bag:
        assert bag.end_ns - bag.start_ns < 3600 * 10**9
        assert abs(bag.start_ns - time.time_ns()) < 3600 * 10**9
        for message in bag.messages():
            if message.topic.endswith(("states", "events", "steps")):  # of one publisher each
                assert message.sequence > last.get(message.topic, 0)
                last[message.topic] = message.sequence
    assert last.keys() >= {"/joint_states", "/stickslip_axis/command/steps"}
