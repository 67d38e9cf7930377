"""What makes the compiler quicker ends with it."""

import gc

from ogm_mcmc.engine.compiling import uncollected


def test_garbage_is_collected_again_after_the_block():
    assert gc.isenabled()
    with uncollected():
        assert not gc.isenabled()
        with uncollected():
            pass
        assert not gc.isenabled()
    assert gc.isenabled()
