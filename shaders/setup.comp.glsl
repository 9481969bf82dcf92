// Sets up the triangles of a batch of poses: an invocation takes a face of a pose, projects it, clips
// what reaches behind the camera or far outside the image, and keeps what may cover a sample.
//
// Twin: rastercov/engine/raster/vertices.hpp, clipping.hpp, setup.hpp.

#include "triangle.glsl"

layout(local_size_x = 64) in;

struct Pose {
    dvec4 right, down, forward;  // camera axes; right and down mixed to rotate the sample grid
    dvec4 eye;                   // camera centre, relative to the centre of the mesh
    dvec4 lens;                  // fx, fy, cx, cy in samples
    double near;
    double cull;                 // nonzero if back faces can be left out
    double farthest;             // of parallel rays 1/z is `farthest` - z; 0 of a pinhole
    double unused;
    dvec4 given[3];              // world_from_camera
};
layout(std430, binding = 5) readonly buffer Poses { Pose poses[]; };
layout(std430, binding = 6) readonly buffer Vertices { double vertices[]; };
layout(std430, binding = 7) readonly buffer Faces { uint faces[]; };

uniform uvec2 faces_to_draw;  // first, and one after the last
uniform uint first_view;
uniform bool with_drawn;      // keep back faces, to be counted

const double STEPS = 256.0lf;
const double GUARD_BAND = 536870912.0lf;  // steps beyond which positions are clipped
const double LARGEST = 1.7976931348623157e308lf;

shared uint n_kept, first_kept;

// Corner of a face in camera axes.
dvec3 in_camera(uint corner_of_face, Pose pose) {
    uint v = 3u * faces[corner_of_face];
    precise double x = vertices[v] - pose.eye.x;
    precise double y = vertices[v + 1u] - pose.eye.y;
    precise double z = vertices[v + 2u] - pose.eye.z;
    precise double right = x * pose.right.x + y * pose.right.y + z * pose.right.z;
    precise double down = x * pose.down.x + y * pose.down.y + z * pose.down.z;
    precise double ahead = x * pose.forward.x + y * pose.forward.y + z * pose.forward.z;
    return dvec3(right, down, ahead);
}

// Position in steps, not rounded, and 1/z; of parallel rays unless they have been made central.
dvec3 in_image(Pose pose, dvec3 p, bool is_central) {
    precise double w = is_central ? 1.0lf / p.z : pose.farthest - p.z;
    double scale = is_central ? w : 1.0lf;
    precise double u = (pose.lens.x * p.x * scale + pose.lens.z) * STEPS;
    precise double v = (pose.lens.y * p.y * scale + pose.lens.w) * STEPS;
    return dvec3(u, v, w);
}

// A point that a pinhole sees where parallel rays see the given one, with the same 1/z.
dvec3 central(Pose pose, dvec3 p) {
    if (pose.farthest == 0.0lf) return p;
    precise double z = 1.0lf / (pose.farthest - p.z);
    precise double x = p.x * z;
    precise double y = p.y * z;
    return dvec3(x, y, z);
}

bool is_whole(Pose pose, dvec3 in_space, dvec3 at) {
    return in_space.z >= pose.near && max(abs(at.x), abs(at.y)) <= GUARD_BAND;
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
    int n_left = 0;
    for (int i = 0; i < n && n_left < 8; ++i) {
        dvec3 p = numbers_of(polygon[i]), q = numbers_of(polygon[i + 1 < n ? i + 1 : 0]);
        precise double here = plane.x * p.x + plane.y * p.y + plane.z * p.z - offset;
        precise double there = plane.x * q.x + plane.y * q.y + plane.z * q.z - offset;
        if (here >= 0.0lf) kept[n_left++] = polygon[i];
        if ((here >= 0.0lf) != (there >= 0.0lf) && n_left < 8) {
            bool is_leaving = here >= 0.0lf;
            dvec3 from = is_leaving ? p : q, to = is_leaving ? q : p;
            double inside = is_leaving ? here : there, beyond = is_leaving ? there : here;
            precise double t = inside / (inside - beyond);
            precise dvec3 cut = from + t * (to - from);
            kept[n_left++] = bits_of(cut);
        }
    }
    polygon = kept;
    return n_left;
}

// Plane of 1/z of a face from its corners in space: origin, and changes a sample to the right and
// down. Corners at the near plane can be far nearer than the part in view, and a plane through them
// would lose half of its digits.
dvec3 plane_in_image(Pose pose, dvec3 a, dvec3 b, dvec3 c) {
    precise dvec3 to_b = b - a;
    precise dvec3 to_c = c - a;
    precise dvec3 normal = to_b.yzx * to_c.zxy - to_b.zxy * to_c.yzx;
    precise double height = normal.x * a.x + normal.y * a.y + normal.z * a.z;
    precise double right = normal.x / (height * pose.lens.x);
    precise double down = normal.y / (height * pose.lens.y);
    precise double origin =
        normal.z / height + right * (0.5lf - pose.lens.z) + down * (0.5lf - pose.lens.w);
    return dvec3(origin, right, down);
}

// Sets up a triangle; false where it covers nothing. `plane` is that of a face that was clipped.
bool set_up(dvec3 a, dvec3 b, dvec3 c, Pose pose, bool has_plane, dvec3 plane, out Triangle t) {
    dvec2 ra = floor(a.xy + 0.5lf), rb = floor(b.xy + 0.5lf), rc = floor(c.xy + 0.5lf);
    ivec2 ia = ivec2(ra), ib = ivec2(rb), ic = ivec2(rc);
    i64vec2 ab = i64vec2(ib - ia), ac = i64vec2(ic - ia);
    int64_t area = ab.x * ac.y - ac.x * ab.y;
    bool is_back = pose.cull != 0.0lf && area > 0l;
    if (area == 0l || (is_back && !with_drawn)) return false;
    bool is_turned = area < 0l;
    t.a = ia;
    t.b = is_turned ? ic : ib;
    t.c = is_turned ? ib : ic;
    t.view = is_back ? HIDDEN : 0u;
    if (any(greaterThanEqual(first_sample(t), end_of_samples(t)))) return false;

    // From the corners before rounding; from the rounded ones if the triangle is too thin.
    double rounded = double(area);
    dvec2 pa = a.xy, pb = b.xy, pc = c.xy;
    precise double change =
        (pb.x - pa.x) * (pc.y - pa.y) - (pc.x - pa.x) * (pb.y - pa.y) - rounded;
    if (abs(change) > abs(rounded) * 0.25lf) {
        pa = ra;
        pb = rb;
        pc = rc;
    }
    precise dvec2 to_b = pb - pa;
    precise dvec2 to_c = pc - pa;
    precise double w_ab = b.z - a.z;
    precise double w_ac = c.z - a.z;
    precise double scale = STEPS / (to_b.x * to_c.y - to_c.x * to_b.y);
    precise double right = (w_ab * to_c.y - w_ac * to_b.y) * scale;
    precise double down = (w_ac * to_b.x - w_ab * to_c.x) * scale;
    precise double shift = right * (double(HALF) - pa.x) + down * (double(HALF) - pa.y);
    precise double origin = a.z + shift * (1.0lf / STEPS);
    bool is_given = has_plane && all(lessThanEqual(abs(plane), dvec3(LARGEST)));
    t.origin = is_given ? plane.x : origin;
    t.right = is_given ? plane.y : right;
    t.down = is_given ? plane.z : down;
    t.least = float(min(a.z, min(b.z, c.z)));
    t.greatest = float(max(a.z, max(b.z, c.z)));
    return true;
}

void keep(Triangle t, uint slot, uint face, uint view) {
    t.face = face + 1u;
    t.view |= view;
    if (slot < uint(triangles.length())) triangles[slot] = t;
}

// Keeps the triangles of a face that is cut.
void keep_clipped(dvec3 a, dvec3 b, dvec3 c, Pose pose, uint face, uint view) {
    a = central(pose, a);
    b = central(pose, b);
    c = central(pose, c);
    precise double near = pose.farthest > 0.0lf ? 1.0lf / (pose.farthest - pose.near) : pose.near;
    dvec3 plane = plane_in_image(pose, a, b, c);
    Corner polygon[8];
    polygon[0] = bits_of(a);
    polygon[1] = bits_of(b);
    polygon[2] = bits_of(c);
    int n = clip(polygon, 3, dvec3(0.0lf, 0.0lf, 1.0lf), near);
    // |u|, |v| <= reach from the corner of the canvas, as +-(f x + c z) <= reach z.
    double reach = 0.99lf * GUARD_BAND / STEPS;
    for (int border = 0; border < 4; ++border) {
        double side = (border & 1) == 0 ? 1.0lf : -1.0lf;
        precise double depth = side * (border < 2 ? pose.lens.z : pose.lens.w) + reach;
        dvec3 limit = border < 2 ? dvec3(side * pose.lens.x, 0.0lf, depth)
                                 : dvec3(0.0lf, side * pose.lens.y, depth);
        n = clip(polygon, n, limit, 0.0lf);
    }
    dvec3 at_a = in_image(pose, numbers_of(polygon[0]), true);
    Triangle t;
    for (int i = 1; i + 1 < n; ++i) {
        dvec3 at_b = in_image(pose, numbers_of(polygon[i]), true);
        dvec3 at_c = in_image(pose, numbers_of(polygon[i + 1]), true);
        if (set_up(at_a, at_b, at_c, pose, true, plane, t))
            keep(t, atomicAdd(n_triangles, 1u), face, view);
    }
}

void main() {
    if (gl_LocalInvocationIndex == 0u) n_kept = 0u;
    barrier();
    uint face = faces_to_draw.x + gl_GlobalInvocationID.x;
    uint view = first_view + gl_GlobalInvocationID.z;
    bool is_kept = false;
    uint place = 0u;
    Triangle t;
    if (face < faces_to_draw.y) {
        Pose pose = poses[view];
        dvec3 a = in_camera(3u * face, pose);
        dvec3 b = in_camera(3u * face + 1u, pose);
        dvec3 c = in_camera(3u * face + 2u, pose);
        bool is_central = pose.farthest == 0.0lf;
        dvec3 at_a = in_image(pose, a, is_central);
        dvec3 at_b = in_image(pose, b, is_central);
        dvec3 at_c = in_image(pose, c, is_central);
        if (is_whole(pose, a, at_a) && is_whole(pose, b, at_b) && is_whole(pose, c, at_c)) {
            is_kept = set_up(at_a, at_b, at_c, pose, false, dvec3(0.0lf), t);
            if (is_kept) place = atomicAdd(n_kept, 1u);
        } else if (max(a.z, max(b.z, c.z)) >= pose.near) {
            keep_clipped(a, b, c, pose, face, view);
        }
    }
    barrier();
    if (gl_LocalInvocationIndex == 0u && n_kept > 0u) first_kept = atomicAdd(n_triangles, n_kept);
    barrier();
    if (is_kept) keep(t, first_kept + place, face, view);
}
