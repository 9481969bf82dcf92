// Fills triangles into depth and triangle IDs without the graphics pipeline, for a batch of poses:
// most units of a data-centre GPU can only compute.
//
// Without QUEUED, an invocation takes one face of one pose (z), projects it, clips faces that reach
// behind the camera or far outside the image, and fills small triangles by itself; pieces of larger
// ones go to a queue. With QUEUED, a workgroup takes pieces from the queue, 8 x 8 samples at a time.
// A queue that overflows reports it, and the draw is repeated with fewer faces at a time. (An
// invocation does not fill a large triangle by itself because it would take a GPU long, and because
// Mesa's llvmpipe silently ends the loops of an invocation after 65,535 iterations.)
//
// The arithmetic is that of the CPU rasteriser: corners are projected in double precision and
// rounded to 1/256 sample; edge crossings are computed in integers, exact in doubles up to 2^53, so a
// sample on an edge belongs to exactly one of the two triangles; 1/z is affine in the image, rounded
// to a float.
//
// `precise` is used wherever two triangles, two programs or two passes must compute the same bits.
//
// J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988. S. Laine, T. Karras.
// High-Performance Software Rasterization on GPUs. 2011.

#ifdef ATOMIC64
#extension GL_ARB_gpu_shader_int64 : require
#extension GL_NV_shader_atomic_int64 : require
#endif

struct Pose {
    dvec4 right, down, forward;  // camera axes; right and down mixed to rotate the sample grid
    dvec4 eye;                   // camera centre, relative to the centre of the mesh
    dvec4 lens;                  // fx, fy, cx, cy in samples
    double near;
    double cull;                 // nonzero if back faces can be left out
};

// Range of rows of a triangle. Corners are in steps of 1/256 sample from the corner of the tile.
struct Piece {
    ivec2 a, b, c;               // from top to bottom
    int top, bottom;             // first row and one after the last, from the top of the tile
    uint face, pose;             // face index + 1, pose index in the batch
    float least, greatest;       // 1/z of the corners; both 0 for a piece that is counted but not drawn
    double origin, right, down;  // 1/z = origin + right x + down y at sample (x, y) of the canvas
};

// The nearest face at a sample, the lowest index of equally near ones, is the maximum of a 64-bit
// key: the float 1/z, then the complement of index + 1. With 32-bit atomics (no ATOMIC64) the scene
// is drawn twice: pass 0 finds the depth, pass 1 the face among those at that depth. A maximum does
// not depend on the order of its operands, so neither does the image.

layout(local_size_x = 64) in;

layout(std430, binding = 0) buffer Counts { uint counts[]; };
#ifdef ATOMIC64
layout(std430, binding = 2) buffer Keys { uint64_t keys[]; };
#else
layout(std430, binding = 2) buffer Keys { uint keys[]; };  // two a sample: ~(index + 1), 1/z
#endif
layout(std430, binding = 3) coherent buffer Queue {
    uint groups_x, groups_y, groups_z;  // workgroups of the QUEUED dispatch
    uint n_pieces;
    uint is_full;                       // 1 after an overflow
    Piece pieces[];
};
layout(std430, binding = 5) readonly buffer Vertices { double vertices[]; };
layout(std430, binding = 6) readonly buffer Faces { uint faces[]; };

uniform ivec2 size;           // samples of the tile
uniform ivec2 corner;         // top-left of the tile on the canvas
uniform bool with_drawn;      // count the samples that each face covers alone
uniform uint capacity;        // pieces that the queue holds
uniform uint stride;          // counters a pose: slot 0 is background, then one a face
uniform uvec2 faces_to_draw;  // first, and one after the last
uniform uint first_view;      // of those to draw
#ifndef ATOMIC64
uniform uint which_pass;
#endif

// Corner of a face, relative to an eye, along three axes.
dvec3 in_axes(uint corner_of_face, dvec3 right, dvec3 down, dvec3 forward, dvec3 eye) {
    uint v = 3u * faces[corner_of_face];
    precise double x = vertices[v] - eye.x;
    precise double y = vertices[v + 1u] - eye.y;
    precise double z = vertices[v + 2u] - eye.z;
    precise double to_right = x * right.x + y * right.y + z * right.z;
    precise double to_down = x * down.x + y * down.y + z * down.z;
    precise double ahead = x * forward.x + y * forward.y + z * forward.z;
    return dvec3(to_right, to_down, ahead);
}

void keep_nearest(uint sample_, float depth, uint face) {
    uint bits = floatBitsToUint(depth);  // same order as the floats, since none is negative
#ifdef ATOMIC64
    atomicMax(keys[sample_], packUint2x32(uvec2(~face, bits)));
#else
    if (which_pass == 0u) {
        atomicMax(keys[2u * sample_ + 1u], bits);
    } else if (keys[2u * sample_ + 1u] == bits) {
        atomicMax(keys[2u * sample_], ~face);
    }
#endif
}

// First of n free slots of the queue; `capacity` where there are fewer, which it reports.
uint take_slots(uint n) {
    // Nothing is added to a full queue, so the number of pieces cannot overflow.
    uint end = n_pieces < capacity ? atomicAdd(n_pieces, n) + n : capacity + 1u;
    if (end > capacity) {
        is_full = 1u;
        return capacity;
    }
    atomicMax(groups_x, min(end, 65535u));
    return end - n;
}

layout(std430, binding = 1) readonly buffer Runs { ivec2 runs[]; };  // of each row inside the image

const int HALF = 128;
const double STEPS = 256.0lf;
const double NO_PLANE = 1e300lf;

// Crossing of an edge from a down to b with rows: floor((base + slope row) / divisor) is the first
// sample on the edge or right of it, ceil((X - 128) / 256) with X the crossing in steps.
struct Edge {
    double base, slope, divisor, inverse;
};

Edge edge(ivec2 a, ivec2 b) {
    double ahead = double(b.x - a.x), down = double(b.y - a.y);
    Edge e;
    e.slope = ahead * STEPS;
    e.divisor = down * STEPS;
    e.inverse = 1.0lf / e.divisor;
    e.base = double(a.x - HALF) * down + ahead * double(HALF - a.y) + (e.divisor - 1.0lf);
    return e;
}

int crossing(Edge e, int row) {
    double numerator = e.base + e.slope * double(row);
    double quotient = floor(numerator * e.inverse);  // exact to within 1, corrected by the remainder
    double rest = numerator - quotient * e.divisor;
    return int(quotient) + (rest < 0.0lf ? -1 : rest >= e.divisor ? 1 : 0);
}

// Fills every stride-th sample of every stride-th row of a piece, from the first; returns the number
// of samples inside the image in these rows.
uint fill(Piece p, ivec2 first, ivec2 stride_) {
    Edge whole = edge(p.a, p.c), upper = edge(p.a, p.b), lower = edge(p.b, p.c);
    bool whole_is_left = double(p.b.x - p.a.x) * double(p.c.y - p.a.y)
                       > double(p.c.x - p.a.x) * double(p.b.y - p.a.y);
    int middle = (p.b.y + HALF - 1) >> 8;
    uint covered = 0u;
    for (int row = p.top + first.y; row < p.bottom; row += stride_.y) {
        Edge turn = lower;
        if (row < middle) turn = upper;
        int here = crossing(whole, row), there = crossing(turn, row);
        ivec2 run = runs[row + corner.y] - corner.x;
        int begin = max(whole_is_left ? here : there, max(run.x, 0));
        int end = min(whole_is_left ? there : here, min(run.y, size.x));
        covered += uint(max(end - begin, 0));
        if (p.greatest == 0.0) continue;
        precise double start = p.origin + p.down * double(row + corner.y);
        uint row_start = (p.pose * uint(size.y) + uint(row)) * uint(size.x);
        for (int x = begin + first.x; x < end; x += stride_.x) {
            precise double depth = start + p.right * double(x + corner.x);
            // A sample can lie beyond the corners by rounding; its depth must not.
            keep_nearest(row_start + uint(x), clamp(float(depth), p.least, p.greatest), p.face);
        }
    }
    return covered;
}

void count(Piece p, uint covered) {
    if (with_drawn && covered > 0u) {
        atomicAdd(counts[p.pose * stride + p.face], covered);
    }
}

#ifdef QUEUED

void main() {
    ivec2 first = ivec2(gl_LocalInvocationIndex & 7u, gl_LocalInvocationIndex >> 3u);
    uint n = is_full == 0u ? n_pieces : 0u;
    for (uint i = gl_WorkGroupID.x; i < n; i += gl_NumWorkGroups.x) {
        Piece p = pieces[i];
        uint covered = fill(p, first, ivec2(8));
        if (first.x == 0) count(p, covered);
    }
}

#else

layout(std430, binding = 4) readonly buffer Poses { Pose poses[]; };
// Position in steps from the corner of the canvas, and 1/z.
dvec3 in_image(Pose pose, dvec3 p) {
    precise double w = 1.0lf / p.z;
    precise double u = (pose.lens.x * p.x * w + pose.lens.z) * STEPS;
    precise double v = (pose.lens.y * p.y * w + pose.lens.w) * STEPS;
    return dvec3(u, v, w);
}

bool is_whole(Pose pose, dvec3 in_space, dvec3 at) {
    dvec2 from = abs(at.xy - STEPS * dvec2(corner));
    return in_space.z >= pose.near && max(from.x, from.y) <= double(FAR_OUT);
}

// Corner of a polygon, as bits: NVIDIA's compiler (driver 580) keeps an array of doubles that a loop
// indexes in the precision of floats.
struct Corner {
    uvec2 x, y, z;
};

Corner bits_of(dvec3 p) {
    return Corner(unpackDouble2x32(p.x), unpackDouble2x32(p.y), unpackDouble2x32(p.z));
}

dvec3 numbers_of(Corner p) {
    return dvec3(packDouble2x32(p.x), packDouble2x32(p.y), packDouble2x32(p.z));
}

// Clips a convex polygon to plane . p >= offset; returns its corner count. A cut is computed from
// the corner inside towards the one outside, so two faces cut their common edge at the same point.
int clip(inout Corner polygon[8], int n, dvec3 plane, double offset) {
    Corner kept[8];
    int n_kept = 0;
    for (int i = 0; i < n && n_kept < 8; ++i) {
        dvec3 p = numbers_of(polygon[i]), q = numbers_of(polygon[i + 1 < n ? i + 1 : 0]);
        precise double here = plane.x * p.x + plane.y * p.y + plane.z * p.z - offset;
        precise double there = plane.x * q.x + plane.y * q.y + plane.z * q.z - offset;
        if (here >= 0.0lf) kept[n_kept++] = polygon[i];
        if ((here >= 0.0lf) != (there >= 0.0lf) && n_kept < 8) {
            bool is_leaving = here >= 0.0lf;
            dvec3 from = is_leaving ? p : q, to = is_leaving ? q : p;
            double inside = is_leaving ? here : there, beyond = is_leaving ? there : here;
            precise double t = inside / (inside - beyond);
            precise dvec3 cut = from + t * (to - from);
            kept[n_kept++] = bits_of(cut);
        }
    }
    polygon = kept;
    return n_kept;
}

void swap_if_lower(inout ivec2 a, inout ivec2 b) {
    if (b.y < a.y) {
        ivec2 other = a;
        a = b;
        b = other;
    }
}

void enqueue(Piece p) {
    uint n = uint(p.bottom - p.top + ROWS - 1) / uint(ROWS);
    uint first = take_slots(n);
    int bottom = p.bottom;
    for (uint slot = first; slot < min(first + n, capacity); ++slot) {
        p.bottom = min(p.top + ROWS, bottom);
        pieces[slot] = p;
        p.top = p.bottom;
    }
}

// Plane of 1/z of a face from its corners in space: change a sample to the right, change a sample
// down, and value at the centre of the first sample of the canvas. Used for clipped faces: their
// corners at the near plane can be far nearer than the part in view, and a plane through them would
// lose half of its digits.
dvec3 plane_in_image(Pose pose, dvec3 a, dvec3 b, dvec3 c) {
    dvec3 to_b = b - a, to_c = c - a;
    precise dvec3 normal = to_b.yzx * to_c.zxy - to_b.zxy * to_c.yzx;
    precise double height = normal.x * a.x + normal.y * a.y + normal.z * a.z;
    precise double right = normal.x / (height * pose.lens.x);
    precise double down = normal.y / (height * pose.lens.y);
    precise double origin =
        normal.z / height + right * (0.5lf - pose.lens.z) + down * (0.5lf - pose.lens.w);
    return dvec3(right, down, origin);
}

// Draws one triangle. `plane` is the plane of 1/z of a clipped face, else NO_PLANE.
void draw(dvec3 a, dvec3 b, dvec3 c, uint face, uint pose, bool can_cull, dvec3 plane) {
    dvec2 ra = floor(a.xy + 0.5lf), rb = floor(b.xy + 0.5lf), rc = floor(c.xy + 0.5lf);
    dvec2 ab = rb - ra, ac = rc - ra;
    double rounded = ab.x * ac.y - ac.x * ab.y;
    bool is_back = can_cull && rounded > 0.0lf;
#ifdef ATOMIC64
    bool is_wanted = with_drawn || !is_back;
#else
    bool is_wanted = (with_drawn && which_pass == 0u) || !is_back;
#endif
    if (rounded == 0.0lf || !is_wanted) return;

    Piece p;
    p.a = ivec2(ra) - 256 * corner;
    p.b = ivec2(rb) - 256 * corner;
    p.c = ivec2(rc) - 256 * corner;
    ivec2 low = min(p.a, min(p.b, p.c)), high = max(p.a, max(p.b, p.c));
    low = max((low + HALF - 1) >> 8, 0);  // first sample
    high = min((high + HALF - 1) >> 8, size);  // one after the last
    if (low.x >= high.x || low.y >= high.y) return;
    swap_if_lower(p.a, p.b);
    swap_if_lower(p.a, p.c);
    swap_if_lower(p.b, p.c);
    p.top = low.y;
    p.bottom = high.y;
    p.face = face;
    p.pose = pose;

    // Plane of 1/z from the unrounded corners; from the rounded ones if the triangle is too thin.
    dvec2 from = a.xy, ab_here = b.xy - a.xy, ac_here = c.xy - a.xy;
    double area = ab_here.x * ac_here.y - ac_here.x * ab_here.y;
    bool is_thin = abs(area - rounded) > 0.25lf * abs(rounded);
    if (is_thin) {
        from = ra;
        ab_here = ab;
        ac_here = ac;
        area = rounded;
    }
    double w_ab = b.z - a.z, w_ac = c.z - a.z;
    precise double right = (w_ab * ac_here.y - w_ac * ab_here.y) * (STEPS / area);
    precise double down = (w_ac * ab_here.x - w_ab * ac_here.x) * (STEPS / area);
    precise double origin =
        a.z + (right * (double(HALF) - from.x) + down * (double(HALF) - from.y)) / STEPS;
    if (!is_thin && all(lessThan(abs(plane), dvec3(NO_PLANE)))) {
        right = plane.x;
        down = plane.y;
        origin = plane.z;
    }
    p.right = right;
    p.down = down;
    p.origin = origin;
    p.least = is_back ? 0.0 : float(min(a.z, min(b.z, c.z)));
    p.greatest = is_back ? 0.0 : float(max(a.z, max(b.z, c.z)));

    if ((high.x - low.x) * (high.y - low.y) > SMALL) {
        enqueue(p);
    } else {
        count(p, fill(p, ivec2(0), ivec2(1)));
    }
}

void main() {
    uint face = faces_to_draw.x + gl_GlobalInvocationID.x;
    if (face >= faces_to_draw.y) return;
    uint view = first_view + gl_GlobalInvocationID.z;
    Pose pose = poses[view];
    dvec3 right = pose.right.xyz, down = pose.down.xyz, forward = pose.forward.xyz;
    dvec3 a = in_axes(3u * face, right, down, forward, pose.eye.xyz);
    dvec3 b = in_axes(3u * face + 1u, right, down, forward, pose.eye.xyz);
    dvec3 c = in_axes(3u * face + 2u, right, down, forward, pose.eye.xyz);
    dvec3 at_a = in_image(pose, a), at_b = in_image(pose, b), at_c = in_image(pose, c);
    bool can_cull = pose.cull != 0.0lf;
    if (is_whole(pose, a, at_a) && is_whole(pose, b, at_b) && is_whole(pose, c, at_c)) {
        draw(at_a, at_b, at_c, face + 1u, view, can_cull, dvec3(NO_PLANE));
        return;
    }
    dvec3 plane = plane_in_image(pose, a, b, c);
    Corner polygon[8];
    polygon[0] = bits_of(a);
    polygon[1] = bits_of(b);
    polygon[2] = bits_of(c);
    int n = clip(polygon, 3, dvec3(0.0lf, 0.0lf, 1.0lf), pose.near);
    // |u|, |v| <= reach from the corner of the tile, as +-(f x + c z) <= reach z.
    double reach = 0.99lf * double(FAR_OUT) / STEPS;
    dvec2 middle = pose.lens.zw - dvec2(corner);
    for (int border = 0; border < 4; ++border) {
        double side = (border & 1) == 0 ? 1.0lf : -1.0lf;
        dvec3 limit = border < 2 ? dvec3(side * pose.lens.x, 0.0lf, side * middle.x + reach)
                                 : dvec3(0.0lf, side * pose.lens.y, side * middle.y + reach);
        n = clip(polygon, n, limit, 0.0lf);
    }
    at_a = in_image(pose, numbers_of(polygon[0]));
    for (int i = 1; i + 1 < n; ++i) {
        at_b = in_image(pose, numbers_of(polygon[i]));
        at_c = in_image(pose, numbers_of(polygon[i + 1]));
        draw(at_a, at_b, at_c, face + 1u, view, can_cull, plane);
    }
}

#endif
