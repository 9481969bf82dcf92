// Triangle-ID buffer: face index + 1; 0 is background.

flat in uint id;

layout(location = 0) out uint face;

void main() {
    face = id;
}
