// Counts every sample of every face, hidden or not: drawn with the depth test off.

layout(std430, binding = 0) buffer Counts { uint counts[]; };

uniform uint stride;  // counters a layer: slot 0 is background, then one a face of this draw

#ifdef LAYERED
flat in int layer;
#else
const int layer = 0;
#endif

void main() {
    atomicAdd(counts[uint(layer) * stride + uint(gl_PrimitiveID) + 1u], 1u);
}
