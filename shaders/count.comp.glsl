// Counts the samples of each face in a batch of triangle-ID images, or, for KEYS, of what
// raster.comp leaves.
//
// An invocation walks a horizontal run of pixels and adds up equal neighbours before it touches a
// counter: faces are wider than a pixel more often than not, and background always is. In a ROLLED
// grid each row of samples is inside the image from its first sample up to its last.

layout(local_size_x = 8, local_size_y = 8) in;

layout(std430, binding = 0) buffer Counts { uint counts[]; };

#ifdef KEYS
layout(std430, binding = 2) readonly buffer Keys { uvec2 keys[]; };  // ~(index + 1) or 0, depth
#else
uniform usampler2DArray faces;
#endif
uniform uvec2 size;      // samples in use, the rest of the image is left alone
uniform uint stride;     // counters a layer: slot 0 is background, then one a face
uniform uint first_face; // the window of faces that this dispatch counts

#ifdef ROLLED
layout(std430, binding = 1) readonly buffer Runs { ivec2 runs[]; };
uniform ivec2 corner;    // of these images on the canvas of samples
#endif

const uint RUN = 16u;

uint face_at(uint x, uint y, uint layer) {
#ifdef KEYS
    uint owner = keys[(layer * size.y + y) * size.x + x].x;
    return owner == 0u ? 0u : ~owner;
#else
    return texelFetch(faces, ivec3(x, y, layer), 0).x;
#endif
}

void add(uint layer, uint face, uint n) {
    uint slot = face == 0u ? 0u : face - first_face;
    if (slot < stride && (face == 0u || face > first_face)) atomicAdd(counts[layer * stride + slot], n);
}

void main() {
    uint layer = gl_GlobalInvocationID.z;
    uint y = gl_GlobalInvocationID.y;
    uint x = gl_GlobalInvocationID.x * RUN;
    if (y >= size.y || x >= size.x) return;
    uint end = min(x + RUN, size.x);
#ifdef ROLLED
    ivec2 inside = max(runs[int(y) + corner.y] - corner.x, 0);
    x = max(x, uint(inside.x));
    end = min(end, uint(inside.y));
    if (x >= end) return;
#endif
    uint current = face_at(x, y, layer);
    uint n = 1u;
    for (x += 1u; x < end; ++x) {
        uint face = face_at(x, y, layer);
        if (face == current) {
            ++n;
        } else {
            add(layer, current, n);
            current = face;
            n = 1u;
        }
    }
    add(layer, current, n);
}
