"""Images as greys, exactly as GraphicsMagick gives them to nav2_map_server.

Eight bits stay as they are; of sixteen the grey is x // 257; colours become
floor(0.299 R + 0.587 G + 0.114 B + 1/2) at sixteen bits, then x // 257. A pixel is opaque or not:
one that is transparent in the least counts as transparent. (Found by comparing every value with
GraphicsMagick 1.3.40, 16 bits, called as `map_io.cpp` of Jazzy does. It misreads a PGM whose
white is neither 255 nor 65535; here such a file is read as its format defines it. Of a PGM whose
header has lines of DOS, CR LF, it takes the last LF for the first pixel and shows the map shifted
by one; here the pixels are those that the file holds, where its length leaves no doubt.)
"""

from __future__ import annotations

import io
import re
import threading
import warnings
import zlib
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from PIL import Image, UnidentifiedImageError

from ogm_mcmc.arrays import BoolArray, UInt8Array
from ogm_mcmc.errors import OgmError
from ogm_mcmc.files.input_files import file_to_read, reason_of

__all__ = ['MOST_PIXELS', 'Greys', 'read_greys']

# A map of 350 m x 350 m at 5 cm. `evaluate` takes 35 bytes a cell: 1.8 GB for such a map.
MOST_PIXELS = 50_000_000
FORMATS = ('PNG', 'PPM', 'BMP', 'TIFF', 'GIF', 'JPEG', 'WEBP')
PNG = b'\x89PNG\r\n\x1a\n'
BLOCK = 1 << 16
PGM_OF_DOS = re.compile(rb'P5\s(?:\s|#[^\n]*\n)*(\d{1,9})\s+(\d{1,9})\s+(\d{1,5})\r\n')
LONGEST_HEADER = 4096
STRIP = 256  # rows at a time, where colours take many bytes a pixel

_opening = threading.Lock()


class Greys(NamedTuple):
    """An image (height, width), top row first.

    grey    uint8; opaque: where it says so, None for everywhere
    deep    16 bits a pixel; coloured: not all pixels are grey
    """

    grey: UInt8Array
    opaque: BoolArray | None
    deep: bool
    coloured: bool


def read_greys(path: Path, error: type[OgmError], most_pixels: int = MOST_PIXELS) -> Greys:
    """Read an image; one with more pixels than `most_pixels` is refused by its header.

    Raises `error`: '<path>: expected a readable image (<reason>)'.
    """
    try:
        with file_to_read(path) as stream, warnings.catch_warnings():
            warnings.simplefilter('ignore')  # what is wrong is said below, in one line
            _check_png(stream)
            image = _opened(_without_dos_line(stream, most_pixels))
            width, height = image.size
            if width * height > most_pixels:
                raise ValueError(f'{width} x {height} pixels: expected at most {most_pixels}')
            return _greys(image)
    except OgmError:
        raise
    except UnidentifiedImageError as reason:
        known = f'none of {", ".join(FORMATS)}, or its header is damaged'
        raise error(f'{path}: expected a readable image ({known})') from reason
    except Exception as reason:  # a damaged image fails in more ways than can be listed
        raise error(f'{path}: expected a readable image ({reason_of(reason)})') from reason


def _check_png(stream: BinaryIO) -> None:
    """Raise ValueError for a PNG that is cut off or has a chunk that fails its checksum.

    Goes back to the start. Pillow does not look at the checksums of pixels, and would read what is
    not there.
    """
    kind = b'IEND'
    if stream.read(8) == PNG:
        kind = b''
    while kind != b'IEND':
        head = stream.read(8)
        length, kind = int.from_bytes(head[:4], 'big'), head[4:]
        found = zlib.crc32(kind)
        while length > 0 and (piece := stream.read(min(length, BLOCK))):
            found, length = zlib.crc32(piece, found), length - len(piece)
        expected = stream.read(4)
        if len(expected) < 4:
            raise ValueError('it is cut off')
        if found != int.from_bytes(expected, 'big'):
            name = kind.decode() if kind.isalpha() else 'without a name'
            raise ValueError(f'chunk {name} fails its checksum')
    stream.seek(0)


def _without_dos_line(stream: BinaryIO, most_pixels: int) -> BinaryIO:
    """Return a PGM without the CR before its pixels; anything else as it is, at its start."""
    found = PGM_OF_DOS.match(stream.read(LONGEST_HEADER))
    stream.seek(0)
    if found is None:
        return stream
    width, height, white = map(int, found.groups())
    length = width * height * (1 if white < 256 else 2)
    end = stream.seek(0, io.SEEK_END)
    stream.seek(0)
    if width * height > most_pixels or end != found.end() + length:
        return stream
    stream.seek(found.end())
    return io.BytesIO(b'P5 %d %d %d\n' % (width, height, white) + stream.read(length))


def _opened(stream: object) -> Image.Image:
    """Open an image by its header. Pillow's own limit, of all images, gives way to ours."""
    with _opening:
        usual = Image.MAX_IMAGE_PIXELS
        Image.MAX_IMAGE_PIXELS = None
        try:
            return Image.open(stream, formats=FORMATS)  # type: ignore[arg-type]
        finally:
            Image.MAX_IMAGE_PIXELS = usual


def _greys(image: Image.Image) -> Greys:
    clear = image.info.get('transparency')
    deep = image.mode.startswith('I')
    tiles = getattr(image, 'tile', ())
    layout = str(tiles[0].args) if tiles else ''
    if image.mode == 'F' or (not deep and ';16' in layout):
        raise ValueError('16 bits of colour or transparency: expected 8, or 16 of plain grey')
    if deep:
        values = np.asarray(image)
        if values.min() < 0 or values.max() > 65535:
            raise ValueError('more than 16 bits a pixel: expected at most 16')
        return Greys((values // 257).astype(np.uint8), _other_than(values, clear), True, False)
    if image.mode == '1':
        image, clear = image.convert('L'), None if clear is None else 255 * bool(clear)
    if image.mode == 'L':
        greys: UInt8Array = np.asarray(image)
        return Greys(greys, _other_than(greys, clear), False, False)
    image.load()
    return _of_colours(image)


def _other_than(values: UInt8Array, clear: object) -> BoolArray | None:
    return values != clear if isinstance(clear, int) else None


def _of_colours(image: Image.Image) -> Greys:
    width, height = image.size
    grey, opaque = np.empty((height, width), np.uint8), np.empty((height, width), bool)
    coloured = False
    for top in range(0, height, STRIP):
        end = min(top + STRIP, height)
        pixels = np.asarray(image.crop((0, top, width, end)).convert('RGBA'))
        r, g, b = (257.0 * pixels[..., i] for i in range(3))
        grey[top:end] = np.floor(0.299 * r + 0.587 * g + 0.114 * b + 0.5) // 257.0
        opaque[top:end] = pixels[..., 3] == 255
        coloured = coloured or bool((pixels[..., :1] != pixels[..., :3]).any())
    return Greys(grey, None if opaque.all() else opaque, False, coloured)
