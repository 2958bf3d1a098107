"""Seal of a file: its size, its CRC-32 and its id in a line behind the last byte that the netCDF library knows.

A damaged file can make the HDF5 library hang.  The seal tells before the library opens it.  Programs that edit a file cut the
line off; what they changed is found by :mod:`cablepod.archive._checksums`.
"""

from __future__ import annotations

import re
import zlib
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, NamedTuple

from cablepod.archive._folded import PIECE, FoldedCrc

#: Version of the file layout, raised when an older package would misread new files.
SCHEMA = 3
#: Maximum length of the line.
LONGEST = 200
#: Parts of the line: damage of one of them leaves the other one.
PARTS = (b"\ncablepod bytes=", b" crc32=")
LINE = re.compile(
    rb"\ncablepod (bytes=(\d{1,18}) crc32=([0-9a-f]{8}) schema=(\d{1,9}) id=(\w{0,64})) ([0-9a-f]{8})\n\Z"
)


class Seal(NamedTuple):
    """What the line says of the bytes before it."""

    size: int
    crc: int
    schema: int
    id: str


def add_seal(path: Path, identifier: str) -> None:
    """Append the line to a complete file."""
    with path.open("r+b") as file:
        size, crc = _crc_of(file)
        name = identifier if re.fullmatch(r"\w{0,64}", identifier, re.ASCII) else ""
        text = f"bytes={size} crc32={crc:08x} schema={SCHEMA} id={name}".encode()
        file.seek(size)
        file.write(b"\ncablepod %b %08x\n" % (text, zlib.crc32(text)))


def seal_of(path: Path) -> Seal | None:
    """Return the seal of a file; None if it has none, as of one that another program edited.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If its seal is not whole.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - LONGEST))
        tail = file.read(LONGEST)
    found = LINE.search(tail)
    if found is None and not any(part in tail for part in PARTS):
        return None
    if found is None or zlib.crc32(found[1]) != int(found[6], 16):
        raise ValueError("its last line is not whole")
    return Seal(int(found[2]), int(found[3], 16), int(found[4]), found[5].decode())


def is_intact(path: Path, seal: Seal) -> bool:
    """Tell whether all bytes of a file are those that were sealed (kept for a file that stays as it is)."""
    status = path.stat()
    return _is_intact(path, seal, status.st_ino, status.st_size, status.st_mtime_ns)


@lru_cache(4096)
def _is_intact(path: Path, seal: Seal, *_: int) -> bool:
    with path.open("rb") as file:
        found = _crc_of(file, seal.size)
        return found == (seal.size, seal.crc) and len(file.read(LONGEST + 1)) <= LONGEST


def _crc_of(file: BinaryIO, size: int | None = None) -> tuple[int, int]:
    """Return size and CRC-32 of a file, or of its first `size` bytes."""
    total, done, piece = FoldedCrc(), 0, memoryview(bytearray(PIECE))
    while count := file.readinto(piece if size is None else piece[: size - done]):  # type: ignore[attr-defined]
        total.update(piece[:count])
        done += count
    return done, total.value()
