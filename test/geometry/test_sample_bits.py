"""Map samples as bits: what is known of them."""

import numpy as np

from ogm_mcmc.geometry import GridMap, GridSpec, SampleBits

SPEC = GridSpec(0.5, 3, 1)


def test_samples_are_known_where_they_were_drawn_and_a_map_is():
    maps = np.array([[[0, 1, 1]], [[0, 0, 1]]], np.uint8)
    bits = SampleBits.of_maps(SPEC, maps, np.array([[True, True, False]]))
    probability = np.array([[0.1, np.nan, 0.9]], np.float32)
    found = bits.known_in(GridMap(SPEC, probability))
    assert found.known.tolist() == [[True, False, False]]
    assert found.words.tolist() == bits.words.tolist() == [[[0], [1], [3]]]
    assert bits.known.tolist() == [[True, True, False]]
