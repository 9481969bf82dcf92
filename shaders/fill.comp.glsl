// Fills a tile of a pose in shared memory, a workgroup a tile, and counts the samples of each face;
// with KEYS it writes the image instead.
//
// The nearest face at a sample, the lowest index of equally near ones, is the maximum of a 64-bit
// key: the float 1/z, then the complement of index + 1. With 32-bit atomics (no ATOMIC64) the lists
// are drawn twice: pass 0 finds the depth, pass 1 the face among those at that depth. A maximum does
// not depend on the order of its operands, so neither does the image.
//
// An invocation fills a small triangle by itself, and 32 of them a larger one. (Mesa's llvmpipe
// silently ends the loops of an invocation after 65,535 iterations; none here is as long.)
//
// Twin: rastercov/engine/raster/cover.hpp, depth.hpp.
// J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988.

#ifdef ATOMIC64
#extension GL_NV_shader_atomic_int64 : require
#endif
#include "triangle.glsl"

layout(local_size_x = GROUP) in;

layout(std430, binding = 5) readonly buffer Lists { uint lists[]; };
#ifdef KEYS
layout(std430, binding = 6) writeonly buffer Image { uvec2 image[]; };  // ~(index + 1) or 0, 1/z
uniform ivec2 image_corner;  // its first sample of the canvas
uniform int image_width;
#else
layout(std430, binding = 6) buffer Counts { uint counts[]; };
#endif
#ifdef ROLLED
layout(std430, binding = 7) readonly buffer Runs { ivec2 runs[]; };  // of each row inside the image
#endif

uniform uint first_view;
uniform uvec2 first_group;  // pose of the batch, row of tiles
uniform uint stride;        // counters a pose: slot 0 is background, then one a face
uniform uint first_drawn;   // counters of faces alone, behind those of visible samples
uniform bool with_drawn;

const int BAND = 32;        // invocations that fill a larger triangle, 8 x 4 samples at a time
const int IN_32_BITS = 64;  // samples across a triangle up to which 32 bits hold edge functions

#ifdef ATOMIC64
shared uint64_t keys[TILE * TILE];
#else
shared uint depths[TILE * TILE], owners[TILE * TILE];
uint which_pass = 0u;
#endif
#ifdef ROLLED
shared ivec2 tile_runs[TILE];
#endif
shared uint queue[GROUP];
shared uint n_queued;

ivec2 tile_corner, limit;  // from the corner of the part; samples of the tile in use

void keep_nearest(int at, float depth, uint face) {
    uint bits = floatBitsToUint(depth);  // same order as the floats, since none is negative
#ifdef ATOMIC64
    uint64_t key = packUint2x32(uvec2(~face, bits));
    if (keys[at] < key) atomicMax(keys[at], key);
#else
    if (which_pass == 0u) atomicMax(depths[at], bits);
    else if (depths[at] == bits) atomicMax(owners[at], ~face);
#endif
}

uint owner_at(int at) {
#ifdef ATOMIC64
    return unpackUint2x32(keys[at]).x;
#else
    return owners[at];
#endif
}

// Samples of a row of the tile inside the image.
ivec2 run_of(int y) {
#ifdef ROLLED
    return tile_runs[y];
#else
    return ivec2(0, limit.x);
#endif
}

// 1 where samples on an edge lie outside.
int tie(ivec2 a, ivec2 b) {
    return b.y < a.y || (b.y == a.y && b.x > a.x) ? 0 : 1;
}

// 1/z at a sample of the canvas. Sums that are not a number are the least of the corners.
float depth_at(Triangle t, ivec2 at) {
    ivec2 block = at & ~3, within = at & 3;
    precise double start = t.origin + t.down * double(block.y) + t.right * double(block.x);
    precise float depth =
        float(start) + (float(t.right) * float(within.x) + float(t.down) * float(within.y));
    depth = depth > t.least ? depth : t.least;
    return depth < t.greatest ? depth : t.greatest;
}

// Fills every stride_-th sample of every stride_-th row of a triangle in the tile, from the first,
// by edge functions of type N at a sample, and their steps; returns how many it covers.
#define FILL(NAME, N, N2)                                                                        \
    uint NAME(Triangle t, ivec2 low, ivec2 high, ivec2 first, ivec2 stride_) {                   \
        ivec2 at = low + first, origin = tile_corner + corner;                                   \
        N2 a = N2(t.a - origin * 256), b = N2(t.b - origin * 256), c = N2(t.c - origin * 256);   \
        N2 ab = b - a, bc = c - b, ca = a - c, p = N2(at * 256 + HALF), by = N2(stride_ * 256);  \
        N e0 = ab.x * (p.y - a.y) - ab.y * (p.x - a.x) - N(tie(t.a, t.b));                       \
        N e1 = bc.x * (p.y - b.y) - bc.y * (p.x - b.x) - N(tie(t.b, t.c));                       \
        N e2 = ca.x * (p.y - c.y) - ca.y * (p.x - c.x) - N(tie(t.c, t.a));                       \
        bool is_drawn = (t.view & HIDDEN) == 0u;                                                 \
        uint covered = 0u;                                                                       \
        for (int y = at.y; y < high.y; y += stride_.y) {                                         \
            N f0 = e0, f1 = e1, f2 = e2;                                                         \
            ivec2 run = run_of(y);                                                               \
            for (int x = at.x; x < high.x; x += stride_.x) {                                     \
                if ((f0 | f1 | f2) >= N(0) && x >= run.x && x < run.y) {                         \
                    ++covered;                                                                   \
                    if (is_drawn) keep_nearest(y * TILE + x, depth_at(t, origin + ivec2(x, y)), t.face); \
                }                                                                                \
                f0 -= ab.y * by.x;                                                               \
                f1 -= bc.y * by.x;                                                               \
                f2 -= ca.y * by.x;                                                               \
            }                                                                                    \
            e0 += ab.x * by.y;                                                                   \
            e1 += bc.x * by.y;                                                                   \
            e2 += ca.x * by.y;                                                                   \
        }                                                                                        \
        return covered;                                                                          \
    }
FILL(fill_32, int, ivec2)
FILL(fill_64, int64_t, i64vec2)

bool fits_32_bits(Triangle t) {
    ivec2 extent = max(t.a, max(t.b, t.c)) - min(t.a, min(t.b, t.c));
    return max(extent.x, extent.y) <= IN_32_BITS * 256;
}

void add(uint counter, uint n) {
#ifndef KEYS
    if (n > 0u) atomicAdd(counts[counter], n);
#endif
}

void add_drawn(Triangle t, uint covered) {
#ifndef ATOMIC64
    if (which_pass > 0u) return;
#endif
    if (with_drawn) add(first_drawn + (t.view & ~HIDDEN) * stride + t.face, covered);
}

// Fills the triangles of a list.
void fill_all(uint start, uint end) {
    uint me = gl_LocalInvocationIndex;
    for (uint first = start; first < end; first += GROUP) {
        if (me == 0u) n_queued = 0u;
        barrier();
        if (first + me < end) {
            uint slot = lists[first + me];
            Triangle t = triangles[slot];
            ivec2 low = max(first_sample(t) - tile_corner, 0);
            ivec2 high = min(end_of_samples(t) - tile_corner, limit);
            ivec2 extent = max(high - low, 0);
            if (extent.x * extent.y > SMALL || !fits_32_bits(t))
                queue[atomicAdd(n_queued, 1u)] = slot;
            else if (extent.x * extent.y > 0)
                add_drawn(t, fill_32(t, low, high, ivec2(0), ivec2(1)));
        }
        barrier();
        ivec2 own = ivec2(int(me) & 7, (int(me) >> 3) & 3);
        for (uint i = me / uint(BAND); i < n_queued; i += uint(GROUP / BAND)) {
            Triangle t = triangles[queue[i]];
            ivec2 low = max(first_sample(t) - tile_corner, 0);
            ivec2 high = min(end_of_samples(t) - tile_corner, limit);
            add_drawn(t, fits_32_bits(t) ? fill_32(t, low, high, own, ivec2(8, 4))
                                         : fill_64(t, low, high, own, ivec2(8, 4)));
        }
        barrier();
    }
}

// Adds runs of equal faces down the columns of the tile to the counters of a pose.
void count_tile(uint view) {
    const int RUN = TILE * TILE / GROUP;
    int me = int(gl_LocalInvocationIndex), x = me % TILE, y = me / TILE * RUN;
    uint current = 0u, n = 0u;
    for (int end = min(y + RUN, limit.y); y < end; ++y) {
        ivec2 run = run_of(y);
        if (x < run.x || x >= run.y) continue;
        uint owner = owner_at(y * TILE + x);
        uint face = owner == 0u ? 0u : ~owner;
        if (face != current) {
            add(view * stride + current, n);
            current = face;
            n = 0u;
        }
        ++n;
    }
    add(view * stride + current, n);
}

// Adds the samples of a tile without triangles to the background.
void count_empty(uint counter) {
    int me = int(gl_LocalInvocationIndex);
    if (me == 0) n_queued = 0u;
    barrier();
    for (int y = me; y < limit.y; y += GROUP) {
        ivec2 run = run_of(y);
        atomicAdd(n_queued, uint(max(run.y - run.x, 0)));
    }
    barrier();
    if (me == 0) add(counter, n_queued);
}

void write_tile() {
#ifdef KEYS
    for (int i = int(gl_LocalInvocationIndex); i < TILE * TILE; i += GROUP) {
        ivec2 at = ivec2(i % TILE, i / TILE);
        if (any(greaterThanEqual(at, limit))) continue;
        ivec2 to = tile_corner + at + corner - image_corner;
#ifdef ATOMIC64
        image[to.y * image_width + to.x] = unpackUint2x32(keys[i]);
#else
        image[to.y * image_width + to.x] = uvec2(owners[i], depths[i]);
#endif
    }
#endif
}

void main() {
    uvec3 tile = gl_WorkGroupID + uvec3(0u, first_group.yx);
    uint list = (tile.z * uint(tiles.y) + tile.y) * uint(tiles.x) + tile.x;
    uint end = ends[list], start = end - lengths[list];
    tile_corner = TILE * ivec2(tile.xy);
    limit = min(ivec2(TILE), size - tile_corner);
#ifdef ROLLED
    for (int y = int(gl_LocalInvocationIndex); y < limit.y; y += GROUP) {
        ivec2 run = runs[tile_corner.y + y + corner.y] - corner.x - tile_corner.x;
        tile_runs[y] = ivec2(max(run.x, 0), min(run.y, limit.x));
    }
    barrier();
#endif
#ifndef KEYS
    if (start == end) {
        count_empty((first_view + tile.z) * stride);
        return;
    }
#endif
    for (int i = int(gl_LocalInvocationIndex); i < TILE * TILE; i += GROUP) {
#ifdef ATOMIC64
        keys[i] = 0ul;
#else
        depths[i] = 0u;
        owners[i] = 0u;
#endif
    }
    barrier();
#ifdef ATOMIC64
    fill_all(start, end);
#else
    for (which_pass = 0u; which_pass < 2u; ++which_pass) fill_all(start, end);
#endif
    count_tile(first_view + tile.z);
    write_tile();
}
