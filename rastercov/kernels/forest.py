"""Disjoint sets as a forest: each set is a tree whose root names it, for compiled loops.

R. E. Tarjan. Efficiency of a Good But Not Linear Set Union Algorithm. 1975.
"""

from rastercov.kernels.jit import part_with_arrays


@part_with_arrays
def root_of(parent, i):
    """Root of the tree of i; the path to it is halved on the way."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i
