"""Loops of `blocks`, compiled by numba: parts of a surface that depend on no camera.

Patches, as other parts that are joined, are disjoint sets in a forest: each set is a tree whose
root names it.

R. E. Tarjan. Efficiency of a Good But Not Linear Set Union Algorithm. 1975.
"""

import numpy as np

from rastercov.kernels.exact_records import BLOCK, CONSISTENT, NON_MANIFOLD
from rastercov.kernels.jit import compiled, part_with_arrays


@part_with_arrays
def root_of(parent, i):
    """Root of the tree of i; the path to it is halved on the way."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@compiled
def find_patches(edges, patch, lowest, patch_starts):
    """Divide each block into patches: faces joined by edges that two of them use consistently.

    Parameters
    ----------
    edges : Edges
    patch, lowest : (F,) int32
        Out: patch of each face; lowest face of each patch.
    patch_starts : (N + 1,) int32
        Out: first patch of each block, and after them the number of all.

    Returns
    -------
    int
        Number of patches.
    """
    n, parent = 0, patch
    n_faces = patch.shape[0]
    for f in range(n_faces):
        parent[f] = f
    for e in range(edges.kind.shape[0]):
        f, g = edges.faces[e, 0], edges.faces[e, 1]
        if g >= 0 and edges.kind[e] == CONSISTENT and f // BLOCK == g // BLOCK:
            f, g = root_of(parent, f), root_of(parent, g)
            parent[max(f, g)] = min(f, g)
    for f in range(n_faces):
        parent[f] = root_of(parent, f)
    for b in range(patch_starts.shape[0] - 1):
        patch_starts[b] = n
        last = min((b + 1) * BLOCK, n_faces)
        for f in range(b * BLOCK, last):
            if parent[f] == f:
                lowest[n] = f
                n += 1
        # From roots to numbers: below zero until all faces of the block have theirs.
        for c in range(patch_starts[b], n):
            parent[lowest[c]] = ~np.int32(c)
        for f in range(b * BLOCK, last):
            if parent[f] >= 0:
                parent[f] = parent[parent[f]]
        for f in range(b * BLOCK, last):
            patch[f] = ~parent[f]
    patch_starts[patch_starts.shape[0] - 1] = n
    return n


@compiled
def list_joins(edges, patch, met, joins):
    """List the pairs of patches that share an edge of two faces; returns their number.

    Parameters
    ----------
    met : (C,) int32
        Scratch.
    joins : (J, 2) int32
        Out: the lower patch and the other one, whose complement ~c is listed where both faces run
        along the edge in the same direction. A pair may be listed more than once; those beyond the
        room are counted only.
    """
    n = 0
    met[:] = -1
    for f in range(patch.shape[0]):
        for s in range(3):
            e = edges.of_face[f, s]
            if edges.kind[e] == NON_MANIFOLD or edges.faces[e, 1] < 0:
                continue
            other = edges.faces[e, 0] if edges.faces[e, 0] != f else edges.faces[e, 1]
            c, d = patch[f], patch[other]
            is_consistent = edges.kind[e] == CONSISTENT
            if d <= c or (is_consistent and met[d] == c):
                continue
            if is_consistent:
                met[d] = c
            if n < joins.shape[0]:
                joins[n, 0], joins[n, 1] = c, d if is_consistent else ~d
            n += 1
    return n


@compiled
def list_blocks_of_edges(edges, met, is_plain, starts, blocks):
    """List the blocks of faces that each `BLOCK` consecutive edges belong to; their number.

    Parameters
    ----------
    met : (N,) int32
        Scratch.
    is_plain : (M,) bool
        Out: each of these edges has two faces that run along it in opposite directions.
    starts : (M + 1,) int32
        Out: the blocks of edges m are blocks[starts[m]] ... blocks[starts[m + 1] - 1].
    blocks : (Q,) int32
        Out; those beyond the room are counted only.
    """
    n = 0
    met[:] = -1
    for m in range(is_plain.shape[0]):
        starts[m], is_plain[m] = n, True
        for e in range(m * BLOCK, min((m + 1) * BLOCK, edges.kind.shape[0])):
            if edges.kind[e] != CONSISTENT or edges.faces[e, 1] < 0:
                is_plain[m] = False
                break
        for e in range(m * BLOCK, min((m + 1) * BLOCK, edges.kind.shape[0])):
            for s in range(2 if is_plain[m] else 0):
                b = edges.faces[e, s] // BLOCK
                if met[b] != m:
                    met[b] = m
                    if n < blocks.shape[0]:
                        blocks[n] = b
                    n += 1
    starts[is_plain.shape[0]] = n
    return n
