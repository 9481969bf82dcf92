"""Compiled loops over covered pairs that are bits, one row a candidate.

Face f is bit `f % 64` of word `f // 64` of a row. Loops over all 64 bits of a word, without
branches, are compiled to vector instructions: a sum over a row of 100,000 faces takes 7 us at any
density, one bit after another 14 us at 10 %. Words that are 0 are skipped.

Arguments of one name are the same in all loops:

words : (C, W) uint64
rows : (N,) int64
    Rows of `words` to process.
mask : (W,) uint64
    Faces that count.

Arrays over faces have 64 W entries.
"""

import numpy as np

from rastercov.kernels.jit import compiled


@compiled
def set_pairs(row, face, words):
    """Set the bits of pairs of row and face, (N,) int64 and int32, in `words`."""
    for j in range(len(face)):
        words[row[j], face[j] >> 6] |= np.uint64(1) << np.uint64(face[j] & 63)


@compiled
def sums(words, rows, masks, values, out):
    """Write the sums of values over the faces of each row into `out`, (N, V) int64.

    Parameters
    ----------
    masks : (V, W) uint64
        Faces that count in each sum.
    values : (V, 64 W) int64
        Sums that exceed 64 bits lose their upper ones.
    """
    for n in range(len(rows)):
        row = words[rows[n]]
        for k in range(len(values)):
            total = 0
            for i in range(len(row)):
                bits = row[i] & masks[k, i]
                if bits == 0:
                    continue
                part = values[k, 64 * i : 64 * i + 64]
                of_word = 0
                for b in range(64):
                    of_word += part[b] & -np.int64((bits >> np.uint64(b)) & np.uint64(1))
                total += of_word
            out[n, k] = total


@compiled
def add(words, rows, amounts, totals):
    """Add the amounts of each row, (N, V) int64, to the totals of its faces, (V, 64 W) int64."""
    for n in range(len(rows)):
        row = words[rows[n]]
        for k in range(len(totals)):
            amount = amounts[n, k]
            for i in range(len(row)):
                bits = row[i]
                if bits == 0:
                    continue
                part = totals[k, 64 * i : 64 * i + 64]
                for b in range(64):
                    part[b] += amount & -np.int64((bits >> np.uint64(b)) & np.uint64(1))


@compiled
def count_up(words, planes):
    """Count the rows of each face up to the number of planes.

    Parameters
    ----------
    planes : (K, W) uint64
        In and out: plane k has the faces of more than k rows.
    """
    for n in range(len(words)):
        for k in range(len(planes) - 1, 0, -1):
            for i in range(words.shape[1]):
                planes[k, i] |= planes[k - 1, i] & words[n, i]
        for i in range(words.shape[1]):
            planes[0, i] |= words[n, i]


@compiled
def list_pairs(words, rows, mask, column, out):
    """Write the columns of the faces of each row into `out`, (pairs,) int32, row after row.

    `column` is (64 W,) int32.
    """
    at = 0
    for n in range(len(rows)):
        for i in range(words.shape[1]):
            bits = words[rows[n], i] & mask[i]
            f = 64 * i
            while bits:
                if bits & np.uint64(1):
                    out[at] = column[f]
                    at += 1
                bits >>= np.uint64(1)
                f += 1
