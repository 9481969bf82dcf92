"""Compiled loops of selection: incremental gains while single candidates are added and removed.

The gain of a candidate is the worth that choosing it next would add. When a face changes its state,
the gains of exactly the candidates that cover it change. There is one pass over all pairs, at the
start; a later step costs only the pairs it touches. Gains are integers: adding and removing a
camera restores them exactly, in any order of summation.

The progress of a face is min(cameras that cover it, `views`), plus one where an angle is required
and two of their rays differ by it; at `need` the face is covered. Progress p is worth

    step * p, and `bonus` more at p = need.

A candidate is one camera, or a rig of several that are added and removed one after the other; the
cameras of a rig are consecutive, and so are their pairs with a face: a run.

Arguments of one name are the same in all loops:

indptr, face : (K + 1,) int64, (N,) int32
    Faces of each camera.
starts, cameras : (F + 1,) int64, (N,) int32
    Cameras of each face, ascending.
owner : (K,) int32
    Candidate of each camera, ascending.
views, need, step, bonus : (F,)
    See above.
kind : (F,) int32
    Requirement that the face counts towards.
eyes, centroids : (K, 3), (F, 3) float64
min_cosine : float
    Two rays differ by the angle where their cosine is this or less.

Arrays are passed one by one: calls from Python with named tuples of them make a selection 10 to
28 % slower.
"""

import numpy as np

from rastercov.kernels.jit import compiled
from rastercov.kernels.spread import any_differ, differs_from_any, rays_differ


@compiled
def _run_end(cameras, owner, first, last):
    """End of the run of one candidate that begins at `first`, up to `last`."""
    end = first + 1
    while end < last and owner[cameras[end]] == owner[cameras[first]]:
        end += 1
    return end


@compiled
def _worth(n, views, is_spread, need, step, bonus):
    """Worth of the progress of a face that n cameras cover."""
    progress = min(n, views) + is_spread
    return progress * step + (bonus if progress >= need else 0)


@compiled
def first_gains(
    starts, cameras, owner, views, need, step, bonus, kind, eyes, centroids, min_cosine, gain
):  # fmt: skip
    """Write the gain of each candidate as the first one into `gain`, (C, G)."""
    for f in range(len(starts) - 1):
        nothing = _worth(0, views[f], False, need[f], step[f], bonus[f])
        i = starts[f]
        while i < starts[f + 1]:
            end = _run_end(cameras, owner, i, starts[f + 1])
            is_spread = need[f] > views[f] and any_differ(
                cameras, i, end, eyes, centroids, f, min_cosine
            )
            worth = _worth(end - i, views[f], is_spread, need[f], step[f], bonus[f])
            gain[owner[cameras[i]], kind[f]] += worth - nothing
            i = end


@compiled
def change(
    row, sign, indptr, face, starts, cameras, owner, views, need, step, bonus, kind, weights, count,
    gain, done, total,
):  # fmt: skip
    """Add (sign 1) or remove (-1) a camera, where any two rays will do; the work it took.

    Parameters
    ----------
    views, need : (F,) int32
        Equal here.
    weights : (F,) int64
        Integer weights.
    count : (F,) int32
        In and out: cameras that cover each face.
    gain : (C, G) int64
        In and out: gain of each candidate, by requirement.
    done : (G,) int64
        In and out: weight of the covered faces.
    total : (1,) int64
        In and out: worth of the progress of all faces.
    """
    has_rigs = len(owner) > len(gain)
    work = indptr[row + 1] - indptr[row]
    for j in range(indptr[row], indptr[row + 1]):
        f = face[j]
        old, wanted = count[f], need[f]
        new = old + sign
        count[f] = new
        if min(old, new) >= wanted:
            continue
        before = _worth(old, wanted, False, wanted, step[f], bonus[f])
        here = _worth(new, wanted, False, wanted, step[f], bonus[f])
        total[0] += here - before
        if (old >= wanted) != (new >= wanted):
            done[kind[f]] += sign * weights[f]
        if not has_rigs:
            change_of_gain = before - here
            change_of_gain += _worth(new + 1, wanted, False, wanted, step[f], bonus[f])
            change_of_gain -= _worth(old + 1, wanted, False, wanted, step[f], bonus[f])
            if change_of_gain != 0:
                work += starts[f + 1] - starts[f]
                for i in range(starts[f], starts[f + 1]):
                    gain[cameras[i], kind[f]] += change_of_gain
            continue
        work += starts[f + 1] - starts[f]
        i = starts[f]
        while i < starts[f + 1]:
            end = _run_end(cameras, owner, i, starts[f + 1])
            added = _worth(new + end - i, wanted, False, wanted, step[f], bonus[f]) - here
            was = _worth(old + end - i, wanted, False, wanted, step[f], bonus[f]) - before
            gain[owner[cameras[i]], kind[f]] += added - was
            i = end
    return work


@compiled
def change_spread(
    row, sign, indptr, face, starts, cameras, owner, views, need, step, bonus, kind, weights, count,
    gain, done, total, eyes, centroids, min_cosine, seen, is_spread,
):  # fmt: skip
    """Add or remove a camera as `change` does, where the rays to two cameras of a face must differ.

    Parameters
    ----------
    seen : (F, M) int32
        In and out: the cameras that cover each face, the first `count` of them.
    is_spread : (F,) bool
        In and out: True where the rays to two of these differ by the angle.
    """
    work, changes = indptr[row + 1] - indptr[row], np.zeros(3, np.int64)
    for j in range(indptr[row], indptr[row + 1]):
        f = face[j]
        old, was_spread = count[f], is_spread[f]
        new, others = old + sign, seen[f]
        if sign > 0:
            is_spread[f] = was_spread or differs_from_any(
                row, others, old, eyes, centroids, f, min_cosine
            )
            others[old] = row
        else:
            at = 0
            while others[at] != row:
                at += 1
            for later in range(at, new):
                others[later] = others[later + 1]
            if was_spread:
                is_spread[f] = any_differ(others, 0, new, eyes, centroids, f, min_cosine)
        count[f] = new
        was_done = min(old, views[f]) + was_spread >= need[f]
        is_done = min(new, views[f]) + is_spread[f] >= need[f]
        if was_done and is_done:
            continue
        before = _worth(old, views[f], was_spread, need[f], step[f], bonus[f])
        here = _worth(new, views[f], is_spread[f], need[f], step[f], bonus[f])
        total[0] += here - before
        if was_done != is_done:
            done[kind[f]] += sign * weights[f]
        work += (starts[f + 1] - starts[f]) * (old + 1)
        n_rest, n, now_spread = min(old, new), 0, is_spread[f]  # cameras without this one
        i = starts[f]
        while i < starts[f + 1]:
            end = _run_end(cameras, owner, i, starts[f + 1])
            # Where the rays differ already, those of a further candidate add nothing.
            is_far = was_spread and is_spread[f]
            is_far = is_far or any_differ(cameras, i, end, eyes, centroids, f, min_cosine)
            for k in range(i, end):
                is_far = is_far or differs_from_any(
                    cameras[k], others, n_rest, eyes, centroids, f, min_cosine
                )
            is_far_of_all = is_far or was_spread or is_spread[f]
            for k in range(i, end):
                is_far_of_all = is_far_of_all or rays_differ(
                    eyes, cameras[k], row, centroids, f, min_cosine
                )
            if end - i != n:
                n = end - i
                for which in range(3):  # far from none, from this camera only, from the others
                    far_before = which == 2 or (which == 1 and sign < 0)
                    far_after = which == 2 or (which == 1 and sign > 0)
                    spread_before, spread_after = was_spread or far_before, now_spread or far_after
                    after = _worth(new + n, views[f], spread_after, need[f], step[f], bonus[f])
                    was = _worth(old + n, views[f], spread_before, need[f], step[f], bonus[f])
                    changes[which] = (after - here) - (was - before)
            gain[owner[cameras[i]], kind[f]] += changes[int(is_far) + int(is_far_of_all)]
            i = end
    return work


@compiled
def scores(gain, room, total_room, costs, barred, most_cost, by_cost):
    """(C,) gain of each candidate that counts, or gain by cost; 0 where it cannot be chosen.

    Parameters
    ----------
    gain : (C, G) int64
    room : (G,) int64
        Upper limit of the gain that counts, by requirement.
    total_room : int
        Upper limit of the gain that counts in total.
    costs, barred : (C,) float64, uint8
        Barred candidates are excluded, and those that cost more than `most_cost`.
    """
    found = np.zeros(len(gain))
    for c in range(len(gain)):
        if barred[c] or costs[c] > most_cost:
            continue
        worth, total = 0, 0
        for g in range(len(room)):
            worth += min(gain[c, g], room[g])
            total += gain[c, g]
        worth += min(total, total_room)
        if worth > 0:
            found[c] = worth / max(costs[c], 1e-12) if by_cost else float(worth)
    return found


@compiled
def next_camera(gain, room, total_room, costs, rank, barred, most_cost, by_cost):
    """Candidate with the greatest of `scores`; ties by rank, (C,) int64; -1 for none."""
    found = scores(gain, room, total_room, costs, barred, most_cost, by_cost)
    best, best_score = -1, 0.0
    for c in range(len(found)):
        is_tie = found[c] == best_score and best >= 0 and rank[c] < rank[best]
        if found[c] > best_score or is_tie:
            best, best_score = c, found[c]
    return best


@compiled
def missing_directions(starts, cameras, owner, is_chosen, views, eyes, centroids, min_cosine):
    """Candidates of which a face needs one, where all chosen cameras see it from one direction.

    Parameters
    ----------
    is_chosen : (C,) bool
    views : (F,) int64
        Cameras that a face needs; faces with fewer chosen ones are skipped.

    Returns
    -------
    (F + 1,) int64, (N,) int32
        Row limits by face, and the candidates: all that cover it, except a maximal set around the
        chosen ones of which no two cameras differ by the angle.
    """
    n_faces = len(starts) - 1
    ends = np.zeros(n_faces + 1, np.int64)
    found = np.empty(len(cameras), np.int32)
    close = np.empty(len(owner), np.int32)
    is_in = np.zeros(len(is_chosen), np.bool_)
    n_found = 0
    for f in range(n_faces):
        n = 0
        for i in range(starts[f], starts[f + 1]):
            is_in[owner[cameras[i]]] = is_chosen[owner[cameras[i]]]
            if is_chosen[owner[cameras[i]]]:
                close[n] = cameras[i]
                n += 1
        if n >= views[f] and not any_differ(close, 0, n, eyes, centroids, f, min_cosine):
            i = starts[f]
            while i < starts[f + 1]:
                c, end = owner[cameras[i]], _run_end(cameras, owner, i, starts[f + 1])
                if not is_in[c]:
                    is_far = any_differ(cameras, i, end, eyes, centroids, f, min_cosine)
                    for k in range(i, end):
                        is_far = is_far or differs_from_any(
                            cameras[k], close, n, eyes, centroids, f, min_cosine
                        )
                    if is_far:
                        found[n_found] = c
                        n_found += 1
                    else:
                        for k in range(i, end):
                            close[n] = cameras[k]
                            n += 1
                i = end
        ends[f + 1] = n_found
    return ends, found


@compiled
def open_weights(indptr, face, owner, is_open, integer_weights, weight):
    """Write the total weight of the open faces of each candidate into `weight`, (C, 1)."""
    weight[:] = 0
    for row in range(len(owner)):
        for j in range(indptr[row], indptr[row + 1]):
            if is_open[face[j]]:
                weight[owner[row], 0] += integer_weights[face[j]]
