// Sum of the images of an atlas at each pixel.

uniform sampler2D images;
uniform ivec2 size;
uniform int columns;
uniform int count;

layout(location = 0) out float total;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    total = 0.0;
    for (int n = 0; n < count; n++)
        total += texelFetch(images, at + size * ivec2(n % columns, n / columns), 0).x;
}
