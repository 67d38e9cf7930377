"""NPZ of strangers: refused by its headers, before it takes memory."""

import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest
from support.refusals import refusal_of

from ogm_mcmc.errors import PriorError
from ogm_mcmc.files.npz_files import NUMBER, TEXT, Field, npz_file

FIELDS = {'a': Field('f', (2, None)), 'n': NUMBER, 'text': TEXT}


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'a.npz'


def read(path, fields=FIELDS, **options):
    with npz_file(path, 'a prior', PriorError, **options) as held:
        return {name: held.read(name, field) for name, field in fields.items()}


def refused(path, fields=FIELDS, **options):
    message = refusal_of(PriorError, read, path, fields, **options)
    assert message.startswith(f'{path}: expected a prior (')
    return message


@pytest.mark.parametrize('save', [np.savez, np.savez_compressed])
@pytest.mark.parametrize(
    'array',
    [
        np.arange(6.0).reshape(2, 3),
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.arange(6.0).reshape(2, 3).astype('>f4'),
        np.zeros((2, 0)),
    ],
    ids=['C', 'Fortran', 'big-endian', 'empty'],
)
def test_what_is_written_is_read(path, save, array):
    save(path, a=array, n=7, text=np.array('grüße'), more=np.zeros(9))
    held = read(path)
    assert set(held) == set(FIELDS)
    assert np.array_equal(held['a'], array)
    assert held['a'].dtype.isnative
    assert held['a'].flags.c_contiguous
    assert (int(held['n']), str(held['text'])) == (7, 'grüße')


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'a': np.zeros(3)}, r'a is float64 (3,): expected float (2, any)'),
        ({'a': np.zeros((3, 3))}, 'a is float64 (3, 3): expected'),
        ({'a': np.zeros((2, 3), int)}, 'a is int64'),
        ({'n': np.zeros(1)}, 'n is float64 (1,): expected float or integer or unsigned ()'),
        ({'text': np.array(1.0)}, 'text is float64'),
        ({'a': np.array([[{}, {}]], object)}, 'a is object'),
        ({'text': np.array('x' * (1 << 21))}, 'expected at most'),
    ],
)
def test_another_shape_or_type(path, change, reason):
    np.savez(path, **{'a': np.zeros((2, 3)), 'n': 1, 'text': np.array('t')} | change)
    assert reason in refused(path)


def test_a_missing_field_and_other_files(path, tmp_path):
    np.savez(path, a=np.zeros((2, 3)))
    assert 'no field n' in refused(path)
    path.write_text('nothing')
    assert 'not a zip file' in refused(path)
    path.unlink()
    assert 'No such file' in refused(path)
    assert 'Is a directory' in refused(tmp_path)


def claim(path, shape, dtype='<f8', content=b'', version=1, compress=zipfile.ZIP_STORED):
    """Write a member `a` whose header claims a shape."""
    header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    length = struct.pack('<H' if version == 1 else '<I', len(header))
    with zipfile.ZipFile(path, 'w', compress) as archive:
        member = b'\x93NUMPY' + bytes([version, 0]) + length + header + content
        archive.writestr('a.npy', member)


ANY = {'a': Field('fiuU', None)}


@pytest.mark.parametrize('version', [1, 2])
@pytest.mark.parametrize(
    ('shape', 'dtype', 'reason'),
    [
        ('(10**5,)', '<f8', 'header'),
        ('(100000, 100000)', '<f8', 'expected at most'),
        ('(1000, 1000)', '<f8', 'expected another number'),
        ('(99999999999999999999999,)', '<f8', 'expected at most'),
        ('(-1,)', '<f8', 'shape (-1,)'),
        ('(0, -5)', '<f8', 'shape'),
        ('()', '<U9999999999', 'header'),
        ('(2,)', '|O', 'object'),
        ('(1000000000,)', '<U0', 'a'),
    ],
)
def test_a_header_that_lies_takes_no_memory(path, shape, dtype, reason, version):
    claim(path, shape, dtype, bytes(16), version)
    tracemalloc.start()
    message = refused(path, ANY)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert reason in message
    assert peak < 2e6


def test_an_archive_that_unfolds(path):
    claim(path, '(30000000,)', '|u1', bytes(30_000_000), compress=zipfile.ZIP_DEFLATED)
    assert path.stat().st_size < 100_000
    tracemalloc.start()
    assert 'takes 30000000 bytes: expected at most 1000000' in refused(path, ANY, most_bytes=10**6)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2e6


def test_a_header_without_an_end(path):
    member = b'\x93NUMPY\2\0' + struct.pack('<I', 2**31) + b' ' * 40_000_000
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        archive.writestr('a.npy', member)
    tracemalloc.start()
    assert 'header' in refused(path, ANY)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2e6


def test_text_that_is_none(path):
    claim(path, '()', '<U1', b'\xff\xff\xff\xff')
    assert 'expected text' in refused(path, ANY)


def test_compressions_and_passwords_we_do_not_know(path):
    np.savez(path, a=np.zeros(3))
    content = bytearray(path.read_bytes())
    entry = content.rindex(b'PK\x01\x02')
    for offset, value in ((8, 1), (10, 99)):
        changed = content.copy()
        changed[entry + offset] = value
        path.write_bytes(changed)
        refused(path, ANY)


@pytest.mark.parametrize(
    ('raised', 'reason'), [(KeyError('chains'), r"a prior \('chains'\)"), (PriorError('it'), 'it')]
)
def test_what_goes_wrong_in_the_block_is_said_of_the_file(path, raised, reason):
    np.savez(path, a=np.zeros(3))
    with pytest.raises(PriorError, match=reason), npz_file(path, 'a prior', PriorError):
        raise raised


def test_a_checksum_that_is_wrong(path):
    buffer = io.BytesIO()
    np.savez(buffer, a=np.arange(100.0))
    content = bytearray(buffer.getvalue())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    assert 'CRC' in refused(path, ANY)
