// One layer of faces by index, for devices without storage buffers: at each pixel the lowest index
// above the one of the layer before. Faces are drawn in the order of their index, all at one depth,
// so the depth test lets only the first one through. Repeating this until nothing is left meets
// every sample of every face once. Images start at the highest id, so that what is done stays done.

uniform usampler2DArray before;

flat in uint id;

layout(location = 0) out uint face;

void main() {
    if (id <= texelFetch(before, ivec3(gl_FragCoord.xy, 0), 0).x) discard;
    face = id;
    gl_FragDepth = 0.5;
}
