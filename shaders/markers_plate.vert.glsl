// Transforms corners of plates to an atlas of small images, one ray bundle an instance.
//
// An instance is one point of the lens and one point of the pixel. From the point (a, b) of a thin
// lens of diameter 1, the image of a point at depth z is displaced from its pinhole image by
// reach * (a, b) * (1 / focus - 1 / z) px: another perspective, which leaves the plane in focus
// unchanged. Everything is linear in (x, y, z), so w = z makes it perspective-correct.

uniform vec4 camera;    // fx, fy, cx, cy of the cut-out, px
uniform vec3 lens;      // 1 / focus distance, 1/m, and reach along u and v, px m
uniform ivec2 size;     // px of the cut-out
uniform int columns;    // cut-outs in a row of the atlas
uniform vec2 atlas;     // px in use
uniform float near;

in vec3 position;       // camera axes: x right, y down, z forward, metres
in vec2 place;          // on the plate, in cells of its marker from the top-left corner
in int marker;          // index of the marker; below 0 for plain surfaces
in vec4 bundle;         // point of the lens (diameter 1), shift within the pixel

out vec2 cell;
flat out int surface;
out float gl_ClipDistance[4];

void main() {
    float z = position.z;
    vec2 image = camera.xy * position.xy + camera.zw * z
        + lens.yz * bundle.xy * (z * lens.x - 1.0) + bundle.zw * z;
    vec2 extent = vec2(size) * z;
    gl_ClipDistance[0] = image.x;
    gl_ClipDistance[1] = extent.x - image.x;
    gl_ClipDistance[2] = image.y;
    gl_ClipDistance[3] = extent.y - image.y;
    vec2 corner = vec2(size * ivec2(gl_InstanceID % columns, gl_InstanceID / columns));
    // Rows of images and of our framebuffers both run down, so nothing is flipped.
    gl_Position = vec4(2.0 * (image + corner * z) / atlas - z, z - 2.0 * near, z);
    cell = place;
    surface = marker;
}
