"""Products, quotients and roots of polynomials with intervals as coefficients; compiled by numba.

For `expansions`: rows are powers of t, columns are lines, of which `LANES` at a time stay in the
cache. An interval is a centre and a radius `off`. Results have the intervals of all choices from
those of the arguments.
"""

from rastercov.kernels.jit import allocation_free

LANES = 256


@allocation_free
def multiply(one, one_off, two, two_off, out, out_off):
    """Add the product to `out`, (N, L), as far as it has rows."""
    for start in range(0, out.shape[1], LANES):
        lanes = slice(start, min(start + LANES, out.shape[1]))
        for i in range(one.shape[0]):
            a, a_off = one[i, lanes], one_off[i, lanes]
            for j in range(min(two.shape[0], out.shape[0] - i)):
                b, b_off = two[j, lanes], two_off[j, lanes]
                c, c_off = out[i + j, lanes], out_off[i + j, lanes]
                for k in range(c.shape[0]):
                    c[k] += a[k] * b[k]
                    c_off[k] += abs(a[k]) * b_off[k] + a_off[k] * (abs(b[k]) + b_off[k])


@allocation_free
def invert(one, one_off, out, out_off):
    """Fill `out`, (N, L), with 1 / one; the first row is known, and the others are 0.

    q b = 1, from the lowest term on.
    """
    for start in range(0, out.shape[1], LANES):
        lanes = slice(start, min(start + LANES, out.shape[1]))
        first, first_off = out[0, lanes], out_off[0, lanes]
        for n in range(1, out.shape[0]):
            c, c_off = out[n, lanes], out_off[n, lanes]
            for i in range(1, min(n, one.shape[0] - 1) + 1):
                a, a_off = one[i, lanes], one_off[i, lanes]
                b, b_off = out[n - i, lanes], out_off[n - i, lanes]
                for k in range(c.shape[0]):
                    c[k] -= a[k] * b[k]
                    c_off[k] += abs(a[k]) * b_off[k] + a_off[k] * (abs(b[k]) + b_off[k])
            _scale(c, c_off, first, first_off)


@allocation_free
def take_root(inverse, inverse_off, out, out_off):
    """Take the root of `out`, (N, L), in place; its first row is that of the root.

    s s = a, from the lowest term on; `inverse`, (L,), is 1 / (2 s_0).
    """
    for start in range(0, out.shape[1], LANES):
        lanes = slice(start, min(start + LANES, out.shape[1]))
        for n in range(1, out.shape[0]):
            c, c_off = out[n, lanes], out_off[n, lanes]
            for i in range(1, n):
                a, a_off = out[i, lanes], out_off[i, lanes]
                b, b_off = out[n - i, lanes], out_off[n - i, lanes]
                for k in range(c.shape[0]):
                    c[k] -= a[k] * b[k]
                    c_off[k] += abs(a[k]) * b_off[k] + a_off[k] * (abs(b[k]) + b_off[k])
            _scale(c, c_off, inverse[lanes], inverse_off[lanes])


@allocation_free
def _scale(c, c_off, factor, factor_off):
    """Multiply intervals in place."""
    for k in range(c.shape[0]):
        c_off[k] = c_off[k] * (abs(factor[k]) + factor_off[k]) + abs(c[k]) * factor_off[k]
        c[k] *= factor[k]
