// Counts every sample of every face, hidden or not: drawn with the depth test off.

layout(std430, binding = 0) buffer Counts { uint counts[]; };

uniform uint first_face;  // the window of faces that this draw counts
uniform uint stride;      // counters a layer: slot 0 is background, then one a face

flat in uint id;

#ifdef LAYERED
flat in int layer;
#else
const int layer = 0;
#endif

void main() {
    atomicAdd(counts[uint(layer) * stride + id - first_face], 1u);
}
