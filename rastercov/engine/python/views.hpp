// Arrays of numpy that show memory of an object of C++, which they keep alive.
//
// Twin: tests/exact/test_surface.py.
#pragma once
#include "bind.hpp"
#include <nanobind/ndarray.h>

namespace rastercov {

// What only C++ looks into.
template <> inline void put_type<nanobind::object>(std::string &text, Type<nanobind::object>) {
    text += "object";
}

template <class T, int64_t... Extents>
nanobind::object view_of(const Array<T, Extents...> &array, nanobind::handle owner) {
    std::array<size_t, sizeof...(Extents)> shape;
    for (size_t k = 0; k < shape.size(); k++) shape[k] = size_t(array.extent(int(k)));
    using View = nanobind::ndarray<nanobind::numpy, const std::remove_const_t<T>>;
    return nanobind::cast(View(array.data, shape.size(), shape.data(), owner));
}

} // namespace rastercov
