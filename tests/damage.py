"""Damaged files: flipped bits, and files without the seal."""

from __future__ import annotations

import random


def flipped(content: bytes, seed: int) -> bytes:
    """A file with one bit changed, at random."""
    rng = random.Random(seed)
    changed = bytearray(content)
    changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def without_seal(content: bytes) -> bytes:
    """A file as a program leaves it that opened it for editing."""
    return content[: content.rindex(b"\ncablepod bytes=")]
