"""What commands share."""

import pytest

from ogm_mcmc.cli.options import require_matplotlib
from ogm_mcmc.errors import ConfigError


def test_without_matplotlib_one_line_says_what_to_do(monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'matplotlib.figure', None)
    with pytest.raises(ConfigError, match=r'pip install "ogm_mcmc\[plots\]"'):
        require_matplotlib()
