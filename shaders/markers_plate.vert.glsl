// Corners of plates to an atlas of small images, one ray bundle an instance.
//
// An instance is one point of the lens and one point of the pixel. Seen from the point (a, b) of a
// thin lens of diameter 1, a point at depth z lies reach * (a, b) * (1 / focus - 1 / z) px from where
// the pinhole sees it: a perspective of its own, in which the plane in focus stays where it is.
// Everything is linear in (x, y, z), so w = z makes it perspective-correct.

uniform vec4 camera;    // fx, fy, cx, cy of the cut-out, px
uniform vec3 lens;      // 1 / focus distance, 1/m, and reach along u and v, px m
uniform ivec2 size;     // px of the cut-out
uniform int columns;    // cut-outs in a row of the atlas
uniform vec2 atlas;     // px in use
uniform float near;

in vec3 position;       // camera axes: x right, y down, z forward, metres
in vec2 place;          // on the plate, in cells of its marker from the top-left corner
in int marker;          // which marker, or one of the plain surfaces below 0
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
    // Image rows run down, and so do the rows of our framebuffers: no flip anywhere.
    gl_Position = vec4(2.0 * (image + corner * z) / atlas - z, z - 2.0 * near, z);
    cell = place;
    surface = marker;
}
