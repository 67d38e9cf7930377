"""Numba's caches before a test run: stale ones go, the large kernels are compiled once.

`python test/support/kernel_caches.py` does it before `make test` starts its workers: several
processes that find no cache would each compile the same kernels, and none waits for another.
Two processes share the work here, as methods and the sampler have few kernels in common. Where
the caches are warm it takes seconds. What is not named here is compiled by the first test that
needs it.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

__all__ = ['compile_kernels', 'forget_stale_kernels', 'main']

PACKAGE = Path(__file__).resolve().parents[2] / 'ogm_mcmc'


IMPORTED = re.compile(rb'^ *from ([a-z_]+(?:\.\w+)*_kernels) import ', re.MULTILINE)

# Beside the caches of the package: of each module of kernels, the sum over all that it calls.
RECORD = '__pycache__/kernel_sources.json'


def forget_stale_kernels(package: Path = PACKAGE) -> None:
    """Delete the caches of kernels that call others edited since: Numba does not notice those.

    An edit in the kernel's own module Numba notices by itself. What was there at the last call is
    told by the content of the sources; at the first call the younger of cache and source is right.
    """
    record = package / RECORD
    before = json.loads(record.read_text()) if record.exists() else {}
    modules = {
        '.'.join(path.relative_to(package.parent).with_suffix('').parts): path
        for path in package.rglob('*_kernels.py')
    }
    called = {name: _with_called(name, modules) for name in modules}
    sums = {
        name: hashlib.sha256(b''.join(modules[one].read_bytes() for one in found)).hexdigest()
        for name, found in called.items()
    }
    for cache in package.rglob('*.nb[ic]'):
        folder = cache.parents[1].relative_to(package.parent)
        name = '.'.join((*folder.parts, cache.name.partition('.')[0]))
        if name in before:
            stale = before[name] != sums.get(name)
        else:
            edited = [modules[one].stat().st_mtime for one in called.get(name, ())]
            stale = cache.stat().st_mtime < max(edited, default=math.inf)
        if stale:
            cache.unlink()
    record.parent.mkdir(exist_ok=True)
    record.write_text(json.dumps(sums))


def _with_called(name: str, modules: Mapping[str, Path]) -> list[str]:
    """Return a module and all modules of kernels that it imports, directly or not."""
    found = [name]
    for one in found:
        imported = [text.decode() for text in IMPORTED.findall(modules[one].read_bytes())]
        found += [other for other in imported if other in modules and other not in found]
    return found


def compile_methods() -> None:
    """Compile what the mapping methods need."""
    from ogm_mcmc.config import MapperConfig
    from ogm_mcmc.engine.live_map import warm_up_mapping
    from ogm_mcmc.mapping import METHODS

    for method in METHODS:
        warm_up_mapping(MapperConfig(method=method))
    for method in ('two_assumption', 'pose_uncertain', 'counting'):
        warm_up_mapping(MapperConfig(method=method, fusion='per_beam'))


def compile_sampler() -> None:
    """Compile what samples maps and poses, of independent cells and of patches."""
    from ogm_mcmc.config import SamplerConfig
    from ogm_mcmc.config.nodes import RefineSamplerConfig
    from ogm_mcmc.engine.warm_up import warm_up_poses, warm_up_sampling

    for config in (RefineSamplerConfig(), SamplerConfig()):
        warm_up_sampling(config)
    warm_up_sampling(replace(RefineSamplerConfig(), model=replace(config.model, kind='gaussian')))
    warm_up_poses()


PARTS: dict[str, Callable[[], None]] = {'methods': compile_methods, 'sampler': compile_sampler}


def compile_kernels() -> int:
    """Compile all parts at the same time; return how many of them failed."""
    running = [subprocess.Popen([sys.executable, __file__, part]) for part in PARTS]
    return sum(process.wait() != 0 for process in running)


def main(arguments: list[str]) -> int:
    """Do the named part, or forget what is stale and do all."""
    if arguments:
        from ogm_mcmc.engine.compiling import uncollected

        with uncollected():
            PARTS[arguments[0]]()
        return 0
    forget_stale_kernels()
    return compile_kernels()


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
