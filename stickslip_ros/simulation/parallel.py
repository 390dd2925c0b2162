# SPDX-License-Identifier: Apache-2.0
"""Work on many things by any executor of `concurrent.futures`: threads here, or a Dask cluster.

The solver lets go of the interpreter lock while it runs, so threads of one process suffice on one
machine. The executor of a cluster is ``client.get_executor()`` of ``dask.distributed``; its
scheduler runs again elsewhere what a worker that died had not finished.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from stickslip_ros.base.errors import StickslipError, libraries_for

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")
#: Items that wait for each worker, so that none runs dry while results are taken
_AHEAD = 3
#: s to wait for the scheduler of a cluster
_PATIENCE = 10.0


class ClusterError(StickslipError, ValueError):
    """There is no such cluster; the message names the cure."""


@contextmanager
def threads(count: int | None = None) -> Iterator[Executor]:
    """Give an executor of threads, one for each processor; waiting work is cancelled at the end."""
    pool = ThreadPoolExecutor(count or os.cpu_count() or 1)
    try:
        yield pool
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # Ctrl-C waits for nothing under way


@contextmanager
def cluster(address: str, count: int | None = None) -> Iterator[Executor]:
    """Give the executor of a Dask cluster: "local", with count processes, or a scheduler's address.

    Raises ClusterError.
    """
    with libraries_for("--cluster"):
        from distributed import Client, LocalCluster
    try:
        if address == "local":
            count = count or os.cpu_count() or 1
            workers = LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None)
            client = Client(workers, timeout=_PATIENCE)
        else:
            workers, client = None, Client(address, timeout=_PATIENCE)
    except (OSError, ValueError, TypeError) as error:
        raise ClusterError(
            f"no cluster answers at {address!r} ({error}): give local, or the address of a "
            "running dask scheduler, such as tcp://HOST:8786"
        ) from None
    try:
        yield client.get_executor()
    finally:
        client.close()
        if workers:
            workers.close()


def workers_of(executor: Executor) -> int:
    """Return how many items an executor works on at once, as far as it says so."""
    client: Any = getattr(executor, "_client", None)  # of Dask
    found = sum(client.nthreads().values()) if client else getattr(executor, "_max_workers", 0)
    return found or os.cpu_count() or 1


def in_order(
    executor: Executor, work: Callable[[_Item], _Result], items: Iterable[_Item]
) -> Iterator[_Result]:
    """Yield the result of each item, in their order.

    Only a few items are submitted ahead; those that have not begun are cancelled when the caller
    stops early.
    """
    left, most = iter(items), _AHEAD * workers_of(executor)
    waiting: deque[Future[_Result]] = deque()
    try:
        while True:
            while len(waiting) < most:
                try:
                    waiting.append(executor.submit(work, next(left)))
                except StopIteration:
                    break
            if not waiting:
                return
            found = waiting[0].result()
            waiting.popleft()
            yield found
    finally:
        for future in waiting:
            future.cancel()
