"""How far sampling has come."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

__all__ = ['IndexSize', 'Progress', 'each_of', 'nothing_said']


class Progress(NamedTuple):
    """How far sampling has come; `reason` says why it stopped, empty while it has not.

    `agreeing_share`: of the informed cells; until 16 sweeps count, of what the burn-in says.
    """

    sweeps: int
    counted: int
    seconds: float
    sweeps_per_s: float
    agreeing_share: float
    r_hat_p99: float
    ess_median: float
    mcse_max: float
    log_likelihood: float
    chains: int
    reason: str = ''

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, which knows no infinity: None for what is not known."""

        def plain(value: Any) -> Any:
            if not isinstance(value, float):
                return value
            return round(value, 6) if math.isfinite(value) else None

        return {key: plain(value) for key, value in self._asdict().items()}

    def said(self, scans: int) -> str:
        """Return a line for the log about a run that has ended, of so many scans."""
        agree = f', {100.0 * self.agreeing_share:.1f} % of the informed cells agree'
        return (
            f'refined {scans} scans in {self.seconds:.1f} s: {self.sweeps} sweeps of '
            f'{each_of(self.chains)}, {self.counted} of them counted'
            f'{agree if math.isfinite(self.r_hat_p99) else ""}'
        )


def each_of(chains: int) -> str:
    """Return whose sweeps are counted: `one chain`, or `each of 2 chains`."""
    return 'one chain' if chains == 1 else f'each of {chains} chains'


def nothing_said(scans: int, max_range_m: float = 0.0) -> str:
    """Return why scans cannot be sampled: no beam tells of a cell; a range of 0 limits none."""
    limit = f' within max_range = {max_range_m:g} m' if max_range_m > 0.0 else ''
    return f'no beam of {scans} scans says anything{limit}: nothing to sample'


class IndexSize(NamedTuple):
    """Rays, pairs of a ray and a cell it crosses, memory.

    Of these rays `n_merged` run along with others and are held together with them.
    """

    n_rays: int
    n_pairs: int
    n_bytes: int
    n_merged: int = 0
