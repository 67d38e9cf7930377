"""Arrays inside of kernels without a count of their references.

Numba counts the references of every array that is handed to an inner function, and takes it back
unless it sees that the two cancel out, which it does not in large functions. In a sweep that took
longer than looking at the rays (25 instead of 10 ms on the scene of `bench`). A count of an array
whose owner is known to be none is dropped, in everything that is inlined there, too.
"""

from __future__ import annotations

from typing import Any

import numba
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ['borrowed']


def _itself(array: Any) -> Any:
    return array


@intrinsic
def _uncounted(_typing: Any, array: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        view = context.make_array(array)(context, builder, values[0])
        null: Any = cgutils.get_null_value
        view.meminfo, view.parent = null(view.meminfo.type), null(view.parent.type)
        return view._getvalue()

    return array(array), generate


borrowed: Any = _itself if getattr(numba.config, 'DISABLE_JIT', False) else _uncounted
"""Return the same array, uncounted: for use inside of the kernel that holds the counted one."""
