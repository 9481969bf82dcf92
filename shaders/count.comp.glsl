// Counts the samples of each face in a batch of triangle-ID images, or with KEYS in the keys of
// raster.comp.
//
// An invocation reads a horizontal run of samples and adds each group of equal neighbours to its
// counter at once, since most faces and the background are wider than a sample. In a ROLLED grid,
// rotated against the image, `runs` bounds the samples of each row that lie inside the image.

layout(local_size_x = 8, local_size_y = 8) in;

layout(std430, binding = 0) buffer Counts { uint counts[]; };

#ifdef KEYS
layout(std430, binding = 2) readonly buffer Keys { uvec2 keys[]; };  // ~(index + 1) or 0, depth
#else
uniform usampler2DArray faces;
#endif
uniform uvec2 size;      // samples in use; the rest of the image is ignored
uniform uint stride;     // counters a layer: slot 0 is background, then one a face

#ifdef ROLLED
layout(std430, binding = 1) readonly buffer Runs { ivec2 runs[]; };  // first, one after the last
uniform ivec2 corner;    // top-left of these images on the canvas of samples
#endif

const uint RUN = 16u;  // samples of an invocation

uint face_at(uint x, uint y, uint layer) {
#ifdef KEYS
    uint owner = keys[(layer * size.y + y) * size.x + x].x;
    return owner == 0u ? 0u : ~owner;
#else
    return texelFetch(faces, ivec3(x, y, layer), 0).x;
#endif
}

void add(uint layer, uint face, uint n) {
    if (face < stride) atomicAdd(counts[layer * stride + face], n);
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
