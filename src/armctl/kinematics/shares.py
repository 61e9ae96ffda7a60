"""Large batches, shared out among the processor's cores.

numpy lets other threads run while it works through an array, so a batch that is cut into shares takes all
cores. Small batches stay in the caller's thread: starting threads costs more than they save.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

SHARE = 16_384
"""rows in a share: a millisecond's work, a hundred times what a thread costs"""


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share_out(count: int, work: Callable[[int, int], None]) -> None:
    """Call ``work(start, stop)`` until all of ``count`` rows are done; several calls may run at once.

    Raises:
        Exception: what ``work`` raised, of the first rows that it failed on.
    """
    starts = range(0, count, SHARE)
    workers = min(cores(), len(starts))
    if workers < 2:
        work(0, count)
        return
    with ThreadPoolExecutor(workers) as pool:
        shares = [pool.submit(work, start, min(start + SHARE, count)) for start in starts]
        for share in shares:
            share.result()
