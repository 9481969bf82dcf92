"""Candidates under the ceiling of `surface_cases.room`, and greedy selection on exact areas."""

import heapq

import numpy as np

import rastercov as rc


def room_candidates(n, seed=0):
    """(n, 4, 4) poses under the ceiling of the room, above its boxes, looking down at any angle."""
    rng = np.random.default_rng(seed)
    eyes = rng.uniform((0.2, 0.2, 2.4), (7.8, 4.8, 2.9), (n, 3))
    return rc.look_at(eyes=eyes, targets=rng.uniform((0, 0, 0), (8, 5, 1.5), (n, 3)))


def area_of(mesh, camera, poses, task):
    """Exact covered share of a network."""
    return rc.unite(rc.regions(mesh, camera, poses, task)).share()


def greedy_by_area(mesh, camera, poses, task, cameras):
    """Candidates chosen by the greedy rule on exact unions, evaluated lazily, and their share.

    M. Minoux. Accelerated Greedy Algorithms for Maximizing Submodular Set Functions. 1978.
    """
    own = [rc.regions(mesh, camera, poses[row : row + 1], task) for row in range(len(poses))]
    gains = [(-rc.unite(part).share(), row, 0) for row, part in enumerate(own)]
    heapq.heapify(gains)
    chosen, share = [], 0.0
    while len(chosen) < cameras:
        gain, row, turn = heapq.heappop(gains)
        if turn == len(chosen):
            chosen.append(row)
            share -= gain
            continue
        together = rc.unite([own[each] for each in (*chosen, row)]).share()
        heapq.heappush(gains, (share - together, row, len(chosen)))
    return chosen, share
