// Places the corners of a face of the viewer's mesh and looks up the colour of its level.
//
// Positions are not indexed, so the face is gl_VertexID / 3. Level and group of each face are texels
// of textures TEXELS_A_ROW wide; a row of `palette` belongs to a level (alpha: its hatch), and one of
// `groups` to a group. PICKING leaves colours out. PIECES are parts of faces: triangles that name
// their face, and have a level of their own.

uniform mat4 clip_from_world;
uniform vec3 eye;                   // where one looks from; a parallel view: minus its direction
uniform bool is_parallel;
uniform highp usampler2D levels;
uniform highp usampler2D face_groups;
uniform highp usampler2D groups;    // bits: 1 hidden, 2 two-sided, 4 transparent, 8 highlighted
uniform highp usampler2D creases;   // bits 1, 2, 4: the edge opposite the corner is a line
uniform sampler2D palette;
uniform int which;                  // 0: all faces, 1: opaque ones, 2: transparent ones

#ifdef PIECES
in uint parent;                     // face that the corner is of
in vec3 weights;                    // its barycentric coordinates there
in uint level;
#endif
in vec3 position;                   // metres from the origin of the soup

flat out uint id;                   // index of the face + 1
flat out uint flags;
flat out vec3 colour;
flat out uint hatch;                // 1 for /, 2 for the other diagonal, 4 for |, 8 for -, 16 for dots
out vec3 world;
out vec3 to_eye;
out vec3 corner;                    // barycentric coordinates, 1 where the edge has no line

const uint HIDDEN = 1u, TRANSPARENT = 4u;

ivec2 texel(uint index) {
    return ivec2(index % uint(TEXELS_A_ROW), index / uint(TEXELS_A_ROW));
}

void main() {
#ifdef PIECES
    uint face = parent;
#else
    uint face = uint(gl_VertexID / 3);
    int side = gl_VertexID % 3;
    vec3 weights = vec3(side == 0, side == 1, side == 2);
#endif
    id = face + 1u;
    flags = texelFetch(groups, texel(texelFetch(face_groups, texel(face), 0).r), 0).r;
    bool is_transparent = (flags & TRANSPARENT) != 0u;
    bool is_left_out = (flags & HIDDEN) != 0u || which == 1 && is_transparent
        || which == 2 && !is_transparent;
#ifdef PICKING
    colour = vec3(0.0);
    hatch = 0u;
#else
#ifndef PIECES
    uint level = texelFetch(levels, texel(face), 0).r;
#endif
    vec4 row = texelFetch(palette, ivec2(level, 0), 0);
    colour = row.rgb;
    hatch = uint(round(255.0 * row.a));
#endif
    uvec3 lines = uvec3(texelFetch(creases, texel(face), 0).r) >> uvec3(0u, 1u, 2u) & 1u;
    corner = mix(vec3(1.0), weights, vec3(lines));
    world = position;
    to_eye = is_parallel ? eye : eye - position;
    gl_Position = is_left_out ? vec4(2.0, 2.0, 2.0, 1.0) : clip_from_world * vec4(position, 1.0);
}
