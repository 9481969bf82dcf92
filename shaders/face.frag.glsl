// The triangle-ID buffer: face index + 1, so that 0 is background.

uniform uint first_face;  // gl_PrimitiveID starts again at 0 in every draw and instance

layout(location = 0) out uint face;

void main() {
    face = first_face + uint(gl_PrimitiveID) + 1u;
}
