"""What few draws of maps are completed by: the live map, and what cells reflected."""

from __future__ import annotations

from typing import NamedTuple

from ogm_mcmc.config import ChainConfig
from ogm_mcmc.engine.live_map import Reflections
from ogm_mcmc.geometry import GridMap
from ogm_mcmc.sampling.estimates import (
    at_least,
    with_neighbours,
    with_one_more_draw,
    with_share_of,
)

__all__ = ['Beside']


class Beside(NamedTuple):
    """Maps of the beams that are sampled, on the cells of their window, nan where none came.

    live        the live map
    reflection  what cells reflected; None where that has no weight
    """

    live: GridMap
    reflection: Reflections | None

    def completed(
        self, drawn: GridMap, draws: int, chain: ChainConfig, blur: float, in_part: float
    ) -> GridMap:
        """Return the mean of so many draws with the live map as one more of them.

        Cells that draws are sure of have some of their neighbours (`chain.neighbours`) as far as
        readings may be of these (`blur`, 0 to 1, see `blur_of`). What cells reflected has its
        weight (`chain.reflecting`), and is the least that is believed, both as far as readings are
        of the cells that they end in and walls fill their cells in part (`in_part`, 0 to 1, see
        `filled_in_part`). Figures of each are where it is done (`ogm_mcmc.sampling.estimates`).
        """
        found = with_neighbours(drawn, blur * chain.neighbours)
        found = with_one_more_draw(found, self.live, draws)
        if self.reflection is None:
            return found
        share, weight = self.reflection.share, chain.reflecting
        found = with_share_of(found, share, weight, lowering=blur * weight, of_sure=in_part)
        return at_least(found, self.reflection.least(blur, in_part))
