# SPDX-License-Identifier: Apache-2.0
"""Where a sweep runs: threads of this process, or the workers of a Dask cluster.

Threads do: the solver lets go of the interpreter lock while it runs.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, ThreadPoolExecutor
from contextlib import contextmanager

from stickslip_ros.studies.sweep.grid import SweepError

#: How long to wait for a scheduler to answer, s.
PATIENCE_S = 10.0


@contextmanager
def threads(count: int) -> Iterator[tuple[Executor, int]]:
    """Give an executor of count threads, and count; what waits at the end is dropped."""
    pool = ThreadPoolExecutor(count)
    try:
        yield pool, count
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """Give an executor on the cluster of a Dask scheduler, and how many parts it runs at once.

    Raises SweepError if Dask is not installed, or nobody answers, or the cluster gives up.
    """
    try:
        from dask.distributed import (  # type: ignore[import-not-found, unused-ignore]
            Client,
            KilledWorker,
        )
    except ImportError:
        raise SweepError("--scheduler needs Dask: pip install '.[dask]' in the checkout") from None
    try:
        client = Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise SweepError(f"no scheduler answers at {address}: {error}") from None
    with client:
        workers = sum(client.nthreads().values())
        if not workers:
            raise SweepError(f"the scheduler at {address} has no workers; start some")
        try:
            yield client.get_executor(), workers
        except BrokenPipeError:  # not of the cluster: the reader of our output went away
            raise
        except (KilledWorker, CancelledError, TimeoutError, OSError) as error:
            raise SweepError(
                f"the cluster at {address} gave up ({error!r}); what is in --out FILE.csv is kept: "
                "the same command with --resume goes on"
            ) from None
