"""Surface of the faces of a mesh by numpy, step by step; bit for bit what the engine builds."""

from collections import defaultdict

import numpy as np

from rastercov.engine.solver_parts import BLOCK, CONSISTENT, NON_MANIFOLD, REVERSED


def part_of(vertices, welded, flat, least_sorted):
    """Arrays of a part by name, from (F, 3) welded corners and faces without area."""
    source, corners = np.unique(welded, return_inverse=True)
    faces = corners.reshape(-1, 3).astype(np.int32)
    order = np.arange(len(faces))
    if len(faces) >= least_sorted:
        order = order_of(vertices[source], faces)
        faces = faces[order]
        used, first = np.unique(faces, return_index=True)
        by_use = used[np.argsort(first)]
        faces, source = np.argsort(by_use)[faces].astype(np.int32), source[by_use]
    table = {"vertices": vertices[source], "faces": faces, "source": source, "order": order}
    edges = edges_of(faces)
    return table | edges | blocks_of(len(faces), flat[order], edges)


def order_of(vertices, faces):
    """Faces along a Morton curve of their centroids, unless blocks have few vertices as it is."""
    whole = [faces[at : at + BLOCK] for at in range(0, len(faces) - BLOCK + 1, BLOCK)]
    if sum(len(np.unique(block)) for block in whole) <= 96 * len(whole):
        return np.arange(len(faces))
    centroids = vertices[faces].mean(axis=1)
    extent = np.ptp(centroids, axis=0).max()
    cells = (centroids - centroids.min(axis=0)) / (extent if extent > 0 else 1) * 1023
    bits = cells.astype(np.int64)[:, None, :] >> np.arange(10)[:, None] & 1
    keys = (bits << (3 * np.arange(10)[:, None] + np.arange(3))).sum(axis=(1, 2))
    return np.argsort(keys, kind="stable")


def edges_of(faces):
    """Edges in the order of their lower and then their higher vertex."""
    uses = defaultdict(list)
    for f, face in enumerate(faces.tolist()):
        for k in range(3):
            start, end = face[k], face[(k + 1) % 3]
            uses[min(start, end), max(start, end)].append((f, k, start < end))
    kinds, two, of_face = [], [], np.empty_like(faces)
    for e, (edge, own) in enumerate(sorted(uses.items())):
        of_face[[f for f, *_ in own], [k for _, k, _ in own]] = e
        two.append((own[0][0], own[1][0] if len(own) > 1 else -1))
        kinds.append(
            NON_MANIFOLD if len(own) > 2 or edge[0] == edge[1]
            else REVERSED if len(own) == 2 and own[0][2] == own[1][2]
            else CONSISTENT
        )  # fmt: skip
    return {
        "edges.vertices": np.array(sorted(uses), np.int32), "edges.of_face": of_face,
        "edges.faces": np.array(two, np.int32), "edges.kind": np.array(kinds, np.int8),
    }  # fmt: skip


def blocks_of(n_faces, flat, edges):
    """Patches, their joins, and the blocks of the faces of edges."""
    kind, two = edges["edges.kind"], edges["edges.faces"]
    shared = [(k, *sorted(pair)) for k, pair in zip(kind, two.tolist(), strict=True)
              if min(pair) >= 0 and k != NON_MANIFOLD]  # fmt: skip
    lowest = np.arange(n_faces)
    for _ in range(BLOCK):  # at most as long as a path through a block
        for k, f, g in shared:
            if k == CONSISTENT and f // BLOCK == g // BLOCK:
                lowest[f] = lowest[g] = min(lowest[f], lowest[g])
    roots, patch = np.unique(lowest, return_inverse=True)
    ends = np.arange(-(-n_faces // BLOCK) + 1) * BLOCK
    pairs = {(min(patch[f], patch[g]), max(patch[f], patch[g]), k) for k, f, g in shared}
    joins = {(b if k == CONSISTENT else ~b, a) for a, b, k in pairs if a != b}
    rows = [slice(at, at + BLOCK) for at in range(0, len(kind), BLOCK)]
    plain = [bool((kind[row] == CONSISTENT).all() and (two[row] >= 0).all()) for row in rows]
    of_edges = [np.unique(two[row] // BLOCK) if is_plain else np.empty(0)
                for row, is_plain in zip(rows, plain, strict=True)]  # fmt: skip
    has_flat = np.zeros(len(ends) - 1, bool)
    has_flat[np.flatnonzero(flat) // BLOCK] = True
    return {
        "blocks.has_flat": has_flat, "blocks.patch": patch.astype(np.int32),
        "blocks.patch_starts": np.searchsorted(roots, ends).astype(np.int32),
        "blocks.of_patch": (roots // BLOCK).astype(np.int32),
        "blocks.lowest": roots.astype(np.int32),
        "blocks.joins": np.array([(a, b) for b, a in sorted(joins)], np.int32).reshape(-1, 2),
        "blocks.is_plain": np.array(plain),
        "blocks.starts": np.cumsum([0, *map(len, of_edges)]).astype(np.int32),
        "blocks.of_edges": np.concatenate(of_edges).astype(np.int32),
    }  # fmt: skip
