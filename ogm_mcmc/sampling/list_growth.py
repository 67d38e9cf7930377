"""Lists in one flat array that grow where they lie, filled by one or two threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ogm_mcmc.arrays import AnyArray
from ogm_mcmc.errors import WindowError

__all__ = ['grown', 'in_turn', 'next_places', 'side_by_side', 'sums']

MOST_PAIRS = 2**31 - 1


def grown(array: AnyArray, size: int) -> AnyArray:
    """Grow an array where it lies, if the allocator can: never twice the memory of a large one."""
    shape = (size, *array.shape[1:])
    if array.size == 0:
        return np.empty(shape, array.dtype)  # not cleared, unlike what `resize` adds
    array.resize(shape, refcheck=False)
    return array


def sums(counts: AnyArray) -> AnyArray:
    """Return where lists of so many entries end, in place of `counts`.

    Raises WindowError for more than an index can hold.
    """
    ends: AnyArray = np.cumsum(counts, out=counts)
    if ends.size and ends[-1] > MOST_PAIRS:
        raise WindowError(f'{ends[-1]} pairs of a ray and a cell: expected at most {MOST_PAIRS}')
    return ends


def next_places(before: AnyArray, where: AnyArray, after: AnyArray) -> AnyArray:
    """Return where the next entry of each list goes, behind those it had: (S,) int32."""
    following = after[:-1].astype(np.int32)
    following[where] += np.diff(before).astype(np.int32)
    return following


def in_turn(first: AnyArray, counts: Sequence[AnyArray]) -> list[AnyArray]:
    """Return where the entries of each part begin in every list, in place of their `counts`."""
    for part in range(len(counts) - 1, -1, -1):
        counts[part][:] = first
        for earlier in counts[:part]:
            counts[part][:] += earlier
    return list(counts)


def side_by_side(work: Callable[..., None], of: Sequence[tuple[Any, ...]]) -> None:
    """Do work of each of these arguments in a thread of its own, the only one in this thread."""
    if len(of) == 1:
        work(*of[0])
        return
    with ThreadPoolExecutor(len(of)) as pool:
        for done in [pool.submit(work, *one) for one in of]:
            done.result()
