// Colour of a line or a triangle of the viewer, with its opacity; `fade` is for hidden parts.

uniform float fade;

in vec4 colour;

out vec4 drawn;

void main() {
    drawn = vec4(colour.rgb, 1.0) * colour.a * fade;
}
