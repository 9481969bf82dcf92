// Sets up the triangles of a batch of poses: an invocation takes a face of a pose, projects it, clips
// what reaches behind the camera or far outside the image, and keeps what may cover a sample.
//
// Twin: rastercov/engine/raster/vertices.hpp, clipping.hpp, setup.hpp.

#include "triangle.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 5) readonly buffer Poses { dvec4 poses[]; };  // rows, see ROWS
layout(std430, binding = 6) readonly buffer Vertices { double vertices[]; };
layout(std430, binding = 7) readonly buffer Faces { uvec4 faces[]; };  // by cluster: corners, index
struct Cluster {
    dvec4 sphere;                    // centre, radius
    dvec4 cone;                      // of normals: axis, cosine
    double sine, offset, altitude;   // of the cone; of the planes; the least of a face
    uint first, end;                 // of its faces
};
layout(std430, binding = 4) readonly buffer Clusters { Cluster clusters[]; };

uniform uint first_cluster, first_view;
uniform bool with_backs;      // keep back faces, to be counted
uniform bool is_parallel;
uniform dvec3 middle;         // of the mesh, which vertices are relative to
uniform dvec4 lens;           // fx, fy, cx, cy in samples
uniform dvec4 turn;           // right and down of the grid from those of the camera

struct Pose {
    dvec3 right, down, forward;  // camera axes; right and down mixed to rotate the sample grid
    dvec3 eye;                   // camera centre, from the middle of the mesh
    double near, farthest;       // of parallel rays 1/z is `farthest` - z; 0 of a pinhole
    bool can_cull;               // back faces can be left out
};
const uint ROWS = 4u;            // of a pose: world_from_camera, then near, can_cull, farthest

Pose pose_of(uint view) {
    dvec4 x = poses[ROWS * view], y = poses[ROWS * view + 1u], z = poses[ROWS * view + 2u];
    dvec4 limits = poses[ROWS * view + 3u];
    dvec3 right = dvec3(x.x, y.x, z.x), down = dvec3(x.y, y.y, z.y);
    precise dvec3 eye = dvec3(x.w, y.w, z.w) - middle;
    precise dvec3 across = turn.x * right + turn.y * down;
    precise dvec3 along = turn.z * right + turn.w * down;
    return Pose(across, along, dvec3(x.z, y.z, z.z), eye, limits.x, limits.z, limits.y != 0.0lf);
}

const double STEPS = 256.0lf;
const double GUARD_BAND = 536870912.0lf;  // steps beyond which positions are clipped
const double LARGEST = 1.7976931348623157e308lf;

shared uint n_kept, first_kept;
shared bool is_empty;

// Corner of a face in camera axes.
dvec3 in_camera(uint vertex, Pose pose) {
    uint v = 3u * vertex;
    precise dvec3 p = dvec3(vertices[v], vertices[v + 1u], vertices[v + 2u]) - pose.eye;
    precise double right = p.x * pose.right.x + p.y * pose.right.y + p.z * pose.right.z;
    precise double down = p.x * pose.down.x + p.y * pose.down.y + p.z * pose.down.z;
    precise double ahead = p.x * pose.forward.x + p.y * pose.forward.y + p.z * pose.forward.z;
    return dvec3(right, down, ahead);
}

// Position in steps, not rounded, and 1/z; of parallel rays unless they have been made central.
dvec3 in_image(Pose pose, dvec3 p, bool is_central) {
    precise double w = is_central ? 1.0lf / p.z : pose.farthest - p.z;
    double scale = is_central ? w : 1.0lf;
    precise double u = (lens.x * p.x * scale + lens.z) * STEPS;
    precise double v = (lens.y * p.y * scale + lens.w) * STEPS;
    return dvec3(u, v, w);
}

// A point that a pinhole sees where parallel rays see the given one, with the same 1/z.
dvec3 central(Pose pose, dvec3 p) {
    if (!is_parallel) return p;
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
    precise double right = normal.x / (height * lens.x);
    precise double down = normal.y / (height * lens.y);
    precise double origin =
        normal.z / height + right * (0.5lf - lens.z) + down * (0.5lf - lens.w);
    return dvec3(origin, right, down);
}

// Sets up a triangle; false where it covers nothing. `plane` is that of a face that was clipped.
bool set_up(dvec3 a, dvec3 b, dvec3 c, Pose pose, bool has_plane, dvec3 plane, out Triangle t) {
    dvec2 ra = floor(a.xy + 0.5lf), rb = floor(b.xy + 0.5lf), rc = floor(c.xy + 0.5lf);
    ivec2 ia = ivec2(ra), ib = ivec2(rb), ic = ivec2(rc);
    i64vec2 ab = i64vec2(ib - ia), ac = i64vec2(ic - ia);
    int64_t area = ab.x * ac.y - ac.x * ab.y;
    bool is_back = pose.can_cull && area > 0l;
    if (area == 0l || (is_back && !with_backs)) return false;
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
    precise double near = is_parallel ? 1.0lf / (pose.farthest - pose.near) : pose.near;
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
        precise double depth = side * (border < 2 ? lens.z : lens.w) + reach;
        dvec3 limit = border < 2 ? dvec3(side * lens.x, 0.0lf, depth)
                                 : dvec3(0.0lf, side * lens.y, depth);
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

// True where no face of a cluster can cover a sample of the part, or be in front: its sphere is
// outside, or its faces turn away, also when they are rounded. Those that are cut are kept.
bool is_left_out(Cluster c, Pose pose) {
    dvec3 way = c.sphere.xyz - pose.eye;
    double radius = c.sphere.w, z = dot(way, pose.forward), nearest = z - radius;
    if (z + radius < pose.near) return true;
    for (int border = 0; border < 4; ++border) {
        bool is_first = (border & 1) == 0;
        dvec2 rim = lens.zw - dvec2(is_first ? corner : corner + size);
        double side = is_first ? 1.0lf : -1.0lf, depth = side * (border < 2 ? rim.x : rim.y);
        dvec3 normal = side * (border < 2 ? lens.x * pose.right : lens.y * pose.down);
        if (!is_parallel) normal += depth * pose.forward;
        if (dot(normal, way) + radius * length(normal) < (is_parallel ? -depth : 0.0lf)) return true;
    }
    double distance = length(way), reach = distance + radius, over = is_parallel ? 1.0lf : nearest;
    bool is_whole = nearest >= pose.near &&
                    reach * max(lens.x, lens.y) <= over * (GUARD_BAND / STEPS * 0.5lf);
    if (!pose.can_cull || with_backs || !is_whole) return false;
    // The greatest part of a normal towards the camera: of the cone, or of what is in it.
    dvec3 ray = is_parallel ? pose.forward : way;
    double far = is_parallel ? 1.0lf : distance, along = dot(ray, c.cone.xyz);
    double across = sqrt(max(far * far - along * along, 0.0lf));
    double most = -along >= far * c.cone.w ? far : across * c.sine - along * c.cone.w;
    double height = is_parallel ? most : most - c.offset, squared = is_parallel ? 1.0lf : reach * reach;
    return height * c.altitude * (min(lens.x, lens.y) * STEPS) < squared * -3.1lf;
}

void main() {
    Cluster cluster = clusters[first_cluster + gl_WorkGroupID.x];
    uint view = first_view + gl_WorkGroupID.z;
    Pose pose = pose_of(view);
    if (gl_LocalInvocationIndex == 0u) {
        n_kept = 0u;
        is_empty = is_left_out(cluster, pose);
    }
    barrier();
    if (is_empty) return;
    uint slot = cluster.first + gl_LocalInvocationIndex, face = 0u, place = 0u;
    bool is_kept = false;
    Triangle t;
    if (slot < cluster.end) {
        uvec4 corners = faces[slot];
        face = corners.w;
        dvec3 a = in_camera(corners.x, pose);
        dvec3 b = in_camera(corners.y, pose);
        dvec3 c = in_camera(corners.z, pose);
        bool is_central = !is_parallel;
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
