// Part of raster.comp and lens.comp: the mesh, the keys of the samples, the counters of the faces,
// and the queue of pieces of larger faces. A struct `Piece` is declared before.
//
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
uniform uint first_face;      // first face of the window that `counts` holds
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
