"""Sets of faces as bits in uint64 words, compiled: who covers what, and how much area that is.

Coverage by at least k spacecraft is counted in k layers of bits: layer i holds the faces seen by more than i spacecraft, so
adding one spacecraft is an `and` and an `or` per word and no counter is ever unpacked. Areas are integer weights, so that
sums are exact and do not depend on their order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import kernel
from swarm_mj.typing import Ints, Mask

Words = NDArray[np.uint64]

WORD = 64
BYTES_PER_WORD = 8


def pack(sees: Mask) -> Words:
    """Rows of booleans, shape (n, n_faces), as words, shape (n, ceil(n_faces / 64)); bit j of word w is face 64 w + j."""
    n, n_faces = sees.shape
    n_words = -(-n_faces // WORD)
    padded = np.zeros((n, n_words * WORD), dtype=np.bool_)
    padded[:, :n_faces] = sees
    return np.packbits(padded, axis=1, bitorder="little").view("<u8").astype(np.uint64)


def weight_table(weights: Ints) -> Ints:
    """Summed weight of every possible byte at every byte of a row, shape (8 n_words, 256)."""
    n_bytes = -(-len(weights) // WORD) * BYTES_PER_WORD
    padded = np.zeros(n_bytes * 8, dtype=np.int64)
    padded[: len(weights)] = weights
    bits = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1, bitorder="little").astype(np.int64)
    return np.ascontiguousarray(padded.reshape(n_bytes, 8) @ bits.T)


@kernel
def word_weight(word: np.uint64, w: int, table: Ints) -> np.int64:
    """Weight of the faces in one word standing at place w of its row."""
    total = np.int64(0)
    for b in range(8):
        if word == np.uint64(0):
            break
        total += table[8 * w + b, word & np.uint64(255)]
        word = word >> np.uint64(8)
    return total


@kernel
def set_weight(row: Words, table: Ints) -> np.int64:
    """Weight of a whole set of faces."""
    total = np.int64(0)
    for w in range(row.shape[0]):
        total += word_weight(row[w], w, table)
    return total


@kernel
def add_to_layers(layers: Words, row: Words) -> None:
    """Count one more spacecraft that sees `row` in place; layers has shape (k, n_words)."""
    for w in range(row.shape[0]):
        for i in range(layers.shape[0] - 1, 0, -1):
            layers[i, w] |= layers[i - 1, w] & row[w]
        layers[0, w] |= row[w]


@kernel
def is_subset(small: Words, large: Words) -> bool:
    """Whether one set of faces lies within another."""
    for w in range(small.shape[0]):
        if small[w] & ~large[w] != np.uint64(0):
            return False
    return True


@kernel
def stands_before(points: Ints, j: int) -> bool:
    """Whether point number j of a list already stood before it."""
    for i in range(j):
        if points[i] == points[j]:
            return True
    return False


@kernel
def covered_weights(rows: Words, table: Ints, genes: Ints, fold: int) -> Ints:
    """Weight of the faces seen by at least `fold` spacecraft, for gene maps of shape (m, 1 + n_max), points from 1."""
    weights = np.zeros(genes.shape[0], dtype=np.int64)
    layers = np.empty((fold, rows.shape[1]), dtype=np.uint64)
    for d in range(genes.shape[0]):
        layers[:] = np.uint64(0)
        for j in range(genes[d, 0]):
            if not stands_before(genes[d, 1:], j):
                add_to_layers(layers, rows[genes[d, 1 + j] - 1])
        weights[d] = set_weight(layers[fold - 1], table)
    return weights
