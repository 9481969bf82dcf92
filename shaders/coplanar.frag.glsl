// Triangle-ID buffer of overlapping coplanar faces, with the depth of their plane.

flat in uint id;
flat in dvec3 plane;
flat in vec2 reach;

layout(location = 0) out uint face;

// Depth range between the cleared value, excluded because it must lose the depth test, and the near
// plane.
const float LEAST = 1.17549435e-38, GREATEST = 1.0;

void main() {
    face = id;
    precise double depth = plane.z + plane.y * double(gl_FragCoord.y);
    depth += plane.x * double(gl_FragCoord.x);
    // A sample can lie beyond the corners by rounding; its depth must not.
    gl_FragDepth = clamp(clamp(float(depth), reach.x, reach.y), LEAST, GREATEST);
}
