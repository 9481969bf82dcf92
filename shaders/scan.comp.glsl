// Finds room for each list: where it starts, in no order among lists, which none needs.

#include "triangle.glsl"

layout(local_size_x = 256) in;

uniform uint n_lists;

shared uint n_own, first;

// Adds a number to a sum, of which it returns what was there; notes where 32 bits do not hold it.
#define ADD(NAME, SUM)                                              \
    uint NAME(uint n) {                                             \
        uint before = atomicAdd(SUM, n);                            \
        if (before + n < before) atomicOr(is_beyond, 1u);           \
        return before;                                              \
    }
ADD(add_to_group, n_own)
ADD(add_to_all, n_listed)

void main() {
    uint me = gl_LocalInvocationIndex, step = 256u * gl_NumWorkGroups.x;
    for (uint start = 256u * gl_WorkGroupID.x; start < n_lists; start += step) {
        uint list = start + me, before = 0u;
        if (me == 0u) n_own = 0u;
        barrier();
        if (list < n_lists) before = add_to_group(lengths[list]);
        barrier();
        if (me == 0u) first = add_to_all(n_own);
        barrier();
        if (list < n_lists) ends[list] = first + before;
    }
}
