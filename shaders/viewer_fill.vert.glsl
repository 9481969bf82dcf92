// Places the corners of coloured triangles of the viewer: planes of focus, handles, boxes.

uniform mat4 clip_from_world;
uniform float pull;  // moves towards the eye, a fraction of the depth, so that marks lie on their face

in vec3 position;
in vec4 tint;

out vec4 colour;

void main() {
    gl_Position = clip_from_world * vec4(position, 1.0);
    gl_Position.z -= pull * gl_Position.w;
    colour = tint;
}
