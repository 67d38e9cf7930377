"""What a mapping method saves beside the probabilities of its cells."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from ogm_mcmc.arrays import AnyArray

__all__ = ['Extras']

NONE: Mapping[str, Any] = MappingProxyType({})


class Extras(NamedTuple):
    """More than probabilities: each entry by its name, empty where a method has none.

    layers      arrays (height, width) of the saved cells; they go to the NPZ of the map
    tables      arrays of any shape, several per table; each table is a file NAME_<table>.npz
    statistics  figures for people and for JSON, by topic
    summary     the same on one line
    """

    layers: Mapping[str, AnyArray] = NONE
    tables: Mapping[str, Mapping[str, AnyArray]] = NONE
    statistics: Mapping[str, Mapping[str, Any]] = NONE
    summary: str = ''
