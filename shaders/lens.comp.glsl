// Draws faces on samples at any places of the ideal planes of a lens, for a batch of poses.
//
// A view is a pose and an ideal plane: its samples are those that the plane sees, in blocks of 8 x 8,
// each at the place of the plane whose ray it sees. Without QUEUED, an invocation takes one face in
// one view (z), finds in a grid of cells over the plane which samples the face may cover, and fills a
// face of few samples by itself; larger ones go to a queue, set up, in runs of blocks. With QUEUED, a
// workgroup takes pieces from the queue: first each invocation tests a block against the edges, then
// all of them fill the blocks that are met, a sample each. With TARGETS nothing is drawn: samples are
// counted that the faces cover, and those of them that no surface is in front of.
//
// The arithmetic is that of the CPU (`raster/cpu/lens_*.py`). An edge is a plane through the eye, and
// 1/z is affine in x and y: no face is clipped. A sample is tested in float32 from the middle of its
// block; where rounding could decide, in doubles from the corners of the face, each rounded once for
// all of its edges, so that a sample on an edge or at a corner belongs to exactly one face. How
// samples are found and shared out therefore changes no result.
//
// `precise` is used wherever two faces, two programs or two passes must compute the same bits.
//
// M. Olano, T. Greer. Triangle Scan Conversion using 2D Homogeneous Coordinates. 1997.

#ifdef ATOMIC64
#extension GL_ARB_gpu_shader_int64 : require
#extension GL_NV_shader_atomic_int64 : require
#endif

struct View {
    dvec4 right, down, forward;  // axes of the plane in the world
    dvec4 eye;                   // camera centre, relative to the centre of the mesh
    dvec2 low, high;             // box of all samples of the plane
    double near;
    double cull;                 // nonzero if back faces can be left out
    double cells_a_unit;         // cells of the first level in a unit of the plane
    double farthest;             // 1 + |x| + |y| at most, of any sample
    double half_side;            // largest distance in x or y of a sample from the middle of its block
    uint pose;                   // in the batch
    uint first_block;
    ivec2 origin;                // first sample of the first block, in the tile
    int columns;                 // blocks in a row
    int first_cell;
    ivec2 cells;                 // columns and rows of cells of the first level
};

// A face in a view, set up. Edges are scaled so that their doubt is 1.
struct Face {
    dvec3 p;                // corners in axes of the plane
    double side;            // sign of the inner side of the edges
    dvec3 q, r;
    dvec3 edge[3];          // planes (a, b, c) through the eye and p q, q r, r p
    dvec3 inverse;          // 1/z = inverse . (x, y, 1)
    float behind, cut;      // 1/z must be above `behind` and not above `cut`
    float least, greatest;  // 1/z at the corners
    uint name;              // index + 1
    uint flags;             // bits of OWNS: samples on an edge are inside; IS_DRAWN
};

struct Piece {
    Face face;
    ivec2 from, to;   // first and last sample that the face may cover, from the origin of the view
    int begin, end;   // blocks of that rectangle, row by row
    uint view;
};

struct Block {
    dvec2 middle;     // place in the plane
    vec2 reach;       // largest distances of a sample from it; negative for a block without samples
    vec2 unused;
    vec4 tiles[4];    // of 4 x 4 samples: middle of their box, from that of the block, and its reach
    vec2 places[64];  // of the samples from the middle; NO_PLACE or more for none
};

#include "filling.glsl"

layout(std430, binding = 1) readonly buffer Cells { ivec4 cells[]; };
layout(std430, binding = 4) readonly buffer Views { View views[]; };
layout(std430, binding = 7) readonly buffer Blocks { Block blocks[]; };

#ifdef TARGETS
uniform uint first_seen;  // counter of the samples of the first face that nothing is in front of
#endif

const float NO_PLACE = 1e30;
const float ANY_DEPTH = 3e38;  // 1/z is smaller, see MOST_SLOPE
const double LARGEST = 1.7976931348623157e308lf;
// Bounds of rounding, as in `lens_kernels.py`.
const double DOUBT_REL = 1e-14lf, DOUBT32_REL = 1e-6lf, ROUNDING_REL = 1e-14lf;
const double LEAST_DOUBT = 1e-30lf, MOST_SLOPE = 1e30lf, SLACK = 1e-7lf;
const double TIE = 1.0lf + 1.0lf / 1048576.0lf;  // as in `target_kernels.py`
const float BLOCK_MARGIN = 2.0;  // doubts of an edge; 1.3 is enough for rounding of a block's test

const uint OWNS[3] = uint[](1u, 2u, 4u), IS_DRAWN = 8u;  // without it a face is only counted

// Changes of the three edges and of 1/z with x and y.
struct Slopes {
    vec4 across, down;
};

Slopes slopes_of(Face f) {
    return Slopes(
        vec4(f.edge[0].x, f.edge[1].x, f.edge[2].x, f.inverse.x),
        vec4(f.edge[0].y, f.edge[1].y, f.edge[2].y, f.inverse.y));
}

// The three edges and 1/z in the middle of a block.
vec4 in_middle(Face f, dvec2 middle) {
    precise double pq = f.edge[0].x * middle.x + f.edge[0].y * middle.y + f.edge[0].z;
    precise double qr = f.edge[1].x * middle.x + f.edge[1].y * middle.y + f.edge[1].z;
    precise double rp = f.edge[2].x * middle.x + f.edge[2].y * middle.y + f.edge[2].z;
    precise double w = f.inverse.x * middle.x + f.inverse.y * middle.y + f.inverse.z;
    return vec4(pq, qr, rp, w);
}

// False where no sample of a block or tile is inside a face, `value` being its edges in the middle.
bool meets(Slopes slopes, vec4 value, vec2 reach) {
    if (reach.x < 0.0) return false;
    vec3 most = value.xyz + abs(slopes.across.xyz) * reach.x + abs(slopes.down.xyz) * reach.y;
    return all(greaterThanEqual(most, vec3(-BLOCK_MARGIN)));
}

// Whether a place is inside a face, without contradiction between faces: (p x q) . (x, y, 1) is the
// product of the vectors from the place to p and to q. Where all three vectors point the same way, as
// from a place beside a face that is as thin as rounding, the signs of their products mean nothing.
bool is_inside(Face f, dvec2 at) {
    precise dvec2 p = f.p.xy - at * f.p.z, q = f.q.xy - at * f.q.z, r = f.r.xy - at * f.r.z;
    dvec2 low = min(p, min(q, r)), high = max(p, max(q, r));
    if (max(low.x, low.y) > 0.0lf || min(high.x, high.y) < 0.0lf) return false;
    precise double pq = (p.x * q.y - p.y * q.x) * f.side;
    precise double qr = (q.x * r.y - q.y * r.x) * f.side;
    precise double rp = (r.x * p.y - r.y * p.x) * f.side;
    return (pq > 0.0lf || (pq == 0.0lf && (f.flags & OWNS[0]) != 0u))
        && (qr > 0.0lf || (qr == 0.0lf && (f.flags & OWNS[1]) != 0u))
        && (rp > 0.0lf || (rp == 0.0lf && (f.flags & OWNS[2]) != 0u));
}

// Draws a face on a sample of a block, `value` being `in_middle`. Returns 1 if it covers the sample,
// and with TARGETS another 1 if nothing is in front of it.
uvec2 draw_sample(Face f, Slopes slopes, uint block, vec4 value, uint of_block, uint sample_) {
    vec2 at = blocks[block].places[of_block];
    if (!(at.x < NO_PLACE)) return uvec2(0u);
    precise vec4 here = slopes.across * at.x + slopes.down * at.y + value;
    float least = min(here.x, min(here.y, here.z));
    if (!(least >= -1.0 && here.w > f.behind && here.w <= f.cut)) return uvec2(0u);
    if (!(least > 1.0)) {
        precise dvec2 place = dvec2(at) + blocks[block].middle;
        if (!is_inside(f, place)) return uvec2(0u);
    }
    // A sample can lie beyond the corners by rounding; its depth must not.
    float w = min(max(here.w, f.least), f.greatest);
#ifdef TARGETS
#ifdef ATOMIC64
    uint bits = unpackUint2x32(keys[sample_]).y;
#else
    uint bits = keys[2u * sample_ + 1u];
#endif
    return uvec2(1u, double(w) * TIE >= double(uintBitsToFloat(bits)) ? 1u : 0u);
#else
    if ((f.flags & IS_DRAWN) != 0u) keep_nearest(sample_, w, f.name);
    return uvec2(1u, 0u);
#endif
}

// First sample of a row of a view, in `keys`.
uint row_of(View view, int row) {
    return (view.pose * uint(size.y) + uint(view.origin.y + row)) * uint(size.x) + uint(view.origin.x);
}

// Adds the samples of a face, covered and seen, to its counters.
void count(View view, uint name, uvec2 found) {
    uint counter = view.pose * stride + name - first_face;
#ifdef TARGETS
    if (found.y > 0u) atomicAdd(counts[first_seen + counter], found.y);
    if (found.x > 0u) atomicAdd(counts[counter], found.x);
#else
    if (with_drawn && found.x > 0u) atomicAdd(counts[counter], found.x);
#endif
}

#ifdef QUEUED

shared uint n_met;
shared uint met[64];    // blocks of the rectangle that the face may cover
shared vec4 value[64];  // edges and 1/z in their middles
shared uint total[2];

void main() {
    uint lane = gl_LocalInvocationIndex;
    ivec2 of_block = ivec2(lane & 7u, lane >> 3u);
    uint n = is_full == 0u ? n_pieces : 0u;
    for (uint i = gl_WorkGroupID.x; i < n; i += gl_NumWorkGroups.x) {
        Piece piece = pieces[i];
        Face f = piece.face;
        Slopes slopes = slopes_of(f);
        View view = views[piece.view];
        ivec2 first_block = piece.from >> 3;
        int columns = (piece.to.x >> 3) - first_block.x + 1;
        if (lane < 2u) total[lane] = 0u;
        uvec2 found = uvec2(0u);
        for (int first = piece.begin; first < piece.end; first += 64) {
            if (lane == 0u) n_met = 0u;
            barrier();
            int at = first + int(lane);
            if (at < piece.end) {
                ivec2 place = first_block + ivec2(at % columns, at / columns);
                uint block = view.first_block + uint(place.y * view.columns + place.x);
                vec4 here = in_middle(f, blocks[block].middle);
                if (meets(slopes, here, blocks[block].reach)) {
                    uint slot = atomicAdd(n_met, 1u);
                    met[slot] = uint(at);
                    value[slot] = here;
                }
            }
            barrier();
            uint n_here = n_met;
            for (uint k = 0u; k < n_here; ++k) {
                ivec2 place = first_block + ivec2(int(met[k]) % columns, int(met[k]) / columns);
                uint block = view.first_block + uint(place.y * view.columns + place.x);
                ivec2 at_sample = 8 * place + of_block;
                uint sample_ = row_of(view, at_sample.y) + uint(at_sample.x);
                found += draw_sample(f, slopes, block, value[k], lane, sample_);
            }
            barrier();
        }
        if (found.x > 0u) {
            atomicAdd(total[0], found.x);
            atomicAdd(total[1], found.y);
        }
        barrier();
        if (lane == 0u) count(view, f.name, uvec2(total[0], total[1]));
        barrier();
    }
}

#else

double largest(dvec3 p) {
    dvec3 size = abs(p);
    return max(size.x, max(size.y, size.z));
}

dvec3 cross_of(dvec3 p, dvec3 q) {
    precise dvec3 n = p.yzx * q.zxy - p.zxy * q.yzx;
    return n;
}

// Twice the area vector of a face.
dvec3 normal_of(dvec3 p, dvec3 q, dvec3 r) {
    precise dvec3 to_q = q - p, to_r = r - p;
    return cross_of(to_q, to_r);
}

double height_of(dvec3 normal, dvec3 p) {
    precise double height = normal.x * p.x + normal.y * p.y + normal.z * p.z;
    return height;
}

// A plane owns what is on it for one of the two faces of an edge, whose planes have opposite signs.
bool owns(dvec3 n) {
    return n.x > 0.0lf || (n.x == 0.0lf && (n.y > 0.0lf || (n.y == 0.0lf && n.z > 0.0lf)));
}

// Edge scaled by its rounding at a sample: `doubt` is that in doubles, `doubt32` that to float32, the
// latter relative to its slopes.
dvec3 scaled(dvec3 n, double doubt, double doubt32) {
    double size = abs(n.x) + abs(n.y) + abs(n.z);
    double to_one = size > 0.0lf ? 1.0lf / size : 1.0lf;
    n *= to_one;
    double all = doubt * to_one + doubt32 * (abs(n.x) + abs(n.y));
    return n * (1.0lf / max(all, LEAST_DOUBT));
}

// Sets up a face whose inner side of the edges has the sign `side`.
Face set_up(View view, dvec3 p, dvec3 q, dvec3 r, double side) {
    Face f;
    f.p = p;
    f.q = q;
    f.r = r;
    f.side = side;
    precise dvec3 pq = side * cross_of(p, q), qr = side * cross_of(q, r), rp = side * cross_of(r, p);
    f.flags = (owns(pq) ? OWNS[0] : 0u) | (owns(qr) ? OWNS[1] : 0u) | (owns(rp) ? OWNS[2] : 0u);
    double doubt = DOUBT_REL * view.farthest, doubt32 = DOUBT32_REL * view.half_side;
    double size_p = largest(p), size_q = largest(q), size_r = largest(r);
    f.edge[0] = scaled(pq, doubt * size_p * size_q, doubt32);
    f.edge[1] = scaled(qr, doubt * size_q * size_r, doubt32);
    f.edge[2] = scaled(rp, doubt * size_r * size_p, doubt32);

    double nearest = min(p.z, min(q.z, r.z));
    precise double least = 1.0lf / max(p.z, max(q.z, r.z));
    precise double greatest = 1.0lf / max(nearest, view.near);
    f.least = float(least);
    f.greatest = float(greatest);
    bool is_cut = nearest < view.near;
    f.behind = is_cut ? 0.0 : -ANY_DEPTH;
    f.cut = is_cut ? f.greatest : ANY_DEPTH;
    dvec3 normal = normal_of(p, q, r);
    double height = height_of(normal, p);
    precise dvec3 inverse = normal / height;
    // Edge-on, 1/z has no plane; with the eye in the face all of it is before the near plane.
    bool has_plane = height != 0.0lf && all(lessThanEqual(abs(inverse), dvec3(MOST_SLOPE)));
    f.inverse = has_plane ? inverse : dvec3(0.0lf, 0.0lf, is_cut ? 2.0lf * greatest : greatest);
    return f;
}

double rounding_of(dvec3 p, dvec3 q, dvec3 r) {
    double size = max(largest(p), max(largest(q), largest(r)));
    return ROUNDING_REL * size * size * size;
}

// Box (x0, x1, y0, y1) of what of a face is beyond the near plane, in units of the plane.
dvec4 box_of(dvec3 corners[3], double near) {
    dvec2 low = dvec2(LARGEST), high = dvec2(-LARGEST);
    for (int i = 0; i < 3; ++i) {
        dvec3 here = corners[i], next = corners[i < 2 ? i + 1 : 0];
        if (here.z >= near) {
            dvec2 at = here.xy / here.z;
            low = min(low, at);
            high = max(high, at);
        }
        if ((here.z >= near) != (next.z >= near)) {
            double t = (near - here.z) / (next.z - here.z);
            dvec2 at = (here.xy + t * (next.xy - here.xy)) / near;
            low = min(low, at);
            high = max(high, at);
        }
    }
    dvec2 margin = SLACK * (1.0lf + abs(low) + abs(high));
    return dvec4(low - margin, high + margin).xzyw;
}

ivec2 cell_of(View view, dvec2 at) {
    return ivec2(clamp((at - view.low) * view.cells_a_unit, dvec2(0.0lf), dvec2(view.cells - 1)));
}

// First and last column, first and last row of the samples in a box of the plane, and perhaps more.
ivec4 samples_in(View view, dvec4 box) {
    ivec2 from = cell_of(view, box.xz), to = cell_of(view, box.yw);
    ivec2 of_level = view.cells;
    int first = view.first_cell;
    while (max(to.x - from.x, to.y - from.y) >= LOOKUPS) {
        first += of_level.x * of_level.y;
        of_level = (of_level + 1) >> 1;
        from >>= 1;
        to >>= 1;
    }
    ivec4 least = ivec4(1 << 30);
    for (int row = from.y; row <= to.y; ++row) {
        for (int column = from.x; column <= to.x; ++column) {
            least = min(least, cells[first + row * of_level.x + column]);
        }
    }
    return ivec4(least.x, -least.y, least.z, -least.w);
}

// Fills a face of few samples, columns and rows of `at`.
uvec2 fill(Face f, View view, ivec4 at) {
    Slopes slopes = slopes_of(f);
    uvec2 found = uvec2(0u);
    for (int top = at.z >> 3; top <= at.w >> 3; ++top) {
        for (int left = at.x >> 3; left <= at.y >> 3; ++left) {
            uint block = view.first_block + uint(top * view.columns + left);
            vec4 here = in_middle(f, blocks[block].middle);
            for (int t = 0; t < 4; ++t) {
                vec4 tile = blocks[block].tiles[t];
                vec4 in_tile = here + slopes.across * tile.x + slopes.down * tile.y;
                if (!meets(slopes, in_tile, tile.zw)) continue;
                ivec2 first = 8 * ivec2(left, top) + 4 * ivec2(t & 1, t >> 1);
                ivec2 from = max(at.xz, first), to = min(at.yw, first + 3);
                for (int row = from.y; row <= to.y; ++row) {
                    uint row_start = row_of(view, row);
                    for (int column = from.x; column <= to.x; ++column) {
                        uint of_block = uint(8 * (row & 7) + (column & 7));
                        uint sample_ = row_start + uint(column);
                        found += draw_sample(f, slopes, block, here, of_block, sample_);
                    }
                }
            }
        }
    }
    return found;
}

void enqueue(Face f, uint view, ivec4 at) {
    ivec2 n_blocks = (at.yw >> 3) - (at.xz >> 3) + 1;
    int end = n_blocks.x * n_blocks.y;
    uint n = uint(end + PIECE_BLOCKS - 1) / uint(PIECE_BLOCKS);
    uint first = take_slots(n);
    for (uint slot = first; slot < min(first + n, capacity); ++slot) {
        int begin = PIECE_BLOCKS * int(slot - first);
        pieces[slot] = Piece(f, at.xz, at.yw, begin, min(begin + PIECE_BLOCKS, end), view);
    }
}

void main() {
    uint face = faces_to_draw.x + gl_GlobalInvocationID.x;
    if (face >= faces_to_draw.y) return;
    uint number = first_view + gl_GlobalInvocationID.z;
    View view = views[number];
    dvec3 corners[3];
    for (int i = 0; i < 3; ++i) {
        corners[i] = in_axes(
            3u * face + uint(i), view.right.xyz, view.down.xyz, view.forward.xyz, view.eye.xyz);
    }
    if (!(max(corners[0].z, max(corners[1].z, corners[2].z)) >= view.near)) return;
    double height = height_of(normal_of(corners[0], corners[1], corners[2]), corners[0]);
    double rounding = rounding_of(corners[0], corners[1], corners[2]);
    // The height of the eye is positive where a face is seen from behind.
    bool is_drawn = view.cull == 0.0lf || !(height > rounding);
#if defined(ATOMIC64) || defined(TARGETS)
    bool is_counted = with_drawn;
#else
    bool is_counted = with_drawn && which_pass == 0u;
#endif
    if (!is_drawn && !is_counted) return;
    dvec4 box = box_of(corners, view.near);
    if (box.y < view.low.x || box.x > view.high.x) return;
    if (box.w < view.low.y || box.z > view.high.y) return;
    ivec4 at = samples_in(view, box);
    if (at.x > at.y) return;
    int n_samples = (at.y - at.x + 1) * (at.w - at.z + 1);

    // Edge-on the sign is not known; the samples where all three edges agree are the face.
    int turns = abs(height) <= rounding ? 2 : 1;
    for (int turn = 0; turn < turns; ++turn) {
        double side = (height > 0.0lf) != (turn == 1) ? 1.0lf : -1.0lf;
        Face f = set_up(view, corners[0], corners[1], corners[2], side);
        f.name = face + 1u;
        f.flags |= is_drawn ? IS_DRAWN : 0u;
        if (n_samples > SMALL) {
            enqueue(f, number, at);
        } else {
            count(view, f.name, fill(f, view, at));
        }
    }
}

#endif
