"""What a user typed becomes a path, or one line."""

from pathlib import Path

import pytest

from ogm_mcmc.errors import MapFileError, OutputError
from ogm_mcmc.files.user_paths import user_path


def test_home_is_filled_in(monkeypatch):
    monkeypatch.setenv('HOME', '/home/somebody')
    assert user_path('~/maps') == Path('/home/somebody/maps')
    assert user_path('maps/~') == Path('maps/~')
    assert user_path(Path('deep') / 'map.yaml') == Path('deep/map.yaml')
    assert user_path('é' * 127) == Path('é' * 127)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('', 'is empty'),
        ('~nosuchuser/maps', 'home directory'),
        ('maps\0', 'without NUL bytes'),
        ('maps\ud800', 'surrogates not allowed'),
        ('x' * 256, 'at most 255 bytes'),
        ('é' * 128, 'at most 255 bytes'),
        ('deep/' * 1000, '4095 in all'),
    ],
)
def test_what_no_file_can_be_called(text, reason):
    with pytest.raises(OutputError, match=reason) as caught:
        user_path(text, 'save_directory')
    assert str(caught.value).startswith('save_directory is ')
    assert '\n' not in str(caught.value)
    assert len(str(caught.value)) < 200
    with pytest.raises(MapFileError, match=r'^world is '):
        user_path(text, 'world', MapFileError)
