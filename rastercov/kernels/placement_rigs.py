"""Compiled loops of selection where a candidate may be a rig of several cameras.

A candidate has a pair with a face for each of its cameras that covers it; such pairs follow one
another, a run. Progress, worth and arguments are those of `placement_selection`, and so are the
results where every run is one pair: with c chosen the progress of a face grows by its whole run.

eye, covering_eye : (N,) int32
    Row in `eyes` of the camera of each pair, in the order of `face` and of `candidates`.
"""

import numpy as np

from rastercov.kernels.jit import compiled
from rastercov.kernels.spread import ray_cosine


@compiled
def _run_end(items, first, last):
    """End of the run that begins at `first`, up to `last`."""
    end = first + 1
    while end < last and items[end] == items[first]:
        end += 1
    return end


@compiled
def _value(n, views, is_spread, need, step, bonus):
    """Worth of the progress of a face that n cameras cover."""
    progress = min(n, views) + is_spread
    return progress * step + (bonus if progress >= need else 0)


@compiled
def first_gains(
    indptr, face, eye, views, need, step, bonus, kind, eyes, centroids, min_cosine, gain
):  # fmt: skip
    """Write the gain of each candidate as the first one into `gain`, (C, G)."""
    for c in range(len(indptr) - 1):
        j = indptr[c]
        while j < indptr[c + 1]:
            end, f = _run_end(face, j, indptr[c + 1]), face[j]
            is_spread = need[f] > views[f] and _differ(eye, j, end, eyes, centroids, f, min_cosine)
            gain[c, kind[f]] += _value(
                end - j, views[f], is_spread, need[f], step[f], bonus[f]
            ) - _value(0, views[f], False, need[f], step[f], bonus[f])
            j = end


@compiled
def _differ(eye, first, last, eyes, centroids, f, min_cosine):
    """True where the rays of two of some cameras differ by the angle."""
    for i in range(first, last):
        for j in range(i + 1, last):
            if ray_cosine(eyes, eye[i], eye[j], centroids, f) <= min_cosine:
                return True
    return False


@compiled
def change(
    c, sign, indptr, face, starts, candidates, views, need, step, bonus, kind, weights, count,
    gain, done, total,
):  # fmt: skip
    """Add (sign 1) or remove (-1) a candidate, where any two rays will do; the work it took."""
    work = indptr[c + 1] - indptr[c]
    j = indptr[c]
    while j < indptr[c + 1]:
        end, f = _run_end(face, j, indptr[c + 1]), face[j]
        old, new = count[f], count[f] + sign * (end - j)
        count[f] = new
        j = end
        wanted = need[f]
        if old >= wanted and new >= wanted:
            continue
        here = _value(new, wanted, False, wanted, step[f], bonus[f])
        before = _value(old, wanted, False, wanted, step[f], bonus[f])
        total[0] += here - before
        if (old >= wanted) != (new >= wanted):
            done[kind[f]] += sign * weights[f]
        work += starts[f + 1] - starts[f]
        i = starts[f]
        while i < starts[f + 1]:
            stop = _run_end(candidates, i, starts[f + 1])
            n = stop - i
            gain[candidates[i], kind[f]] += (
                _value(new + n, wanted, False, wanted, step[f], bonus[f]) - here
            ) - (_value(old + n, wanted, False, wanted, step[f], bonus[f]) - before)
            i = stop
    return work


@compiled
def _is_far(eye, first, last, seen, n, eyes, centroids, f, min_cosine):
    """True where a camera of a run and one of n others have rays that differ by the angle."""
    for i in range(first, last):
        for k in range(n):
            if ray_cosine(eyes, eye[i], seen[f, k], centroids, f) <= min_cosine:
                return True
    return False


@compiled
def change_spread(
    c, sign, indptr, face, starts, candidates, views, need, step, bonus, kind, weights, count,
    gain, done, total, eyes, centroids, min_cosine, seen, is_spread, eye, covering_eye, far,
):  # fmt: skip
    """Add or remove a candidate as `change` does, where the rays to two cameras must differ.

    Parameters
    ----------
    seen : (F, K) int32
        In and out: rows in `eyes` of the cameras that cover each face, the first `count` of them.
    is_spread : (F,) bool
        In and out: True where the rays to two of these differ by the angle.
    far : (C,) bool
        Scratch.
    """
    work = indptr[c + 1] - indptr[c]
    j = indptr[c]
    while j < indptr[c + 1]:
        first, end, f = j, _run_end(face, j, indptr[c + 1]), face[j]
        j = end
        old, was_spread = count[f], is_spread[f]
        before = _value(old, views[f], was_spread, need[f], step[f], bonus[f])
        was_done = min(old, views[f]) + was_spread >= need[f]
        # What each candidate had with the cameras so far.
        if not was_done:
            i = starts[f]
            while i < starts[f + 1]:
                stop = _run_end(candidates, i, starts[f + 1])
                far[candidates[i]] = _differ(
                    covering_eye, i, stop, eyes, centroids, f, min_cosine
                ) or _is_far(covering_eye, i, stop, seen, old, eyes, centroids, f, min_cosine)
                i = stop
        if sign > 0:
            is_spread[f] = (
                was_spread
                or _differ(eye, first, end, eyes, centroids, f, min_cosine)
                or _is_far(eye, first, end, seen, old, eyes, centroids, f, min_cosine)
            )
            for k in range(first, end):
                seen[f, old + k - first] = eye[k]
        else:
            n = old
            for k in range(first, end):
                at = 0
                while seen[f, at] != eye[k]:
                    at += 1
                n -= 1
                for later in range(at, n):
                    seen[f, later] = seen[f, later + 1]
            if was_spread:
                is_spread[f] = _differ(seen[f], 0, n, eyes, centroids, f, min_cosine)
        new = old + sign * (end - first)
        count[f] = new
        here = _value(new, views[f], is_spread[f], need[f], step[f], bonus[f])
        is_done = min(new, views[f]) + is_spread[f] >= need[f]
        if was_done and is_done:
            continue
        total[0] += here - before
        if was_done != is_done:
            done[kind[f]] += sign * weights[f]
        work += (starts[f + 1] - starts[f]) * (max(old, new) + 1)
        i = starts[f]
        while i < starts[f + 1]:
            other = candidates[i]
            stop = _run_end(candidates, i, starts[f + 1])
            n = stop - i
            own = _differ(covering_eye, i, stop, eyes, centroids, f, min_cosine)
            is_far = own or _is_far(
                covering_eye, i, stop, seen, new, eyes, centroids, f, min_cosine
            )
            after = _value(new + n, views[f], is_spread[f] or is_far, need[f], step[f], bonus[f])
            was = before
            if not was_done:
                was = _value(
                    old + n, views[f], was_spread or far[other], need[f], step[f], bonus[f]
                )
            gain[other, kind[f]] += (after - here) - (was - before)
            i = stop
    return work


@compiled
def missing_directions(
    starts, candidates, covering_eye, is_chosen, views, eyes, centroids, min_cosine
):  # fmt: skip
    """Candidates of which a face needs one, where all chosen cameras see it from one direction.

    As `placement_selection.missing_directions`: all candidates that cover the face, except a
    maximal set around the chosen ones, of whose cameras no two rays differ by the angle. A
    candidate with two such rays of its own is in no such set.
    """
    n_faces = len(starts) - 1
    ends = np.zeros(n_faces + 1, np.int64)
    found = np.empty(len(candidates), np.int32)
    close = np.empty(len(candidates), np.int32)
    is_in = np.zeros(len(is_chosen), np.bool_)
    n_found = 0
    for f in range(n_faces):
        n = 0
        i = starts[f]
        is_open = True
        while i < starts[f + 1]:
            stop = _run_end(candidates, i, starts[f + 1])
            is_in[candidates[i]] = is_chosen[candidates[i]]
            if is_chosen[candidates[i]]:
                if _differ(covering_eye, i, stop, eyes, centroids, f, min_cosine) or _near_far(
                    covering_eye, i, stop, close, n, eyes, centroids, f, min_cosine
                ):
                    is_open = False
                for k in range(i, stop):
                    close[n] = covering_eye[k]
                    n += 1
            i = stop
        if is_open and n >= views[f]:
            for adds in (True, False):
                i = starts[f]
                while i < starts[f + 1]:
                    c, stop = candidates[i], _run_end(candidates, i, starts[f + 1])
                    if adds and not is_in[c]:
                        is_in[c] = not (
                            _differ(covering_eye, i, stop, eyes, centroids, f, min_cosine)
                            or _near_far(
                                covering_eye, i, stop, close, n, eyes, centroids, f, min_cosine
                            )
                        )
                        if is_in[c]:
                            for k in range(i, stop):
                                close[n] = covering_eye[k]
                                n += 1
                    elif not adds and not is_in[c]:
                        found[n_found] = c
                        n_found += 1
                    i = stop
        ends[f + 1] = n_found
    return ends, found


@compiled
def _near_far(eye, first, last, close, n, eyes, centroids, f, min_cosine):
    """`_is_far` with the others in one row, whatever the face."""
    for i in range(first, last):
        for k in range(n):
            if ray_cosine(eyes, eye[i], close[k], centroids, f) <= min_cosine:
                return True
    return False
