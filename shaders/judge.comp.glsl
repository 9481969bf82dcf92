// Judges the faces of a batch of poses by the criteria of a task, from their counts: a bit for each
// face that a pose covers, the area of these, and the poses that cover each face.
//
// The arithmetic is that of the engine, operation by operation, so that both give the same bits. A
// face is covered where all its vertices are in the image, so none is cut here.
//
// Twin: rastercov/engine/coverage/criteria.hpp, decision.hpp, face.hpp; camera/camera.hpp.

layout(local_size_x = 64) in;

struct Face {
    double a, b, c;     // unit normal
    uint corners[3];
    uint kind;          // bits of these:
    uvec2 area;         // whole units, 64 bits; 0 where it does not count
};
const uint MAY_BE_COVERED = 1u, IS_TWO_SIDED = 2u;
const uint TOTALS = 3u; // words of a pose behind its bits: area in 64 bits, samples counted

layout(std430, binding = 0) readonly buffer Counts { uint counts[]; };
layout(std430, binding = 1) readonly buffer Faces { Face faces[]; };
layout(std430, binding = 2) readonly buffer Vertices { double vertices[]; };
layout(std430, binding = 3) readonly buffer Poses { dvec4 poses[]; }; // as in setup.comp
layout(std430, binding = 4) buffer Results { uint results[]; };
layout(std430, binding = 5) buffer Seen { uint n_views[]; };

uniform uint n_faces, n_groups;      // bits of a pose are in two words a group
uniform uint first_drawn;            // counter
uniform double scale;                // samples of a pixel
uniform dvec2 focal, centre, size;   // pixels
uniform bool is_parallel;
// Of rastercov.core.coverage.task.Rules, without tan_incidence, which regions need:
uniform double min_pixels, min_visibility, min_coverage, min_pixel_density, min_facing_density,
    min_pixels_per_m2, z_n, z_f, max_incidence, cos_incidence;
uniform bool focus_of_centroid, cap_resolution;

const double COSINE_ROUNDING = 1e-14lf, LARGEST_RESOLUTION = 1e300lf;
const double HALF_PI = 1.5707963267948966lf, PI = 3.141592653589793lf;

shared uint bits[2], low, high, n_samples;

struct Corner {
    dvec3 at;     // camera axes, metres
    dvec2 slope;  // x/z, y/z
    dvec2 image;  // pixels
    bool is_inside;
};
const uint ROWS = 4u, LIMITS = 3u;  // of a pose, of which the first are world_from_camera

// b where one is not a number.
double least(double a, double b) { return a < b ? a : b; }
double most(double a, double b) { return a > b ? a : b; }

dvec3 turn(dvec3 way, uint row) {
    precise dvec3 turned =
        way.x * poses[row].xyz + way.y * poses[row + 1u].xyz + way.z * poses[row + 2u].xyz;
    return turned;
}

Corner project(uint vertex, uint row, double near) {
    uint v = 3u * vertex;
    precise dvec3 way = dvec3(vertices[v], vertices[v + 1u], vertices[v + 2u]) -
                        dvec3(poses[row].w, poses[row + 1u].w, poses[row + 2u].w);
    dvec3 at = turn(way, row);
    bool is_ahead = at.z >= near;
    precise dvec2 slope = at.xy / (is_ahead ? at.z : 1.0lf);
    precise dvec2 image = (is_parallel ? at.xy : slope) * focal + centre;
    bool is_inside = is_ahead && all(greaterThanEqual(image, dvec2(0.0lf))) &&
                     all(lessThanEqual(image, size));
    return Corner(at, slope, image, is_inside);
}

// Angle of incidence, radians, as incidence_angle of criteria.hpp.
double incidence_angle(double cosine) {
    double magnitude = least(1.0lf, abs(cosine));
    bool is_small = magnitude <= 0.5lf;
    precise double x = is_small ? magnitude * magnitude : 0.5lf * (1.0lf - magnitude);
    precise double s = is_small ? magnitude : sqrt(x);
    precise double series = 0.028757851367421566lf;
    series = -0.014851887071247204lf + x * series;
    series = 0.01740087944269402lf + x * series;
    series = 0.005457506718640358lf + x * series;
    series = 0.01032281435018578lf + x * series;
    series = 0.011479177415184906lf + x * series;
    series = 0.013971212973552933lf + x * series;
    series = 0.017352392720869973lf + x * series;
    series = 0.02237217294214989lf + x * series;
    series = 0.030381944138531247lf + x * series;
    series = 0.04464285714635543lf + x * series;
    series = 0.07499999999998433lf + x * series;
    series = 0.16666666666666669lf + x * series;
    precise double angle = s + s * (x * series);
    precise double arcsine = cosine < 0.0lf ? -angle : angle;
    precise double of_small = HALF_PI - arcsine;
    precise double of_large = (cosine >= 0.0lf ? 0.0lf : PI) + 2.0lf * arcsine;
    return is_small ? of_small : of_large;
}

bool exceeds_incidence(double cosine) {
    precise double gap = cosine - cos_incidence;
    if (abs(gap) < COSINE_ROUNDING) return !(incidence_angle(cosine) <= max_incidence);
    return cosine < cos_incidence;
}

// Pixels a metre along the worst direction of a surface with a normal, at a corner.
double along(Corner p, dvec3 n) {
    double way = (unpackDouble2x32(n.z).y >> 31) == 0u ? 1.0lf : -1.0lf;
    precise double d = 1.0lf / -(way + n.z);
    precise double e = n.x * n.y * d;
    precise dvec3 first = dvec3(way * n.x * n.x * d + 1.0lf, way * e, -way * n.x);
    precise dvec3 second = dvec3(e, way + n.y * n.y * d, -n.y);
    precise dvec2 a = (first.xy - p.slope * first.z) * focal;
    precise dvec2 b = (second.xy - p.slope * second.z) * focal;
    precise double total = a.x * a.x + b.x * b.x + a.y * a.y + b.y * b.y;
    precise double det = abs(a.x * b.y - b.x * a.y);
    precise double gap = total * total - (det * det) * 4.0lf;
    precise double best = sqrt((total + sqrt(most(gap, 0.0lf))) / 2.0lf);
    precise double result = det / (best * p.at.z);
    return result;
}

double per_m2(Corner p, dvec3 n) {
    precise double result = abs(n.x * p.slope.x + n.y * p.slope.y + n.z) / p.at.z * focal.x /
                            p.at.z * focal.y;
    return result;
}

// True where the densities at a corner are at least those that the task asks for.
bool is_dense(Corner p, dvec3 n) {
    precise double facing = least(focal.x, focal.y) / p.at.z;
    return (min_pixel_density == 0.0lf || along(p, n) >= min_pixel_density) &&
           (min_facing_density == 0.0lf || facing >= min_facing_density) &&
           (min_pixels_per_m2 == 0.0lf || per_m2(p, n) >= min_pixels_per_m2);
}

// Without area in the image a face has no density along it.
bool has_area(dvec2 a, dvec2 b, dvec2 c) {
    precise dvec2 ab = b - a;
    precise dvec2 bc = c - b;
    precise double area = ab.x * bc.y - ab.y * bc.x;
    return abs(area) / 2.0lf > 0.0lf;
}

bool is_focused(double a, double b, double c) {
    if (focus_of_centroid) {
        precise double centre = (a + b + c) / 3.0lf;
        return z_n <= centre && centre <= z_f;
    }
    return z_n <= least(least(a, b), c) && most(most(a, b), c) <= z_f;
}

// Cosine of the angle of incidence at the centroid.
double incidence(Corner p, Corner q, Corner r, dvec3 n, bool is_two_sided) {
    precise double cosine = -n.z;
    if (!is_parallel) {
        precise dvec3 sums = p.at + q.at + r.at;
        precise double against = -(n.x * sums.x + n.y * sums.y + n.z * sums.z);
        precise double reach = sqrt(sums.x * sums.x + sums.y * sums.y + sums.z * sums.z);
        precise double quotient = against / reach;
        cosine = reach > 0.0lf ? quotient : 0.0lf;
    }
    return is_two_sided ? abs(cosine) : cosine;
}

bool falls_short(double value) { return value < min_coverage || value == 0.0lf; }

bool covers(Face face, uint view, uint n_visible, uint n_drawn) {
    if ((face.kind & MAY_BE_COVERED) == 0u || n_drawn == 0u) return false;
    uint row = ROWS * view;
    double near = poses[row + LIMITS].x;
    Corner p = project(face.corners[0], row, near);
    Corner q = project(face.corners[1], row, near);
    Corner r = project(face.corners[2], row, near);
    if (!(p.is_inside && q.is_inside && r.is_inside)) return false;
    dvec3 normal = turn(dvec3(face.a, face.b, face.c), row);
    double cosine = incidence(p, q, r, normal, (face.kind & IS_TWO_SIDED) != 0u);
    if (!(cosine > 0.0lf) || exceeds_incidence(cosine)) return false;
    if (!is_focused(p.at.z, q.at.z, r.at.z)) return false;
    if (!(is_dense(p, normal) && is_dense(q, normal) && is_dense(r, normal))) return false;
    if (min_pixel_density > 0.0lf && !has_area(p.image, q.image, r.image)) return false;
    precise double visible = double(n_visible) / scale;
    precise double drawn = double(n_drawn) / scale;
    precise double visibility = visible / drawn;
    precise double resolution = drawn / min_pixels;
    resolution = least(resolution, LARGEST_RESOLUTION);
    if (cap_resolution) resolution = least(resolution, 1.0lf);
    if (falls_short(resolution) || !(visibility >= min_visibility)) return false;
    precise double coverage = resolution * visibility;
    return !falls_short(coverage);
}

// Adds a number of 64 bits to one in two words, in any order.
void add_long(uint at, uvec2 sum) {
    uint before = atomicAdd(results[at], sum.x);
    atomicAdd(results[at + 1u], sum.y + (before + sum.x < before ? 1u : 0u));
}

void main() {
    uint me = gl_LocalInvocationIndex, view = gl_WorkGroupID.z;
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x, face = 64u * group + me;
    if (me < 2u) bits[me] = 0u;
    if (me == 0u) low = high = n_samples = 0u;
    barrier();
    if (face < n_faces) {
        uint counter = view * (n_faces + 1u) + face + 1u, n = counts[counter];
        if (n > 0u && covers(faces[face], view, n, counts[first_drawn + counter])) {
            atomicOr(bits[me >> 5], 1u << (me & 31u));
            // Of 64 areas below 2^44 both halves fit 32 bits.
            uvec2 area = faces[face].area;
            atomicAdd(low, area.x & 0x3fffffu);
            atomicAdd(high, area.y << 10 | area.x >> 22);
            atomicAdd(n_views[face], 1u);
        }
        atomicAdd(n_samples, n + (face == 0u ? counts[counter - 1u] : 0u));
    }
    barrier();
    if (group >= n_groups) return;
    uint start = view * (2u * n_groups + TOTALS), totals = start + 2u * n_groups;
    if (me < 2u) results[start + 2u * group + me] = bits[me];
    if (me == 0u) {
        add_long(totals, uvec2(high << 22, high >> 10));
        add_long(totals, uvec2(low, 0u));
        atomicAdd(results[totals + 2u], n_samples);
    }
}
