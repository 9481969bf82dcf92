// Lists the triangles of a batch by pose and tile: counts the entries of each list; then, with
// `writes`, enters them where scan.comp found room.
//
// An invocation lists a triangle over a few tiles; one over more is listed by its workgroup, which
// leaves out the tiles that lie outside an edge.

#include "triangle.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 5) writeonly buffer Lists { uint lists[]; };

uniform uint first_view;
uniform bool writes;

const int FEW = 16;

shared uint queue[64];
shared uint n_queued;

void enter(ivec2 tile, uint view, uint slot) {
    uint list = ((view - first_view) * uint(tiles.y) + uint(tile.y)) * uint(tiles.x) + uint(tile.x);
    if (writes) lists[atomicAdd(ends[list], 1u)] = slot;
    else atomicAdd(lengths[list], 1u);
}

// True if all samples of a tile lie outside the edge from a to b.
bool is_outside(ivec2 tile, ivec2 a, ivec2 b) {
    ivec2 low = (tile * TILE + corner) * 256, high = low + TILE * 256, along = b - a;
    ivec2 best = ivec2(along.y > 0 ? low.x : high.x, along.x > 0 ? high.y : low.y);
    i64vec2 d = i64vec2(along), to = i64vec2(best - a);
    return d.x * to.y - d.y * to.x < 0l;
}

void main() {
    uint me = gl_LocalInvocationIndex, step = 64u * gl_NumWorkGroups.x;
    uint n_kept = min(n_triangles, uint(triangles.length()));
    for (uint first = 64u * gl_WorkGroupID.x; first < n_kept; first += step) {
        if (me == 0u) n_queued = 0u;
        barrier();
        uint slot = first + me;
        if (slot < n_kept) {
            Triangle t = triangles[slot];
            ivec2 low = first_sample(t) / TILE, high = (end_of_samples(t) - 1) / TILE;
            ivec2 n = high - low + 1;
            if (n.x * n.y > FEW) {
                queue[atomicAdd(n_queued, 1u)] = slot;
            } else {
                for (int y = low.y; y <= high.y; ++y)
                    for (int x = low.x; x <= high.x; ++x)
                        enter(ivec2(x, y), t.view & ~HIDDEN, slot);
            }
        }
        barrier();
        uint waiting = n_queued;
        for (uint i = 0u; i < waiting; ++i) {
            Triangle t = triangles[queue[i]];
            ivec2 low = first_sample(t) / TILE, n = (end_of_samples(t) - 1) / TILE - low + 1;
            for (int k = int(me); k < n.x * n.y; k += 64) {
                ivec2 tile = low + ivec2(k % n.x, k / n.x);
                if (!is_outside(tile, t.a, t.b) && !is_outside(tile, t.b, t.c) &&
                    !is_outside(tile, t.c, t.a))
                    enter(tile, t.view & ~HIDDEN, queue[i]);
            }
        }
        barrier();
    }
}
