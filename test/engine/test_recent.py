from ogm_mcmc.engine.recent import Recent


def test_the_name_not_set_for_longest_goes():
    held = Recent(2)
    held['a'], held['b'] = 1, 2
    held['a'] = 3
    held['c'] = 4
    assert held == {'a': 3, 'c': 4}
