// Widens a segment of the viewer, one an instance, to a strip of constant width on the screen.

uniform mat4 clip_from_world;
uniform vec2 screen;      // pixels
uniform float density;    // pixels of the screen in one pixel of the page
uniform float near;       // least w: segments are cut there, before they are divided by it

in vec3 from;
in vec3 to;
in vec4 tint;
in float width;           // pixels of the page

out vec4 colour;

void main() {
    vec4 a = clip_from_world * vec4(from, 1.0), b = clip_from_world * vec4(to, 1.0);
    bool is_behind = a.w < near && b.w < near;
    if (a.w < near) a = mix(a, b, (near - a.w) / (b.w - a.w));
    else if (b.w < near) b = mix(b, a, (near - b.w) / (a.w - b.w));
    vec2 along = (b.xy / b.w - a.xy / a.w) * screen;
    float size = length(along);
    vec2 ahead = size > 1e-6 ? along / size : vec2(1.0, 0.0);
    int at = gl_VertexID;             // a strip of four: both ends, both sides
    vec4 end = at < 2 ? a : b;
    float side = (at & 1) == 0 ? -1.0 : 1.0;
    vec2 away = side * vec2(-ahead.y, ahead.x) + (at < 2 ? -0.3 : 0.3) * ahead;
    gl_Position = is_behind ? vec4(2.0, 2.0, 2.0, 1.0)
                            : end + vec4(away * width * density / screen * end.w, 0.0, 0.0);
    gl_Position.z -= 1e-4 * gl_Position.w;  // over the face that it lies on
    colour = tint;
}
