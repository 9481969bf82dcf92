"""Compiled loops of presolve: pairs by face, hashes."""

import numpy as np

from rastercov.kernels.jit import compiled


@compiled
def by_face(indptr, face, n_faces):
    """Transposed pairs: row limits by face, (F + 1,), and the candidate of each pair, (N,)."""
    starts = np.zeros(n_faces + 1, np.int64)
    for j in range(len(face)):
        starts[face[j] + 1] += 1
    for f in range(n_faces):
        starts[f + 1] += starts[f]
    at = starts[:-1].copy()
    candidates = np.empty(len(face), np.int32)
    for c in range(len(indptr) - 1):
        for j in range(indptr[c], indptr[c + 1]):
            candidates[at[face[j]]] = c
            at[face[j]] += 1
    return starts, candidates


@compiled
def mixed(number):
    """Hash of a number to 64 bits (splitmix64)."""
    z = np.uint64(number) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@compiled
def hashes_of(keys):
    """Two hashes of each key, (N,) uint64: (N, 2).

    The sum of those of the members of a set does not depend on their order, and two different sets
    have the same 128 bits once in 10^38 pairs.
    """
    hashes = np.empty((len(keys), 2), np.uint64)
    for i in range(len(keys)):
        hashes[i, 0] = mixed(keys[i])
        hashes[i, 1] = mixed(hashes[i, 0] ^ np.uint64(0x5851F42D4C957F2D))
    return hashes
