"""The first look through a bag: which transforms hold."""

import pytest
from support.transforms import transform

from ogm_mcmc.engine.bag_survey import survey
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.tf_messages import TF_TYPES

S = 1_000_000_000


@pytest.mark.parametrize('n_unstamped', [1, 3])
def test_entries_without_a_stamp_do_not_replace_a_static_transform(write_bag, n_unstamped):
    unstamped = [
        ('/tf', k * S, transform(0, 'base_link', 'laser', 9.0, 0.0, 0.0))
        for k in range(1, 1 + n_unstamped)
    ]
    held = ('/tf_static', 9 * S, transform(9 * S, 'base_link', 'laser', 0.2, 0.0, 0.0))
    with BagReader(write_bag([*unstamped, held], 'mcap')) as bag:
        seen = survey(bag, [], [one for one in bag.topics() if one.msgtype in TF_TYPES])
    assert seen.tree.lookup('base_link', 'laser', 20 * S).translation[0] == 0.2
    assert not seen.tree.is_moving('laser')
    assert seen.unstamped_frames == ()


@pytest.mark.parametrize('n_moving', [1, 3])
@pytest.mark.parametrize('static_s', [0, 9])
def test_entries_with_one_stamp_do_not_replace_one_either(write_bag, n_moving, static_s):
    """A clock that stood still, or a single one: where a static one says where a frame sits."""
    moving = [
        ('/tf', k * S, transform(S, 'base_link', 'laser', 9.0, 0.0, 0.0))
        for k in range(1, 1 + n_moving)
    ]
    held = transform(static_s * S, 'base_link', 'laser', 0.2, 0.0, 0.0)
    with BagReader(write_bag([*moving, ('/tf_static', static_s * S, held)], 'mcap')) as bag:
        seen = survey(bag, [], [one for one in bag.topics() if one.msgtype in TF_TYPES])
    assert seen.tree.lookup('base_link', 'laser', 20 * S).translation[0] == 0.2
    assert not seen.tree.is_moving('laser')
    assert seen.unstamped_frames == ()
