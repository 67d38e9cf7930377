"""Images as GraphicsMagick gives them to nav2; what unfolds or hangs is refused."""

import os
import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from PIL import Image
from support.refusals import refusal_of

from ogm_mcmc.errors import MapFileError
from ogm_mcmc.files.image_files import read_greys

ALL = np.arange(256, dtype=np.uint8).reshape(8, 32)


@pytest.fixture
def saved(tmp_path):
    def save(image, name='a.png', **options):
        image.save(tmp_path / name, **options)
        return tmp_path / name

    return save


def refused(path, **options):
    message = refusal_of(MapFileError, read_greys, path, MapFileError, **options)
    assert message.startswith(f'{path}: expected a readable image (')
    return message


@pytest.mark.parametrize('mode', ['L', 'RGB', 'P', 'RGBA', 'LA'])
def test_greys_stay_as_they_are(saved, mode):
    greys = read_greys(saved(Image.fromarray(ALL).convert(mode)), MapFileError)
    assert np.array_equal(greys.grey, ALL)
    assert greys.opaque is None
    assert not greys.deep
    assert not greys.coloured


def test_black_and_white(saved):
    for name in ('a.png', 'a.pbm', 'a.bmp'):
        greys = read_greys(saved(Image.fromarray(ALL > 99), name), MapFileError)
        assert np.array_equal(greys.grey, 255 * (ALL > 99))


def test_sixteen_bits(saved, tmp_path):
    values = np.array([[0, 256, 257, 513, 514, 65534, 65535]], np.uint16)
    (tmp_path / 'a.pgm').write_bytes(b'P5\n7 1\n65535\n' + values.astype('>u2').tobytes())
    for path in (tmp_path / 'a.pgm', saved(Image.fromarray(values))):
        greys = read_greys(path, MapFileError)
        assert greys.grey.tolist() == [[0, 0, 1, 1, 2, 254, 255]]
        assert greys.deep


def test_colours(saved):
    """GraphicsMagick 1.3.40 gives these; Pillow's own conversion differs in the last three."""
    colours = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (69, 78, 10), (128, 155, 248), (208, 171, 0)]
    greys = read_greys(saved(Image.fromarray(np.array([colours], np.uint8))), MapFileError)
    assert greys.grey.tolist() == [[76, 149, 29, 67, 157, 162]]
    assert greys.coloured


def test_transparent_in_the_least(saved):
    pixels = np.dstack([ALL, np.full_like(ALL, 255)])
    pixels[0, :3, 1] = (0, 1, 254)
    greys = read_greys(saved(Image.fromarray(pixels)), MapFileError)
    assert np.array_equal(greys.grey, ALL)
    assert np.argwhere(~greys.opaque).tolist() == [[0, 0], [0, 1], [0, 2]]
    for mode, clear in (('L', 77), ('RGB', (77, 77, 77)), ('P', 77)):
        image = Image.fromarray(ALL).convert(mode)
        greys = read_greys(saved(image, transparency=clear), MapFileError)
        assert np.array_equal(greys.opaque, ALL != 77)


def png(width, height, bits, kind, content):
    def chunk(name, data):
        checksum = struct.pack('>I', zlib.crc32(name + data))
        return struct.pack('>I', len(data)) + name + data + checksum

    header = struct.pack('>IIBBBBB', width, height, bits, kind, 0, 0, 0)
    return b'\x89PNG\r\n\x1a\n' + b''.join(
        [chunk(b'IHDR', header), chunk(b'IDAT', zlib.compress(content)), chunk(b'IEND', b'')]
    )


@pytest.mark.parametrize('kind', ['IHDR', 'IDAT', 'IEND'])
def test_a_chunk_that_fails_its_checksum(tmp_path, kind):
    """Pillow reads pixels whatever their checksum is."""
    content, path = bytearray(png(1, 1, 8, 0, bytes(2))), tmp_path / 'a.png'
    at = content.index(kind.encode())
    length = int.from_bytes(content[at - 4 : at], 'big')
    content[at + 4 + length] ^= 1
    path.write_bytes(content)
    assert f'chunk {kind} fails its checksum' in refused(path)
    path.write_bytes(content[: at + 4 + length])
    assert 'it is cut off' in refused(path)


@pytest.mark.parametrize('kind', ['TIFF', 'PNG', 'BMP'])
def test_an_image_is_told_by_its_content(saved, kind):
    """One named PGM that is another kind; cut off it is refused in one line."""
    path = saved(Image.fromarray(ALL), 'map.pgm', format=kind)
    assert np.array_equal(read_greys(path, MapFileError).grey, ALL)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    refused(path)


def test_what_is_no_image_is_said(tmp_path):
    (tmp_path / 'a.pgm').write_text('image: a.pgm')
    assert 'none of PNG, PPM, BMP' in refused(tmp_path / 'a.pgm')


@pytest.mark.parametrize('kind', [2, 4, 6])
def test_sixteen_bits_of_colour_or_transparency(tmp_path, kind):
    """Pillow keeps only eight of them."""
    channels = {2: 3, 4: 2, 6: 4}[kind]
    (tmp_path / 'a.png').write_bytes(png(1, 1, 16, kind, bytes(1 + 2 * channels)))
    assert '16 bits of colour or transparency' in refused(tmp_path / 'a.png')


def test_images_that_unfold_are_refused_by_their_header(tmp_path):
    content = png(60_000, 60_000, 8, 0, bytes(10**6))
    (tmp_path / 'a.png').write_bytes(content)
    (tmp_path / 'a.pgm').write_bytes(b'P5\n60000 60000\n255\n')
    for name in ('a.png', 'a.pgm'):
        tracemalloc.start()
        message = refused(tmp_path / name)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert '60000 x 60000 pixels: expected at most 50000000' in message
        assert peak < 5e6


def test_the_limit_is_ours_not_pillows(saved, monkeypatch):
    monkeypatch.setattr(Image, 'MAX_IMAGE_PIXELS', 10)
    path = saved(Image.fromarray(ALL))
    assert read_greys(path, MapFileError, 256).grey.shape == (8, 32)
    assert Image.MAX_IMAGE_PIXELS == 10
    assert 'expected at most 255' in refused(path, most_pixels=255)


def test_pipes_devices_and_folders(tmp_path):
    os.mkfifo(tmp_path / 'pipe.png')
    assert 'regular file' in refused(tmp_path / 'pipe.png')
    assert 'Is a directory' in refused(tmp_path)


@pytest.mark.parametrize('header', [b'P5\r\n32 8\r\n255\r\n', b'P5\r\n# by hand\r\n32  8 255\r\n'])
def test_lines_of_dos_in_the_header_shift_no_pixel(tmp_path, header):
    path = tmp_path / 'a.pgm'
    path.write_bytes(header + ALL.tobytes())
    assert np.array_equal(read_greys(path, MapFileError).grey, ALL)
    deep = header.replace(b'255', b'65535') + (ALL.astype('>u2') * 257).tobytes()
    path.write_bytes(deep)
    assert np.array_equal(read_greys(path, MapFileError).grey, ALL)
    assert 'pixels: expected at most 9' in refused(path, most_pixels=9)


def test_a_line_feed_that_is_the_first_pixel_stays_one(tmp_path):
    path = tmp_path / 'a.pgm'
    pixels = np.full((8, 32), 10, np.uint8)
    path.write_bytes(b'P5\r\n32 8\r\n255\r' + pixels.tobytes())
    assert np.array_equal(read_greys(path, MapFileError).grey, pixels)
