// Counts every sample of every face, hidden or not: drawn with the depth test off. In a ROLLED grid
// each row of samples is inside the image from its first sample up to its last.

layout(std430, binding = 0) buffer Counts { uint counts[]; };

uniform uint first_face;  // the window of faces that this draw counts
uniform uint stride;      // counters a layer: slot 0 is background, then one a face

flat in uint id;

#ifdef LAYERED
flat in int layer;
#else
const int layer = 0;
#endif

#ifdef ROLLED
layout(std430, binding = 1) readonly buffer Runs { ivec2 runs[]; };
uniform ivec2 corner;     // of this image on the canvas of samples
#endif

void main() {
#ifdef ROLLED
    ivec2 at = ivec2(gl_FragCoord.xy) + corner;
    ivec2 inside = runs[at.y];
    if (at.x < inside.x || at.x >= inside.y) return;
#endif
    atomicAdd(counts[uint(layer) * stride + id - first_face], 1u);
}
