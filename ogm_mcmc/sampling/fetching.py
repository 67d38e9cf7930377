"""Asking for memory ahead of its use, from inside of kernels."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numba
from numba.core import cgutils, types
from numba.extending import intrinsic

__all__ = ['fetch_soon']

# As a plain import: neither brings types.
_ir: Any = import_module('llvmlite.ir')
_llvm: Any = cgutils


def _nothing(_array: Any, _row: Any) -> None:
    """Ask for nothing: what is not compiled does not wait for memory, either."""


@intrinsic
def _fetch(_typing: Any, array: Any, row: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        view = context.make_array(array)(context, builder, values[0])
        stride = _llvm.unpack_tuple(builder, view.strides, array.ndim)[0]
        number = context.cast(builder, values[1], signature.args[1], types.intp)
        bits, flag = _ir.IntType(8).as_pointer(), _ir.IntType(32)
        begin = builder.bitcast(view.data, bits)
        address = builder.gep(begin, [builder.mul(number, stride)])
        kind = _ir.FunctionType(_ir.VoidType(), [bits, flag, flag, flag])
        prefetch = _llvm.get_or_insert_function(builder.module, kind, 'llvm.prefetch.p0')
        # To be read, to be kept in all caches, data.
        builder.call(prefetch, [address, flag(0), flag(3), flag(1)])
        return context.get_dummy_value()

    return types.none(array, row), generate


fetch_soon: Any = _nothing if getattr(numba.config, 'DISABLE_JIT', False) else _fetch
"""Ask for the line of the cache where a row of an array begins, and go on without waiting.

The row need not be one of the array.
"""
