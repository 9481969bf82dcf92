// The triangle-ID buffer for faces that lie on others in one plane, with the depth of that plane.

#extension GL_ARB_gpu_shader_fp64 : require

flat in uint id;
flat in dvec3 plane;
flat in vec2 reach;

layout(location = 0) out uint face;

// Between what the buffer is cleared to, which does not count as nearer, and the near plane.
#ifdef REVERSED
const float LEAST = 1.17549435e-38, GREATEST = 1.0;
#else
const float LEAST = 0.0, GREATEST = 0.99999994;
#endif

void main() {
    face = id;
    precise double depth = plane.z + plane.y * double(gl_FragCoord.y);
    depth += plane.x * double(gl_FragCoord.x);
    // Rounding lets a sample lie a hair beyond the corners; its depth does not.
    gl_FragDepth = clamp(clamp(float(depth), reach.x, reach.y), LEAST, GREATEST);
}
