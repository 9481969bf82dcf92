"""Compiled lenses: pixels, derivatives and rays of one ray or pixel, and loops over many.

`project(code, p, X, Y, Z)` and `jacobian` allocate nothing and may be called from any loop. They do
not look at the valid region; `is_valid` does.

Derivatives come from the same equations by a complex step, which is exact to rounding: with an
imaginary part of 1e-100 the imaginary part of a result is the derivative. [W. Squire, G. Trapp.
Using complex variables to estimate derivatives of real functions. 1998]
"""

import math

from rastercov.kernels import lens_formulas
from rastercov.kernels.jit import allocation_free, compiled, part_of, part_with_arrays
from rastercov.kernels.lens_formulas import (
    CX,
    CY,
    EQUIRECT,
    FX,
    FY,
    LATE,
    LIMIT,
    P1,
    P2,
    S1,
    S2,
    S3,
    S4,
    SKEW,
    SLOPE,
    T00,
    T10,
    T11,
    T20,
    T21,
    T22,
)

SECTORS = 128
"""Sides of the polygon that replaces the disc of the valid region."""
STEP = 1e-100
"""Imaginary part of a complex step: its square is lost in any sum."""
NEWTON_STEPS = 40
CONTINUATIONS = 32
BEYOND_REL = 1e-6
"""Margin of `reach_of`: more than `_newton` allows beyond LIMIT, and than rounding."""
ROUNDING = 1e-11
"""Residual of Newton's method, of the length of its target, that further steps need not lessen."""


@part_of
def _angle_over_r(r2, z):
    r = math.sqrt(r2)
    if r < 1e-4 * z:  # atan(t) / t = 1 - t^2 / 3 + t^4 / 5, t = r / z
        t = r2 / (z * z)
        return (1.0 - t / 3.0 + t * t / 5.0) / z
    return math.atan2(r, z) / r if r > 0 else math.inf


@part_of
def _sqrt_step(z):
    root = math.sqrt(z.real)
    return complex(root, 0.5 * z.imag / root if root > 0.0 else 0.0)


@part_of
def _atan2_step(y, x):
    square = x.real * x.real + y.real * y.real
    slope = (x.real * y.imag - y.real * x.imag) / square
    return complex(math.atan2(y.real, x.real), slope)


@part_of
def _angle_over_r_step(r2, z):
    # With g = theta / r: dg/d(r2) = (z / n2 - g) / (2 r2), dg/dz = -1 / n2, n2 = r2 + z^2.
    real = max(r2.real, 0.0)  # on the axis it is -STEP^2
    square = real + z.real * z.real
    g = _angle_over_r(real, z.real)
    t = real / (z.real * z.real)
    if t < 1e-8 and z.real > 0.0:
        cubed = z.real * z.real * z.real
        by_r2 = (-1.0 / 3.0 + 0.4 * t) / cubed
    else:
        by_r2 = (z.real / square - g) / (2.0 * real)
    return complex(g, by_r2 * r2.imag - z.imag / square)


_REAL = {"sqrt": math.sqrt, "atan2": math.atan2, "angle_over_r": _angle_over_r}
_STEP = {"sqrt": _sqrt_step, "atan2": _atan2_step, "angle_over_r": _angle_over_r_step}
_equations = lens_formulas.bound_to(_REAL, part_with_arrays)
radial_factor, project, based = (_equations[name] for name in ("radial_factor", "project", "based"))
_steps = lens_formulas.bound_to(_STEP, part_with_arrays)
_radial_factor_step, _distorted_step = _steps["radial_factor"], _steps["distorted"]
_project_step = _steps["project"]


@part_with_arrays
def distortion_slopes(p, x, y):
    """Distorted point and its derivatives: (a, b, da/dx, da/dy, db/dx, db/dy)."""
    ax, bx = _distorted_step(p, complex(x, STEP), complex(y, 0.0))
    ay, by = _distorted_step(p, complex(x, 0.0), complex(y, STEP))
    return ax.real, bx.real, ax.imag / STEP, ay.imag / STEP, bx.imag / STEP, by.imag / STEP


@part_with_arrays
def is_radial(p):
    """True where the distortion has no tangential and no prism term."""
    plain = p[P1] == 0.0 and p[P2] == 0.0 and p[S1] == 0.0 and p[S2] == 0.0
    return plain and p[S3] == 0.0 and p[S4] == 0.0


@part_with_arrays
def reach_of(p, top):
    """Radius that nothing within LIMIT is moved beyond, `top` that of radial distortion alone."""
    m = top if p[LATE] != 0.0 else p[LIMIT]
    tangential = 4.0 * (abs(p[P1]) + abs(p[P2])) + abs(p[S1]) + abs(p[S3])
    return (top + m * m * (tangential + m * m * (abs(p[S2]) + abs(p[S4])))) * (1.0 + BEYOND_REL)


@allocation_free
def undo_radial(p, size):
    """Radius that radial distortion moves to `size`, on the branch that rises from 0; else NaN."""
    low, high = 0.0, p[LIMIT]
    top = high * radial_factor(p, high * high)
    if not size <= top:
        # Rounding of the last digits at the very limit.
        return high if size <= top * (1.0 + 4e-16) else math.nan
    r = min(size, high)
    for _ in range(200):
        moved = complex(r, STEP)
        moved = moved * _radial_factor_step(p, moved * moved)
        value = moved.real - size
        if value > 0.0:
            high = r
        else:
            low = r
        following = r - value / (moved.imag / STEP)
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - r) <= 1e-16 * r or value == 0.0:
            return r if value == 0.0 else following
        r = following
    return r


@allocation_free
def _newton(p, a, b, x, y):
    """Newton's method with halved steps: (x, y, True) where it converges within the limit."""
    limit2 = p[LIMIT] * p[LIMIT] * (1.0 + 1e-9)
    size = abs(a) + abs(b)
    fa, fb, xa, ya, xb, yb = distortion_slopes(p, x, y)
    left = math.hypot(a - fa, b - fb)
    for _ in range(NEWTON_STEPS):
        det = xa * yb - ya * xb
        da, db = a - fa, b - fb
        dx, dy = (yb * da - ya * db) / det, (xa * db - xb * da) / det
        scale = 1.0
        is_better = False
        for _ in range(20):
            x1, y1 = x + scale * dx, y + scale * dy
            fa, fb, xa, ya, xb, yb = distortion_slopes(p, x1, y1)
            following = math.hypot(a - fa, b - fb)
            if following < left and x1 * x1 + y1 * y1 <= 4.0 * limit2:
                is_better = True
                break
            scale *= 0.5
        if not is_better:  # rounding is reached, or there is no way down
            return x, y, left <= ROUNDING * size < math.inf and x * x + y * y <= limit2
        x, y, left = x1, y1, following
        if left == 0.0:
            break
    return x, y, left <= ROUNDING * size < math.inf and x * x + y * y <= limit2


@allocation_free
def undo_distortion(p, a, b):
    """Point (x, y) within LIMIT of the axis that `distorted` moves to (a, b); else NaN.

    Radial distortion by bracketed Newton steps; tangential terms by Newton's method from there, and
    where that leaves the region, along the way from the axis to (a, b). The distortion is injective
    within LIMIT, so the answer is the only one.
    """
    size = math.hypot(a, b)
    if size == 0.0:
        return 0.0 * a, 0.0 * b
    if is_radial(p):
        ratio = undo_radial(p, size) / size
        return a * ratio, b * ratio
    top = p[LIMIT] * radial_factor(p, p[LIMIT] * p[LIMIT])
    if size > reach_of(p, top):  # Newton's method would take long to find nothing
        return math.nan, math.nan
    ratio = undo_radial(p, min(size, top)) / size
    x, y, is_good = _newton(p, a, b, a * ratio, b * ratio)
    if not is_good:
        x, y = 0.0, 0.0
        for k in range(1, CONTINUATIONS + 1):
            part = k / CONTINUATIONS
            x, y, is_good = _newton(p, part * a, part * b, x, y)
            if not is_good:
                return math.nan, math.nan
    return x, y


@part_with_arrays
def jacobian(code, p, X, Y, Z):
    """Derivatives of the pixel by the ray, (u_X, u_Y, u_Z, v_X, v_Y, v_Z)."""
    ux, vx = _project_step(code, p, complex(X, STEP), complex(Y, 0.0), complex(Z, 0.0))
    uy, vy = _project_step(code, p, complex(X, 0.0), complex(Y, STEP), complex(Z, 0.0))
    uz, vz = _project_step(code, p, complex(X, 0.0), complex(Y, 0.0), complex(Z, STEP))
    return (
        *(ux.imag / STEP, uy.imag / STEP, uz.imag / STEP),
        *(vx.imag / STEP, vy.imag / STEP, vz.imag / STEP),
    )


@allocation_free
def plane_slopes(code, p, frame, x, y):
    """Derivatives of the pixel by the place (x, y) in a plane, (u_x, u_y, v_x, v_y)."""
    u_x = u_y = v_x = v_y = 0.0
    # In a loop the equations are compiled once: they are long, and linked into each caller.
    for axis in range(2):
        u, v = _project_step(
            code, p,
            complex(frame[0, 0] * x + frame[0, 1] * y + frame[0, 2], STEP * frame[0, axis]),
            complex(frame[1, 0] * x + frame[1, 1] * y + frame[1, 2], STEP * frame[1, axis]),
            complex(frame[2, 0] * x + frame[2, 1] * y + frame[2, 2], STEP * frame[2, axis]),
        )  # fmt: skip
        u_x, u_y = u_y, u.imag / STEP
        v_x, v_y = v_y, v.imag / STEP
    return u_x, u_y, v_x, v_y


@part_with_arrays
def is_valid(p, X, Y, Z):
    """True for a ray of the valid region, a cone with `SECTORS` flat sides around the z axis.

    m is the greatest product of (X, Y) with the normals of the sides. Where SLOPE > 0, the cone
    m <= SLOPE Z is valid; where SLOPE <= 0, all but the cone m < SLOPE Z around -z.
    """
    r = math.hypot(X, Y)
    if not (r < math.inf and abs(Z) < math.inf):
        return False
    border = p[SLOPE] * Z
    lowest = r * math.cos(math.pi / SECTORS)
    if p[SLOPE] > 0.0:
        if not lowest <= border or not Z > 0.0:
            return False
        if r <= border:
            return True
    else:
        if not r >= border or (r == 0.0 and Z == 0.0):
            return False
        if lowest >= border:
            return True
    turn = math.atan2(Y, X) * (SECTORS / (2.0 * math.pi))
    m = r * math.cos((turn - math.floor(turn) - 0.5) * (2.0 * math.pi / SECTORS))
    return m <= border if p[SLOPE] > 0.0 else m >= border


@part_with_arrays
def sensor_point(p, u, v):
    """Distorted point (a, b) of a pixel, before the tilt; NaN beyond the horizon of the tilt."""
    b = (v - p[CY]) / p[FY]
    a = (u - p[CX] - p[SKEW] * b) / p[FX]
    if p[T20] != 0.0 or p[T21] != 0.0:
        # a = T00 a0 w, b = (T10 a0 + T11 b0) w, 1/w = T20 a0 + T21 b0 + T22: a0 = x/h, b0 = y/h.
        x = a / p[T00]
        y = (b - p[T10] * x) / p[T11]
        h = 1.0 - p[T20] * x - p[T21] * y
        if not h > 0.0:
            return math.nan, math.nan
        return p[T22] * x / h, p[T22] * y / h
    return a, b


ray_of = lens_formulas.bound_to({"math": math}, part_with_arrays, (lens_formulas.ray_of,))["ray_of"]


@part_with_arrays
def unproject(code, p, u, v):
    """Ray of unit length that a pixel sees, NaN where no ray of the valid region meets it."""
    a, b = sensor_point(p, u, v)
    if code == EQUIRECT:
        # Pixels of the image alone; beyond it the same rays would come again.
        is_in = abs(a) <= math.pi * (1.0 + 1e-15) and abs(b) <= 0.5 * math.pi * (1.0 + 1e-15)
        if not is_in:
            return math.nan, math.nan, math.nan
        return math.sin(a) * math.cos(b), math.sin(b), math.cos(a) * math.cos(b)
    x, y = undo_distortion(p, a, b)
    X, Y, Z = ray_of(code, p, x, y)
    if not is_valid(p, X, Y, Z):
        return math.nan, math.nan, math.nan
    return X, Y, Z


@compiled
def project_many(code, p, rays, out):
    """Pixels (N, 2) of rays (N, 3), NaN outside the valid region."""
    for i in range(rays.shape[0]):
        X, Y, Z = rays[i, 0], rays[i, 1], rays[i, 2]
        if is_valid(p, X, Y, Z):
            out[i, 0], out[i, 1] = project(code, p, X, Y, Z)
        else:
            out[i, 0], out[i, 1] = math.nan, math.nan


@compiled
def jacobian_many(code, p, rays, out):
    """Derivatives (N, 2, 3) of pixels by rays (N, 3), NaN outside the valid region."""
    for i in range(rays.shape[0]):
        X, Y, Z = rays[i, 0], rays[i, 1], rays[i, 2]
        out[i] = math.nan
        if is_valid(p, X, Y, Z):
            d = jacobian(code, p, X, Y, Z)
            out[i, 0, 0], out[i, 0, 1], out[i, 0, 2] = d[0], d[1], d[2]
            out[i, 1, 0], out[i, 1, 1], out[i, 1, 2] = d[3], d[4], d[5]


@compiled
def unproject_many(code, p, pixels, out):
    """Rays (N, 3) of unit length of pixels (N, 2), NaN where there is none."""
    for i in range(pixels.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = unproject(code, p, pixels[i, 0], pixels[i, 1])


@compiled
def base_points(p, pixels, out):
    """Points (N, 2) of the plane of the base of pixels (N, 2), NaN where there is none."""
    for i in range(pixels.shape[0]):
        a, b = sensor_point(p, pixels[i, 0], pixels[i, 1])
        out[i, 0], out[i, 1] = undo_distortion(p, a, b)


@compiled
def rays_of(code, p, points, out):
    """Rays (N, 3) of unit length of points (N, 2) of the plane of the base."""
    for i in range(points.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = ray_of(code, p, points[i, 0], points[i, 1])
