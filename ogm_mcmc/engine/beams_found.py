"""What scans told of their beams: what no return means, and the numbers of the sensor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from ogm_mcmc.config import ForwardModelConfig, SamplerConfig
from ogm_mcmc.engine.no_returns import NoReturnChoice, NoReturns
from ogm_mcmc.engine.sensor_fit import SensorNumbers, fit_sensor
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import PlacedScan

__all__ = ['BeamsFound', 'alike']

# Chains need not forget where they were when sigma changed by no more than that.
SAME_SIGMA = 0.1

# Nor need rays be entered anew where a share changed by no more than that of itself.
SAME_SHARE = 0.2


class BeamsFound(NamedTuple):
    """What beams are like, found where the settings leave it open.

    no_return    what +inf means
    model        of the beams
    sensor       how sure its numbers are; None where all were given
    told, came   how many scans told of the sensor, and how many came in since
    """

    no_return: NoReturnChoice
    model: ForwardModelConfig
    sensor: SensorNumbers | None = None
    told: int = 0
    came: int = 0

    @classmethod
    def of_none(cls, config: SamplerConfig) -> BeamsFound:
        """Return what holds as long as there is no scan."""
        nothing = NoReturnChoice.of(config.window.no_return, NoReturns(0, 0))
        return cls(nothing, config.model)

    def renewed(
        self, scans: Sequence[PlacedScan], came: int, config: SamplerConfig, *, grows: bool
    ) -> BeamsFound:
        """Return what scans, of which so many `came` in, tell of the sensor.

        They are asked where their window is indexed anew, so does not just grow (`grows`), or once
        as many came in as had told: twice as many tell better. Where it grows, numbers stay that
        are nearly the same, so that its rays need not be entered anew.
        """
        came += self.came
        if grows and (self.sensor is None or came < self.told):
            return self._replace(came=came)
        asked = self._replace(told=len(scans), came=0)
        model, sensor = fit_sensor(scans, self.in_settings(config))
        if grows and _may_stay(self.model, model):
            return asked
        return asked._replace(model=model, sensor=sensor)

    def in_settings(self, config: SamplerConfig) -> SamplerConfig:
        """Return the settings with what no return was found to mean."""
        window = replace(config.window, no_return=self.no_return.value)
        return replace(config, window=window)

    def as_given(self, config: SamplerConfig) -> SamplerConfig:
        """Return the settings with all that scans told: nobody given these looks for it again."""
        chain = replace(config.chain, sensor='given')
        return replace(self.in_settings(config), model=self.model, chain=chain)

    def without_grazing(self, asked: ForwardModelConfig) -> BeamsFound | None:
        """Return what was found as if no grazing counted; None where that is nothing else.

        asked  the settings: grazing that somebody asked for stays
        Rays that graze are likely along more cells, and the index is larger.
        """
        sensor = self.sensor
        if asked.grazing >= 0.0 or self.model.grazing == 0.0:
            return None
        if sensor is None or sensor.grazing is None:
            return None
        sensor = sensor._replace(grazing=sensor.grazing._replace(used=0.0))
        return self._replace(model=replace(self.model, grazing=0.0), sensor=sensor)

    def as_dict(self) -> dict[str, Any]:
        """Return what was found of the sensor, by how many scans, as JSON has it."""
        model, sensor = self.model, self.sensor
        numbers = None if sensor is None else sensor.as_dict()
        shares = {'clutter': model.clutter, 'missing': model.missing}
        spreads = {'sigma': model.sigma, 'grazing': model.grazing}
        return {**spreads, **shares, 'sensor': numbers, 'scans': self.told}

    def saved(self, path: Path, said: Any, asked: ForwardModelConfig, n_scans: int) -> BeamsFound:
        """Return what a saved state says of the sensor (`as_dict`), of so many scans now.

        asked  the model in the settings. Raises WindowError.
        """
        try:
            names = ('sigma', 'grazing', 'clutter', 'missing')
            sigma, grazing, clutter, missing = (float(said[name]) for name in names)
            found = replace(asked, sigma=sigma, grazing=grazing, clutter=clutter, missing=missing)
            told, numbers = int(said['scans']), said['sensor']
            sensor = None if numbers is None else SensorNumbers.of_dict(numbers)
        except (KeyError, TypeError, ValueError) as error:
            raise WindowError(f'{path}: expected what was found of the beams ({error})') from error
        return BeamsFound(self.no_return, found, sensor, told, max(n_scans - told, 0))


def alike(one: ForwardModelConfig, other: ForwardModelConfig) -> bool:
    """Whether models differ in what is fitted alone, which changes a little with a few scans."""
    least = SAME_SIGMA * min(one.sigma, other.sigma)
    near = (
        math.isclose(one.sigma, other.sigma, rel_tol=SAME_SIGMA)
        and math.isclose(one.grazing, other.grazing, rel_tol=SAME_SIGMA, abs_tol=least)
    )  # fmt: skip
    found = replace(one, clutter=other.clutter, missing=other.missing)
    return near and replace(found, sigma=other.sigma, grazing=other.grazing) == other


def _may_stay(one: ForwardModelConfig, other: ForwardModelConfig) -> bool:
    """Whether one of two models that are alike says what the other does, nearly, of any beam."""
    shares = ((one.clutter, other.clutter), (one.missing, other.missing))
    near = all(math.isclose(before, now, rel_tol=SAME_SHARE) for before, now in shares)
    return near and alike(one, other)
