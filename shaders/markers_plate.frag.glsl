// Reflectance of a plate: the cells of its marker, the white border, or a plain grey.

uniform usampler2D cells;  // one row a marker: its cells, row by row, 1 is white
uniform float black, white, grey;

in vec2 cell;
flat in int surface;

layout(location = 0) out float reflected;

void main() {
    ivec2 at = ivec2(floor(cell));
    bool is_inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, ivec2(CELLS)));
    bool is_dark = surface >= 0 && is_inside && texelFetch(cells, ivec2(at.y * CELLS + at.x, surface), 0).x == 0u;
    reflected = surface == PLAIN ? grey : is_dark ? black : white;
}
