"""YAML of strangers: read, or refused in one line and without work."""

import os
import time

import pytest
from support.refusals import refusal_of

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.files.yaml_files import parse_yaml, read_yaml

BILLION_LAUGHS = 'a: &a [x, x, x, x, x, x, x, x, x]\n' + ''.join(
    f'{chr(98 + i)}: &{chr(98 + i)} [{", ".join([f"*{chr(97 + i)}"] * 9)}]\n' for i in range(9)
)


def test_values_and_plain_text():
    text = 'a: 1\nb: [0.5, yes, ~]\nc: {d: 2001-01-01}\n'
    assert parse_yaml(text)['b'] == [0.5, True, None]
    assert parse_yaml(text, typed=False) == {
        'a': '1',
        'b': ['0.5', 'yes', '~'],
        'c': {'d': '2001-01-01'},
    }


@pytest.mark.parametrize('typed', [True, False])
@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        (BILLION_LAUGHS, "anchor or alias 'a': expected none"),
        ('a: *b', "anchor or alias 'b'"),
        ('[' * 100_000, 'nested more than 32 levels|nesting depth'),
        ('a: ' + '{a: ' * 40 + '1' + '}' * 40, 'nested more than 32 levels|nesting depth'),
        ('- ' * 5000 + 'a', 'nested more than 32 levels|nesting depth'),
        ('x' * (1 << 21), 'expected at most'),
        ('a: b: c', 'not allowed (here|in)'),
        ('a: !!python/object:os.system x', None),
        ('\0', '(special|control) characters are not allowed'),
    ],
)
def test_what_is_refused(text, reason, typed):
    started = time.monotonic()
    if reason is None and not typed:
        assert parse_yaml(text, typed=False) == {'a': 'x'}
        return
    with pytest.raises(ValueError, match=reason or 'could not determine a constructor') as caught:
        parse_yaml(text, typed=typed)
    assert '\n' not in str(caught.value)
    assert time.monotonic() - started < 2.0


@pytest.mark.parametrize(
    'text',
    [
        *('a: ' + '9' * 100_000, 'a: 2001-99-99', '? [a]\n: 1', 'a: !!int x', 'a: !!int ""'),
        *('a: !!float ""', 'a: !!bool x', 'a: !!timestamp x', 'a: !!binary \xe9', '!!omap a'),
    ],
)
def test_values_that_cannot_be(text):
    with pytest.raises(ValueError) as caught:  # noqa: PT011 (the reason is PyYAML's)
        parse_yaml(text)
    assert '\n' not in str(caught.value)


def refused(path):
    message = refusal_of(ConfigError, read_yaml, path, 'parameter file', ConfigError)
    assert message.startswith(f'{path}: expected a readable parameter file (')
    return message


def test_files_that_are_none(tmp_path):
    path = tmp_path / 'a.yaml'
    assert 'No such file' in refused(path)
    assert 'Is a directory' in refused(tmp_path)
    path.write_bytes(b'a: \xff\n')
    assert 'utf-8' in refused(path)
    path.write_bytes(b'#' * (1 << 21))
    assert 'more than' in refused(path)
    os.mkfifo(tmp_path / 'pipe')
    assert 'regular file' in refused(tmp_path / 'pipe')
    path.unlink()
    path.symlink_to('/dev/zero')
    assert 'regular file' in refused(path)
    path.unlink()
    path.symlink_to(path)
    assert 'symbolic links' in refused(path)
