"""Compiled loops of selection: incremental gains while single cameras are added and removed.

The gain of a candidate is the worth that choosing it next would add. When a face changes its state,
the gains of exactly the candidates that cover it change. There is one pass over all pairs, at the
start; a later step costs only the pairs it touches. Gains are integers: adding and removing a
camera restores them exactly, in any order of summation.

The progress of a face is min(cameras that cover it, `views`), plus one where an angle is required
and two of their rays differ by it; at `need` the face is covered. Progress p is worth

    step * p, and `bonus` more at p = need.

Arguments of one name are the same in all loops:

indptr, face : (C + 1,) int64, (N,) int32
    Faces of each candidate.
starts, candidates : (F + 1,) int64, (N,) int32
    Candidates of each face.
views, need, step, bonus : (F,)
    See above.
kind : (F,) int32
    Requirement that the face counts towards.
eyes, centroids : (C, 3), (F, 3) float64
min_cosine : float
    Two rays differ by the angle where their cosine is this or less.

Arrays are passed one by one: calls from Python with named tuples of them make a selection 10 to
28 % slower.
"""

import numpy as np

from rastercov.kernels.jit import compiled
from rastercov.kernels.spread import ray_cosine


@compiled
def spread_faces(indptr, face, eye, chosen, views, eyes, centroids, min_cosine):
    """(F,) faces to which two of the chosen cameras have rays with a cosine up to `min_cosine`.

    `chosen` are K rows; `eye`, (N,), is the row in `eyes` of each pair; `views`, (F,), is the
    number of their cameras that cover each face.
    """
    starts = np.zeros(len(views) + 1, np.int64)
    for f in range(len(views)):
        starts[f + 1] = starts[f] + views[f]
    at = starts[:-1].copy()
    seen = np.empty(starts[-1], np.int64)
    for c in chosen:
        for j in range(indptr[c], indptr[c + 1]):
            seen[at[face[j]]] = eye[j]
            at[face[j]] += 1
    # If all rays lie within half the angle of the first, no two differ by the whole angle.
    half = np.cos(np.arccos(min(max(min_cosine, -1.0), 1.0)) / 2)
    spread = np.zeros(len(views), np.bool_)
    for f in range(len(views)):
        if starts[f + 1] - starts[f] < 2:
            continue
        lowest = 1.0
        for i in range(starts[f] + 1, starts[f + 1]):
            lowest = min(lowest, ray_cosine(eyes, seen[starts[f]], seen[i], centroids, f))
        spread[f] = lowest <= min_cosine
        if spread[f] or lowest > half + 1e-9:
            continue
        for i in range(starts[f] + 1, starts[f + 1]):
            for j in range(i + 1, starts[f + 1]):
                if ray_cosine(eyes, seen[i], seen[j], centroids, f) <= min_cosine:
                    spread[f] = True
                    break
            if spread[f]:
                break
    return spread


@compiled
def change(
    c, sign, indptr, face, starts, candidates, views, need, step, bonus, kind, weights, count,
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
    work = 0
    for j in range(indptr[c], indptr[c + 1]):
        f = face[j]
        old, wanted = count[f], need[f]
        count[f] = old + sign
        low = min(old, old + sign)  # the step from low to low + 1 is made or undone
        if low >= wanted:
            continue
        worth = step[f] + (bonus[f] if low + 1 == wanted else 0)
        total[0] += sign * worth
        if low + 1 == wanted:
            done[kind[f]] += sign * weights[f]
        # The gain of one more camera changes from the step above `old` to that above `old + sign`.
        before = worth if sign > 0 else _worth(old, wanted, step[f], bonus[f])
        after = worth if sign < 0 else _worth(old + 1, wanted, step[f], bonus[f])
        if after != before:
            work += starts[f + 1] - starts[f]
            for i in range(starts[f], starts[f + 1]):
                gain[candidates[i], kind[f]] += after - before
    return work + indptr[c + 1] - indptr[c]


@compiled
def _worth(progress, need, step, bonus):
    """Worth of the step above a progress."""
    if progress >= need:
        return 0
    return step + bonus if progress + 1 == need else step


@compiled
def change_spread(
    c, sign, indptr, face, starts, candidates, views, need, step, bonus, kind, weights, count,
    gain, done, total, eyes, centroids, min_cosine, seen, is_spread,
):  # fmt: skip
    """Add or remove a camera as `change` does, where the rays to two cameras of a face must differ.

    Parameters
    ----------
    seen : (F, K) int32
        In and out: the cameras that cover each face, the first `count` of them.
    is_spread : (F,) bool
        In and out: True where the rays to two of these differ by the angle.
    """
    work = indptr[c + 1] - indptr[c]
    for j in range(indptr[c], indptr[c + 1]):
        f = face[j]
        n, before = count[f], min(count[f], views[f]) + is_spread[f]
        was_spread = is_spread[f]
        if sign > 0:
            seen[f, n] = c
            if not was_spread:
                for i in range(n):
                    if ray_cosine(eyes, c, seen[f, i], centroids, f) <= min_cosine:
                        is_spread[f] = True
                        break
        else:
            i = 0
            while seen[f, i] != c:
                i += 1
            for i2 in range(i, n - 1):
                seen[f, i2] = seen[f, i2 + 1]
            if was_spread:
                is_spread[f] = _is_spread(seen, n - 1, eyes, centroids, f, min_cosine)
        count[f] = n + sign
        after = min(count[f], views[f]) + is_spread[f]
        if before == need[f] and after == need[f]:
            continue
        if before == need[f] or after == need[f]:
            total[0] += sign * bonus[f]
            done[kind[f]] += sign * weights[f]
        total[0] += (after - before) * step[f]
        # The list is one camera longer on one side: gains of the other side leave that camera out.
        work += (starts[f + 1] - starts[f]) * (n + 1)
        for i in range(starts[f], starts[f + 1]):
            other = candidates[i]
            closest_of_rest, closest_to_c = 2.0, 2.0
            for i2 in range(n + (sign > 0)):
                camera = seen[f, i2] if i2 < count[f] else c
                cosine = ray_cosine(eyes, other, camera, centroids, f)
                if camera == c:
                    closest_to_c = cosine
                else:
                    closest_of_rest = min(closest_of_rest, cosine)
            far_of_rest = closest_of_rest <= min_cosine
            far_of_all = far_of_rest or closest_to_c <= min_cosine
            far_before = far_of_rest if sign > 0 else far_of_all
            far_after = far_of_all if sign > 0 else far_of_rest
            gain[other, kind[f]] += _worth_of_one(
                n + sign, views[f], is_spread[f], far_after, need[f], step[f], bonus[f]
            ) - _worth_of_one(n, views[f], was_spread, far_before, need[f], step[f], bonus[f])
    return work


@compiled
def _is_spread(seen, n, eyes, centroids, f, min_cosine):
    for i in range(n):
        for j in range(i + 1, n):
            if ray_cosine(eyes, seen[f, i], seen[f, j], centroids, f) <= min_cosine:
                return True
    return False


@compiled
def _worth_of_one(n, views, is_spread, is_far, need, step, bonus):
    """Gain of one more camera at a face with n; is_far: its ray differs from one of theirs."""
    progress = min(n, views) + is_spread
    after = min(n + 1, views) + (is_spread or is_far)
    return (after - progress) * step + (bonus if progress < need and after == need else 0)


@compiled
def _score(gain, c, room, total_room, cost, by_cost):
    """Gain of a candidate that counts, or gain by cost; 0 for none."""
    worth, total = 0, 0
    for g in range(len(room)):
        worth += min(gain[c, g], room[g])
        total += gain[c, g]
    worth += min(total, total_room)
    if worth <= 0:
        return 0.0
    return worth / max(cost, 1e-12) if by_cost else float(worth)


@compiled
def next_camera(gain, room, total_room, costs, rank, barred, most_cost, by_cost):
    """Candidate with the greatest gain, or gain by cost; ties by rank; -1 for none.

    Parameters
    ----------
    gain : (C, G) int64
    room : (G,) int64
        Upper limit of the gain that counts, by requirement.
    total_room : int
        Upper limit of the gain that counts in total.
    costs, rank, barred : (C,) float64, int64, uint8
        Barred candidates are excluded, and those that cost more than `most_cost`.
    """
    best, best_score = -1, 0.0
    for c in range(len(gain)):
        if barred[c] or costs[c] > most_cost:
            continue
        score = _score(gain, c, room, total_room, costs[c], by_cost)
        if score > best_score or (score == best_score and best >= 0 and rank[c] < rank[best]):
            best, best_score = c, score
    return best


@compiled
def scores(gain, room, total_room, costs, barred, most_cost, by_cost):
    """(C,) scores by which `next_camera` chooses, 0 for candidates that it does not choose."""
    found = np.zeros(len(gain))
    for c in range(len(gain)):
        if not barred[c] and costs[c] <= most_cost:
            found[c] = _score(gain, c, room, total_room, costs[c], by_cost)
    return found


@compiled
def first_gains(indptr, face, need, step, bonus, kind, gain):
    """Write the gain of each candidate as the first camera into `gain`, (C, G)."""
    for c in range(len(indptr) - 1):
        for j in range(indptr[c], indptr[c + 1]):
            f = face[j]
            gain[c, kind[f]] += _worth(0, need[f], step[f], bonus[f])


@compiled
def missing_directions(starts, candidates, is_chosen, views, eyes, centroids, min_cosine):
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
        chosen ones of which no two differ by the angle.
    """
    n_faces = len(starts) - 1
    ends = np.zeros(n_faces + 1, np.int64)
    found = np.empty(len(candidates), np.int32)
    close = np.empty(len(is_chosen), np.int32)
    n_found = 0
    for f in range(n_faces):
        n = 0
        for i in range(starts[f], starts[f + 1]):
            if is_chosen[candidates[i]]:
                close[n] = candidates[i]
                n += 1
        is_open = n >= views[f]
        for i in range(n):
            for j in range(i + 1, n):
                if ray_cosine(eyes, close[i], close[j], centroids, f) <= min_cosine:
                    is_open = False
        if is_open:
            for i in range(starts[f], starts[f + 1]):
                c, fits = candidates[i], True
                for j in range(n):
                    if c == close[j] or ray_cosine(eyes, c, close[j], centroids, f) <= min_cosine:
                        fits = False
                        break
                if fits:
                    close[n] = c
                    n += 1
            for i in range(starts[f], starts[f + 1]):
                c, is_close = candidates[i], False
                for j in range(n):
                    if c == close[j]:
                        is_close = True
                        break
                if not is_close:
                    found[n_found] = c
                    n_found += 1
        ends[f + 1] = n_found
    return ends, found


@compiled
def open_weights(indptr, face, is_open, integer_weights, weight):
    """Write the total weight of the open faces of each candidate into `weight`, (C, 1)."""
    for c in range(len(indptr) - 1):
        weight[c, 0] = 0
        for j in range(indptr[c], indptr[c + 1]):
            if is_open[face[j]]:
                weight[c, 0] += integer_weights[face[j]]
