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

// A property of any type.
template <class C, class Read>
void offer(nanobind::class_<C> &type, const std::string &name, const char *result, Read read) {
    const std::string signature = "def " + name + "(self) -> " + result;
    type.def_prop_ro(name.c_str(), read, nanobind::for_getter(nanobind::sig(signature.c_str())));
}

} // namespace rastercov
