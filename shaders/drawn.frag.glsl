// Counts every sample of every face, hidden ones included; drawn without depth test. In a ROLLED
// grid, rotated against the image, `runs` bounds the samples of each row that lie inside the image.

layout(std430, binding = 0) buffer Counts { uint counts[]; };  // slot 0 is background, then one a face

flat in uint id;

#ifdef ROLLED
layout(std430, binding = 1) readonly buffer Runs { ivec2 runs[]; };
uniform ivec2 corner;     // top-left of this image on the canvas of samples
#endif

void main() {
#ifdef ROLLED
    ivec2 at = ivec2(gl_FragCoord.xy) + corner;
    ivec2 inside = runs[at.y];
    if (at.x < inside.x || at.x >= inside.y) return;
#endif
    atomicAdd(counts[id], 1u);
}
