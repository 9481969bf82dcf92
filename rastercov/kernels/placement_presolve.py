"""Compiled loops of presolve: pairs by face, hashes of sets, subsets of a problem."""

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
    """Two hashes of each key, (N,) uint64, as `hash_sets` and `hash_owners` add up: (N, 2)."""
    hashes = np.empty((len(keys), 2), np.uint64)
    for i in range(len(keys)):
        hashes[i, 0] = mixed(keys[i])
        hashes[i, 1] = mixed(hashes[i, 0] ^ np.uint64(0x5851F42D4C957F2D))
    return hashes


@compiled
def hash_sets(indptr, member, counted, key):
    """Sums of two hashes over the counted members of each set, (C, 2) uint64, and sizes, (C,).

    A sum does not depend on the order of the members. Two different sets have the same 128 bits
    once in 10^38 pairs. `counted` and `key`, (F,) bool and uint64, are of the members.
    """
    n = len(indptr) - 1
    hashes, sizes = np.zeros((n, 2), np.uint64), np.zeros(n, np.int64)
    for c in range(n):
        for j in range(indptr[c], indptr[c + 1]):
            m = member[j]
            if counted[m]:
                first = mixed(key[m])
                hashes[c, 0] += first
                hashes[c, 1] += mixed(first ^ np.uint64(0x5851F42D4C957F2D))
                sizes[c] += 1
    return hashes, sizes


@compiled
def hash_owners(indptr, member, key, n_members):
    """(F, 2) uint64 hashes, as in `hash_sets`, of the sets that hold each member.

    `key`, (C,) int64, is of the sets; those with -1 are ignored.
    """
    hashes = np.zeros((n_members, 2), np.uint64)
    for c in range(len(indptr) - 1):
        if key[c] >= 0:
            first = mixed(np.uint64(key[c]))
            second = mixed(first ^ np.uint64(0x5851F42D4C957F2D))
            for j in range(indptr[c], indptr[c + 1]):
                hashes[member[j], 0] += first
                hashes[member[j], 1] += second
    return hashes


@compiled
def subset(indptr, face, candidates, new_face):
    """The pairs of some candidates and faces; `new_face` is -1 for faces that are left out."""
    starts = np.zeros(len(candidates) + 1, np.int64)
    for i in range(len(candidates)):
        kept = 0
        for j in range(indptr[candidates[i]], indptr[candidates[i] + 1]):
            kept += new_face[face[j]] >= 0
        starts[i + 1] = starts[i] + kept
    faces = np.empty(starts[-1], np.int32)
    at = 0
    for c in candidates:
        for j in range(indptr[c], indptr[c + 1]):
            if new_face[face[j]] >= 0:
                faces[at] = new_face[face[j]]
                at += 1
    return starts, faces
