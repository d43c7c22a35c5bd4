"""The compression of GIF: variable-length codes of runs seen before (LZW), in sub-blocks."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

Bytes = npt.NDArray[np.uint8]

CODE_BITS: Final = 8
_CLEAR, _END = 1 << CODE_BITS, (1 << CODE_BITS) + 1
_MOST_CODES: Final = 4096
_SLOTS: Final = 1 << 14
_LONGEST_BLOCK: Final = 255


def compressed(indices: Bytes) -> bytes:
    """Return the image data of indices (h, w): the code size, sub-blocks and the end."""
    out = np.empty(2 * indices.size + 64, dtype=np.uint8)
    length = _encode(np.ascontiguousarray(indices).reshape(-1), out)
    data = out[:length].tobytes()
    starts = range(0, length, _LONGEST_BLOCK)
    blocks = (data[start : start + _LONGEST_BLOCK] for start in starts)
    body = b"".join(bytes((len(block),)) + block for block in blocks)
    return bytes((CODE_BITS,)) + body + b"\0"


@compiled
def _encode(indices: Bytes, out: Bytes) -> int:
    """Write the codes of indices (N,), low bits first; return how many bytes they take."""
    keys = np.full(_SLOTS, -1, dtype=np.int64)
    codes = np.zeros(_SLOTS, dtype=np.int64)
    size, free = CODE_BITS + 1, _END + 1
    at, held, bits = _put(out, 0, 0, 0, _CLEAR, size)
    prefix = np.int64(indices[0])
    for i in range(1, indices.size):
        key = (prefix << 8) | np.int64(indices[i])
        slot = _slot(keys, key)
        if keys[slot] == key:
            prefix = codes[slot]
            continue
        at, held, bits = _put(out, at, held, bits, prefix, size)
        prefix = np.int64(indices[i])
        if free < _MOST_CODES:
            keys[slot], codes[slot] = key, free
            size += free == 1 << size
            free += 1
            continue
        at, held, bits = _put(out, at, held, bits, _CLEAR, size)
        keys[:] = -1
        size, free = CODE_BITS + 1, _END + 1
    at, held, bits = _put(out, at, held, bits, prefix, size)
    size += free == 1 << size and free < _MOST_CODES
    at, held, bits = _put(out, at, held, bits, _END, size)
    if bits > 0:
        out[at] = held
        at += 1
    return at


@compiled
def _slot(keys: npt.NDArray[np.int64], key: int) -> int:
    """Return where a key stands in the table, or else where there is room for it."""
    slot = (key * 40503) & (_SLOTS - 1)
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & (_SLOTS - 1)
    return slot


@compiled
def _put(out: Bytes, at: int, held: int, bits: int, code: int, size: int) -> tuple[int, int, int]:
    """Append a code to the bits held; write whole bytes, return where, and what is held now."""
    held |= code << bits
    bits += size
    while bits >= 8:
        out[at] = held & 255
        at += 1
        held >>= 8
        bits -= 8
    return at, held, bits
