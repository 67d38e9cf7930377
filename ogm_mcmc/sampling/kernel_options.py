"""How kernels of the sampler are compiled; why: `ogm_mcmc.sampling.gibbs_kernels`."""

from __future__ import annotations

from typing import Any

import numba

__all__ = ['inlined', 'kernel']

# As a plain call: the types that come with Numba leave out `no_cfunc_wrapper`.
_njit: Any = numba.njit

kernel: Any = _njit(cache=True, nogil=True, no_cfunc_wrapper=True)
"""Decorate a function that Numba compiles once, cached, without the wrapper for C callbacks."""

inlined: Any = _njit(cache=True, nogil=True, no_cfunc_wrapper=True, forceinline=True)
"""Decorate one that LLVM puts into every kernel that calls it, in place of the call."""
