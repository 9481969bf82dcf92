// What the stages of the plan "compute" share: triangles of a batch of poses, and lists of those that
// may cover a sample of a tile, for each pose and tile.
//
// The arithmetic is that of the CPU rasteriser, operation by operation, so that both count the same
// samples: positions are whole steps of 1/256 sample, edge functions are exact in 32 or 64 bits, and
// 1/z is in floats from the corner of a block of 4 x 4 samples, where it is rounded from doubles.
// `precise` forbids the fused operations that would round otherwise.
//
// S. Laine, T. Karras. High-Performance Software Rasterization on GPUs. 2011.

#extension GL_ARB_gpu_shader_int64 : require

// A triangle in the image of a pose. The order of the corners gives it a positive area.
struct Triangle {
    ivec2 a, b, c;               // steps from the corner of the canvas
    uint face;                   // index + 1
    uint view;                   // index of the pose, and HIDDEN where it is counted but not drawn
    float least, greatest;       // 1/z of the corners
    double origin, right, down;  // 1/z = origin + down y + right x at sample (x, y) of the canvas
};
const uint HIDDEN = 0x80000000u;
const int HALF = 128;            // steps from the side of a sample to its centre

layout(std430, binding = 0) buffer Status {
    uint n_triangles;            // set up, whether or not there was room
    uint n_listed;               // entries of all lists, without a multiple of 2^32
    uint is_beyond;              // not 0 where there was one
};
layout(std430, binding = 1) buffer Triangles { Triangle triangles[]; };
layout(std430, binding = 2) buffer Lengths { uint lengths[]; };  // of lists
layout(std430, binding = 3) buffer Ends { uint ends[]; };        // of what is in each so far

uniform ivec2 size;    // samples of the part of the canvas that is drawn
uniform ivec2 corner;  // its first sample
uniform ivec2 tiles;   // in a row, and rows

// First sample of the part that a triangle can cover, and the one after the last.
ivec2 first_sample(Triangle t) {
    return max(((min(t.a, min(t.b, t.c)) + HALF - 1) >> 8) - corner, 0);
}
ivec2 end_of_samples(Triangle t) {
    return min(((max(t.a, max(t.b, t.c)) + HALF - 1) >> 8) - corner, size);
}
