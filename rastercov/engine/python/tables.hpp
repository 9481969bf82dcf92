// Regions of poses as arrays of numpy.
//
// Twins: tests/exact/test_batch.py.
#pragma once
#include "solver/regions.hpp"
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <vector>

namespace rastercov {
namespace nb = nanobind;

// Array of numpy that has the memory of a vector.
template <class T> nb::object array_of(std::vector<T> values, size_t columns = 0) {
    if (values.empty()) values.reserve(1); // an address
    auto *const held = new std::vector<T>(std::move(values));
    const nb::capsule owner(held,
                            [](void *p) noexcept { delete static_cast<std::vector<T> *>(p); });
    const size_t n = columns ? held->size() / columns : held->size(), shape[2] = {n, columns};
    return nb::cast(nb::ndarray<nb::numpy, T>(held->data(), columns ? 2 : 1, shape, owner));
}

// Regions of all poses, one after another.
struct Table {
    engine::Regions all;
    std::vector<int64_t> n_pieces, n_pairs; // of each pose
};

inline Table table_of(std::vector<engine::Regions> found, const IntArray &turns) {
    Table table;
    const bool are_own = turns.rows() == int64_t(found.size());
    const auto join = [&](auto member) {
        auto &all = table.all.*member;
        size_t n = 0;
        for (const int64_t turn : turns) n += (found[size_t(turn)].*member).size();
        all.reserve(n);
        for (const int64_t turn : turns) {
            auto &own = found[size_t(turn)].*member;
            all.insert(all.end(), own.begin(), own.end());
            if (are_own)
                std::remove_reference_t<decltype(own)>().swap(
                    own); // no other pose has it: its memory is for what follows
        }
    };
    for (const int64_t turn : turns) {
        table.n_pieces.push_back(int64_t(found[size_t(turn)].face.size()));
        table.n_pairs.push_back(int64_t(found[size_t(turn)].listed.size()));
    }
    using R = engine::Regions;
    join(&R::xy);
    join(&R::n_corners);
    join(&R::face);
    join(&R::listed);
    join(&R::area);
    join(&R::bound);
    join(&R::excess);
    join(&R::cut_short);
    return table;
}

inline nb::tuple arrays_of(Table table) {
    engine::Regions &all = table.all;
    return nb::make_tuple(array_of(std::move(all.xy), 2), array_of(std::move(all.n_corners)),
                          array_of(std::move(all.face)), array_of(std::move(table.n_pieces)),
                          array_of(std::move(all.listed)), array_of(std::move(table.n_pairs)),
                          array_of(std::move(all.area)), array_of(std::move(all.bound)),
                          array_of(std::move(all.excess)), array_of(std::move(all.cut_short)));
}

} // namespace rastercov
