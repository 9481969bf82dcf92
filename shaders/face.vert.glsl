// Transforms the vertices of the mesh to clip space.
//
// Positions and the eye (camera centre) are sums of two floats, high + low. They are subtracted
// before rounding to one float, so a part at 10^7 m projects as at the origin.

uniform vec3 right, down, forward;  // camera axes; right and down mixed to rotate the grid
uniform vec3 eye_high, eye_low;
uniform float near;                 // clip z, so depth = near / z in [0, 1]
uniform vec4 image;  // clip x = image.x * x + image.z * z, clip y = image.y * y + image.w * z

in vec3 position_high;
in vec3 position_low;

// Every program places the corners of a face alike, so edges stay watertight.
invariant gl_Position;

// Face index + 1. gl_PrimitiveID would need no corners of its own for each face, but Mesa splits
// primitives to number them.
flat out uint id;

void main() {
    vec3 from_eye = (position_high - eye_high) + (position_low - eye_low);
    float x = dot(right, from_eye);
    float y = dot(down, from_eye);
    float z = dot(forward, from_eye);
    // Rows of images and of our framebuffers both run down, so nothing is flipped.
    gl_Position = vec4(image.x * x + image.z * z, image.y * y + image.w * z, near, z);
    id = uint(gl_VertexID) / 3u + 1u;
}
