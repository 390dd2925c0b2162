# SPDX-License-Identifier: Apache-2.0
"""How nodes are spun: as a process, with signals and exit codes, or in a thread of a program."""

from __future__ import annotations

import atexit
import contextlib
import gc
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future as Done
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import pairwise
from queue import SimpleQueue
from typing import Protocol, TypeVar

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import (
    Executor,
    ExternalShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.utilities import remove_ros_args, try_shutdown

from stickslip_ros.base.errors import StickslipError, UsageError, ending_signals
from stickslip_ros.physics.parameters import ParameterError
from stickslip_ros.physics.parameters.bounded_files import nodes_in
from stickslip_ros.recordings import BagError

DONE, FAILED, BAD_USE = 0, 1, 2
_ROUND = 0.1  # s, the longest that the executor waits for something to do
_LATE = 50_000_000  # ns by which a timer is late where messages have to wait for it
_WARN_PERIOD = 1.0  # s, between errors in the log
_LONGEST_WORK = 60.0  # s
_POLL = 0.05  # s, between checks whether a signal asks to end while something is prepared

N = TypeVar("N", bound=Node)


class Runnable(Protocol):
    """The interface that `run` needs: a node, or several that belong together."""

    finished: Future  #: done when there is nothing left to do; its exception ends the process
    nodes: Sequence[Node]  #: all nodes to spin

    def close(self) -> None:
        """Finish the work in progress; calling it twice does no harm."""


def run(
    program: str,
    args: Sequence[str] | None,
    make_node: Callable[[], Runnable],
    prepare: Callable[[], None] = lambda: None,
    usage: Callable[[], str] = lambda: "",
    many: bool = False,
) -> int:
    """Run a node until it has finished or a signal asks to end; return the exit code.

    program names it in errors, args is the command line with the program's name (that of the
    process if None). make_node builds a `Runnable`. prepare is called before and may take long; a
    signal ends it at once. usage returns the text of ``--help`` below the first line; many: there
    may be many nodes.
    """
    command_line = list(sys.argv if args is None else args)
    if {"-h", "--help"} & set(command_line[1:]):
        print(f"usage: {program} --ros-args [-p NAME:=VALUE ...] [--params-file FILE]\n{usage()}")
        return DONE
    with _caught_signals() as caught:
        try:
            _check_arguments(command_line)
            _prepare(program, prepare, caught)
            node = _start(command_line, make_node)
        except StickslipError as error:
            try_shutdown()
            return _fail(program, error, BAD_USE)
        return _spin(program, node, _Rounds(node.nodes, many), caught)


@contextlib.contextmanager
def _caught_signals() -> Iterator[list[int]]:
    """Collect signals that ask to end instead of being interrupted by them.

    rclpy would raise KeyboardInterrupt between any two steps of writing a message, and take the
    context away before the last messages are fetched.
    """
    caught: list[int] = []
    old = {
        number: signal.signal(number, lambda n, _: caught.append(n)) for number in ending_signals()
    }
    try:
        yield caught
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)


def parameter_files(command_line: Sequence[str]) -> list[str]:
    """Return the parameter files that a command line names."""
    return [file for flag, file in pairwise(command_line) if flag == "--params-file"]


def _check_arguments(command_line: list[str]) -> None:
    for file in parameter_files(command_line):
        nodes_in(file)  # ROS takes the last of two values, and names no parameter
    try:
        extra = remove_ros_args(command_line)[1:]
    except RuntimeError as error:
        raise UsageError(f"{error}{_cure(str(error))}") from error
    if extra:
        raise UsageError(
            f"unknown argument '{extra[0]}'; give parameters as --ros-args -p NAME:=VALUE"
        )


def _prepare(program: str, prepare: Callable[[], None], caught: list[int]) -> None:
    """Call ``prepare`` in a thread, for a signal is not heard where a compiler works."""
    with ThreadPoolExecutor(1, "prepare") as thread:
        work = thread.submit(prepare)
        while not wait([work], _POLL).done:
            if caught:
                print(f"{program}: ended before it was ready", file=sys.stderr, flush=True)
                os._exit(DONE)  # files of the cache are renamed when they are whole
    work.result()


def _start(command_line: list[str], make_node: Callable[[], Runnable]) -> Runnable:
    try:
        rclpy.init(args=command_line, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # rclpy's own classes for bad arguments are not public
        raise UsageError(f"{error}{_cure(str(error))}") from error
    try:
        return make_node()
    except ValueError as error:
        if isinstance(error, ParameterError):
            raise
        if isinstance(error, StickslipError):
            raise UsageError(str(error)) from error
        raise UsageError(f"a parameter has no value; leave it out: {error}") from error
    except RuntimeError as error:  # of the middleware, such as security that it does not have
        raise UsageError(f"the node cannot be made: {error}{_cure(str(error))}") from error


def _cure(said: str) -> str:
    """Return the cure of an error of the middleware, if known."""
    cures = {
        "parse remap rule": "; write --remap FROM:=TO",
        "parse parameter override rule": "; write -p NAME:=VALUE",
        "log directory": "; set ROS_LOG_DIR to a folder that you may write to",
        "Too many open files": "; close other files or raise the limit (ulimit -n)",
    }
    return next((cure for words, cure in cures.items() if words in said), "")


def _spin(program: str, node: Runnable, rounds: _Rounds, caught: list[int]) -> int:
    # Objects made at the start stay; searching them for garbage would cost deadlines.
    gc.collect()
    gc.freeze()
    try:
        # spin_until_future_complete of rclpy 7 leaves a callback behind with every round.
        node.finished.add_done_callback(lambda _: rounds.wake())
        # Here, not in a timer: behind a flood of messages its turn came after more than a minute.
        with _woken_by_signals(rounds):
            while not (node.finished.done() or caught):
                try:
                    rounds.spin_once()
                except Exception as error:  # from below the callbacks, which are guarded
                    if not node.nodes[0].context.ok():
                        raise
                    node.nodes[0].get_logger().error(
                        f"error of the middleware, going on: {' '.join(str(error).split())}",
                        throttle_duration_sec=_WARN_PERIOD,
                    )
        if node.finished.done():
            node.finished.result()
        node.close()
        return DONE
    except BagError as error:
        return _fail(program, error, FAILED)
    finally:
        with contextlib.suppress(BagError):
            node.close()
        rounds.shutdown()
        for one in node.nodes:
            one.destroy_node()
        try_shutdown()


@contextlib.contextmanager
def _woken_by_signals(rounds: _Rounds) -> Iterator[None]:
    """Have a signal end the wait for something to do, which would last for 0.1 s at rest."""
    read, write = os.pipe()
    os.set_blocking(write, False)
    before = signal.set_wakeup_fd(write)

    def watch() -> None:
        while os.read(read, 1):
            rounds.wake()

    thread = threading.Thread(target=watch, name="signals", daemon=True)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(write)
        thread.join()
        os.close(read)


class _Rounds:
    """Spins nodes, one callback after another; no flood of messages keeps a timer from its turn.

    The executor of events has the least to do for each message: the usual one checks all entities
    of all nodes before it, which with fifty axes takes longer than a period. But its queue has no
    end, holds an event for each message that ever came, and timers wait behind them. So where a
    timer is late, the usual one takes over: it takes one message of each topic and service in turn,
    and the timers between them; what that leaves, the bounded queues of the middleware drop. When
    nothing waits any more, it hands back.
    """

    def __init__(self, nodes: Sequence[Node], many: bool) -> None:
        """Take the nodes; many: there may be so many that the executor of events is needed."""
        self._nodes = nodes
        self._timers = [timer for node in nodes for timer in node.timers]  # made with their nodes
        self._fair = SingleThreadedExecutor()
        self._quick: Executor = self._fair
        with contextlib.suppress(ImportError):  # an rclpy without it
            if many:
                from rclpy.experimental.events_executor import EventsExecutor

                self._quick = EventsExecutor()
        self._had_turn = set[Timer]()  # since the last message
        self._hand_to(self._quick)

    def spin_once(self) -> None:
        """Execute one callback and the timers that are due, or none if there is nothing to do."""
        if self._now is not self._fair:
            self._now.spin_once(_ROUND)  # without a limit, it never returns
            on = [timer for timer in self._timers if not timer.is_canceled()]
            if any(-timer.time_until_next_call() > _LATE for timer in on):
                self._quick.shutdown()  # forgets its events; the messages are still there
                self._hand_to(self._fair)
            return
        with contextlib.suppress(TimeoutException):
            entity: object
            handler, entity, _ = self._fair.wait_for_ready_callbacks(_ROUND)
            handler()
            handler.result()  # raises what it raised
            if not isinstance(entity, Timer):
                self._had_turn.clear()
                for timer in self._timers:
                    if timer.is_ready():
                        timer.handle.call_timer()
                        timer.callback()
            elif entity not in self._had_turn:
                self._had_turn.add(entity)
            elif self._quick is not self._fair:  # between its two turns, nothing waited
                self._hand_to(self._quick)

    def wake(self) -> None:
        """End the present wait."""
        self._now.create_task(lambda: None)  # a wait ends with work, not because it was woken

    def shutdown(self) -> None:
        """Let go of the nodes."""
        for executor in {self._quick, self._fair}:
            executor.shutdown()

    def _hand_to(self, executor: Executor) -> None:
        self._now = executor
        self._had_turn.clear()
        for node in self._nodes:
            executor.add_node(node)


def _fail(program: str, error: Exception, code: int) -> int:
    print(f"{program}: {' '.join(str(error).split())}", file=sys.stderr)
    return code


# -- in a thread


class SpinThread:
    """Spins the given nodes until it is closed; then they are destroyed.

    An exception in a callback is logged and does not end the thread, which all nodes need.
    """

    def __init__(self, name: str = "stickslip_spin", domain_id: int | None = None) -> None:
        """Start; name is that of the thread, domain_id None for that of the environment."""
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain_id)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Node] = []  #: those that are spun
        self._ending = False
        self._work = SimpleQueue[tuple[Callable[[], None], Done[None]]]()
        self._thread = threading.Thread(target=self._spin, name=name, daemon=True)
        self._thread.start()
        # A program that ends without closing would be aborted in the middle of a wait.
        atexit.register(self.close)

    def add(self, node: N) -> N:
        """Spin a node made with :attr:`context` and destroy it at the end; return it."""
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def run(self, work: Callable[[], None]) -> None:
        """Do something between two callbacks, in their thread; return then. Raises what it raises.

        TimeoutError: a callback does not end.
        """
        done: Done[None] = Done()
        self._work.put((work, done))
        self.executor.create_task(lambda: None)  # ends the present wait
        if not wait([done], _LONGEST_WORK).done:
            raise TimeoutError(f"nodes are busy for {_LONGEST_WORK:g} s: a callback does not end")
        done.result()

    def take_what_waits(self, most: float = 5.0) -> int:
        """Execute callbacks until none waits, or for a time (s); return how many. Within `run`."""
        count, deadline = 0, time.monotonic() + most
        with contextlib.suppress(TimeoutException):
            while time.monotonic() < deadline:
                with self._passing_over():
                    count += self._take(0.0)
        return count

    def close(self) -> None:
        """End all of it; twice does no harm."""
        if self._ending:
            return
        self._ending = True
        atexit.unregister(self.close)
        self.executor.create_task(lambda: None)  # a round ends with work, not because it was woken
        self._thread.join()
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()
        self.context.try_shutdown()

    def _spin(self) -> None:
        # Shut down in the middle of `spin`, the executor falls over what it waits for.
        with contextlib.suppress(ExternalShutdownException):
            while not self._ending:
                with self._passing_over():
                    if self._work.empty():
                        with contextlib.suppress(TimeoutException):
                            self._take(1.0)
                        continue
                    work, done = self._work.get()
                    try:
                        done.set_result(work())
                    except BaseException as error:
                        done.set_exception(error)

    def _take(self, timeout: float) -> bool:
        """Execute a callback; return whether it was no task. TimeoutException after a time (s)."""
        entity: object
        # Nodes in the order in which they came: executors keep them in a set, and of what waits at
        # once, tests would see now this first, now that.
        handler, entity, _ = self.executor.wait_for_ready_callbacks(timeout, self.nodes)
        handler()
        handler.result()  # raises what it raised
        return entity is not None

    @contextlib.contextmanager
    def _passing_over(self) -> Iterator[None]:
        """Log what a callback raises: else no node would receive anything, and callers wait."""
        try:
            yield
        except (ExternalShutdownException, TimeoutException):
            raise
        except InvalidHandle:
            pass  # another thread destroyed something that the executor was about to wait for
        except Exception:
            get_logger(self._thread.name).error(
                f"passed over, the thread goes on:\n{traceback.format_exc()}",
                throttle_duration_sec=_WARN_PERIOD,
            )
