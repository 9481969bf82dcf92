// Shades a face of the viewer's mesh in the colour of its level, or writes what a pick wants to know.
//
// A headlight dims faces that are seen at an angle: palette * (SHADE_LEAST + (1 - SHADE_LEAST) *
// |cosine of incidence|), in sRGB. With `is_flat` the colour is that of the palette, exactly,
// and without it the hatch of the level is drawn over it, in lines on the screen.

uniform vec4 section;               // points with dot(section, (world, 1)) > 0 are cut away
uniform bool is_cut;
uniform bool is_culled;             // faces turned away are left out, unless two-sided
uniform bool is_flat;
uniform bool has_edges;
uniform float opacity;
uniform vec3 accent;                // colour of stripes on highlighted groups

flat in uint id;
flat in uint flags;
flat in vec3 colour;
flat in uint hatch;
in vec3 world;
in vec3 to_eye;
in vec3 corner;

const uint TWO_SIDED = 2u, HIGHLIGHTED = 8u;
const float STRIPES = 10.0;         // pixels from one stripe to the next
const float HATCH = 8.0;            // and from one line of a hatch to the next

#ifdef PICKING
out uvec4 picked;                   // face + 1, and the bits of the point's coordinates
#else
out vec4 drawn;
#endif

void main() {
    if (is_cut && dot(section, vec4(world, 1.0)) > 0.0) discard;
    if (is_culled && !gl_FrontFacing && (flags & TWO_SIDED) == 0u) discard;
#ifdef PICKING
    picked = uvec4(id, floatBitsToUint(world));
#else
    vec3 shown = colour;
    if (!is_flat) {
        vec3 normal = cross(dFdx(world), dFdy(world));
        float size = length(normal) * length(to_eye);
        float cosine = size > 0.0 ? abs(dot(normal, to_eye)) / size : 1.0;
        vec2 at = gl_FragCoord.xy;
        bvec4 on = lessThan(mod(vec4(at.x - at.y, at.x + at.y, at), HATCH), vec4(0.25 * HATCH));
        bvec4 wanted = notEqual(uvec4(hatch) & uvec4(1u, 2u, 4u, 8u), uvec4(0u));
        bool in_dot = (hatch & 16u) != 0u && all(lessThan(mod(at, HATCH), vec2(0.5 * HATCH)));
        if (in_dot || any(bvec4(uvec4(on) * uvec4(wanted))))
            shown = mix(shown, vec3(1.0), 0.45);
        shown *= SHADE_LEAST + (1.0 - SHADE_LEAST) * cosine;
    }
    if (has_edges) {
        vec3 width = max(fwidth(corner), 1e-6);
        vec3 near = smoothstep(0.1 * width, 0.95 * width, corner);
        float crowded = clamp(1.6 - 5.0 * max(width.x, max(width.y, width.z)), 0.0, 1.0);
        shown *= 1.0 - 0.5 * crowded * (1.0 - min(near.x, min(near.y, near.z)));
    }
    if ((flags & HIGHLIGHTED) != 0u) {
        float at = fract((gl_FragCoord.x + gl_FragCoord.y) / STRIPES);
        shown = mix(shown, accent, at < 0.5 ? 0.85 : 0.25);
    }
    drawn = vec4(shown * opacity, opacity);
#endif
}
