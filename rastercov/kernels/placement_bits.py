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
def sums_of_words(words, rows, which, starts, index, masks, values, out):
    """Write the sums of values over the faces of each row within some words into `out`, (N, G).

    Parameters
    ----------
    which : (N,) int64
        Set of words of each row.
    starts, index : (S + 1,) int64, (M,) int64
        Set s has the words `index[starts[s]:starts[s + 1]]`.
    masks : (M, G) uint64
        Faces of these words that count in each sum.
    values : (64 W,) int64
    """
    for n in range(len(rows)):
        row = words[rows[n]]
        for j in range(starts[which[n]], starts[which[n] + 1]):
            i = index[j]
            for k in range(masks.shape[1]):
                bits = row[i] & masks[j, k]
                if bits == 0:
                    continue
                part = values[64 * i : 64 * i + 64]
                of_word = 0
                for b in range(64):
                    of_word += part[b] & -np.int64((bits >> np.uint64(b)) & np.uint64(1))
                out[n, k] += of_word


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


@compiled
def complete_cover(words, rows, lacking, count, views, is_needed):
    """Mark the rows, in their order, that cover a face with fewer marked ones than it needs.

    Ends when no face lacks any.

    Parameters
    ----------
    lacking : (W,) uint64
        In and out: faces that lack rows.
    count, views : (64 W,) int32
        In and out: marked rows of each face; rows that it needs.
    is_needed : (N,) bool
        Out.
    """
    n_left = 0
    for i in range(len(lacking)):
        n_left += lacking[i] != 0
    for n in range(len(rows)):
        if n_left == 0:
            return
        row = words[rows[n]]
        for i in range(len(row)):
            bits = row[i] & lacking[i]
            if bits == 0:
                continue
            is_needed[n] = True
            f = 64 * i
            while bits:
                if bits & np.uint64(1):
                    count[f] += 1
                    if count[f] >= views[f]:
                        lacking[i] &= ~(np.uint64(1) << np.uint64(f & 63))
                bits >>= np.uint64(1)
                f += 1
            n_left -= lacking[i] == 0


@compiled
def change(row, sign, mask, need, weights, kind, count, done, moved):
    """Add (sign 1) or remove (-1) the row of a candidate.

    Parameters
    ----------
    row : (W,) uint64
    need, kind : (64 W,) int32
        Rows that cover a face, and the requirement that it counts towards.
    weights : (64 W,) int64
    count : (64 W,) int32
        In and out: rows of each face.
    done : (G,) int64
        In and out: weight of covered faces by requirement.
    moved : (faces of the row,) int64
        Out: faces whose count is or was below their need.

    Returns
    -------
    int
        Number of faces in `moved`.
    """
    n_moved = 0
    for i in range(len(row)):
        bits = row[i] & mask[i]
        f = 64 * i
        while bits:
            if bits & np.uint64(1):
                before = count[f]
                count[f] = before + sign
                least = min(before, count[f])
                if least < need[f]:
                    moved[n_moved] = f
                    n_moved += 1
                    if least == need[f] - 1:
                        done[kind[f]] += sign * weights[f]
            bits >>= np.uint64(1)
            f += 1
    return n_moved


@compiled
def take_out(faces, masks):
    """Clear the bits of some faces, (N,) int64, in all masks, (V, W) uint64."""
    for f in faces:
        for k in range(len(masks)):
            masks[k, f >> 6] &= ~(np.uint64(1) << np.uint64(f & 63))


@compiled
def put_in(faces, kind, masks):
    """Set the bits of some faces, (N,) int64, in the mask of their kind; see `take_out`."""
    for f in faces:
        masks[kind[f], f >> 6] |= np.uint64(1) << np.uint64(f & 63)
