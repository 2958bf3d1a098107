"""Damaged files: flipped bits, and files without the seal."""

from __future__ import annotations

import random


def flipped(content: bytes, seed: int) -> bytes:
    """A file with one bit changed, at random."""
    rng = random.Random(seed)
    return with_flipped(content, 8 * rng.randrange(len(content)) + rng.randrange(8))


def with_flipped(content: bytes, bit: int) -> bytes:
    """A file with this bit changed."""
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def without_seal(content: bytes) -> bytes:
    """A file as a program leaves it that opened it for editing."""
    return content[: content.rindex(b"\ncablepod bytes=")]
