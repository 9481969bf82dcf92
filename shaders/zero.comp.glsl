// Sets words to 0, n of them: a driver may clear a buffer at a tenth of the rate of its memory.

layout(local_size_x = 256) in;

layout(std430, binding = 7) writeonly buffer Words { uint words[]; };

uniform uint n;

void main() {
    for (uint i = gl_GlobalInvocationID.x; i < n; i += 256u * gl_NumWorkGroups.x) words[i] = 0u;
}
