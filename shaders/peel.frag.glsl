// Peels one layer of faces, for devices without storage buffers: at each sample the lowest face
// index above that of the previous layer. Faces are drawn in order of index at one depth, so only
// the first one passes the depth test. Repeated until a layer is empty, this draws every sample of
// every face once. Images are cleared to the highest id, so a finished sample stays finished.

uniform usampler2DArray before;

flat in uint id;

layout(location = 0) out uint face;

void main() {
    if (id <= texelFetch(before, ivec3(gl_FragCoord.xy, 0), 0).x) discard;
    face = id;
    gl_FragDepth = 0.5;
}
