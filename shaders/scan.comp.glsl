// Turns the number of entries of each list into the place where it starts, in two dispatches: first
// each workgroup adds up SCANNED lists; then, with `of_sums`, one adds up what these found.
//
// Sums end at the largest number that 32 bits hold, which is more than there can be room for.
//
// W. Hillis, G. Steele. Data Parallel Algorithms. 1986.

#include "triangle.glsl"

layout(local_size_x = 256) in;

uniform uint n;  // lists, or sums of lists
uniform bool of_sums;

shared uint parts[256];

uint sum_of(uint a, uint b) {
    uint total = a + b;
    return total < a ? 0xffffffffu : total;
}

uint value_at(uint i) {
    if (i >= n) return 0u;
    return of_sums ? sums[i] : heads[i];
}

// Sums of the values before each of four from `first` on, written; returns that of the workgroup.
uint scan(uint first, uint before) {
    uint me = gl_LocalInvocationIndex;
    uint values[4], own = 0u;
    for (uint k = 0u; k < 4u; ++k) {
        values[k] = own;
        own = sum_of(own, value_at(first + 4u * me + k));
    }
    parts[me] = own;
    barrier();
    for (uint step = 1u; step < 256u; step *= 2u) {
        uint other = me >= step ? parts[me - step] : 0u;
        barrier();
        parts[me] = sum_of(parts[me], other);
        barrier();
    }
    uint start = sum_of(before, me > 0u ? parts[me - 1u] : 0u);
    for (uint k = 0u; k < 4u; ++k) {
        uint i = first + 4u * me + k;
        if (i >= n) break;
        if (of_sums) sums[i] = sum_of(start, values[k]);
        else starts[i] = sum_of(start, values[k]);
    }
    uint total = parts[255];
    barrier();
    return total;
}

void main() {
    uint me = gl_LocalInvocationIndex;
    if (!of_sums) {
        uint total = scan(SCANNED * gl_WorkGroupID.x, 0u);
        if (me == 0u) sums[gl_WorkGroupID.x] = total;
        return;
    }
    uint before = 0u;
    for (uint first = 0u; first < n; first += SCANNED) before = sum_of(before, scan(first, before));
    if (me == 0u) n_listed = before;
}
