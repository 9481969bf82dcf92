// Disjoint sets as a forest: each set is a tree whose root, its lowest node, names it.
//
// R. E. Tarjan. Efficiency of a Good But Not Linear Set Union Algorithm. 1975.
//
// Twin: tests/exact/test_certificate.py, by regions of faces one by one.
#pragma once
#include <algorithm>
#include <cstdint>

namespace rastercov::exact {

// Root of the tree of i; the path to it is halved on the way.
template <class Parents> auto root_of(const Parents &parent, int64_t i) {
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return typename Parents::Element(i);
}

// Joins the trees of two nodes.
template <class Parents> void join(int64_t f, int64_t g, const Parents &parent) {
    const auto one = root_of(parent, f), other = root_of(parent, g);
    parent[std::max(one, other)] = std::min(one, other);
}

} // namespace rastercov::exact
