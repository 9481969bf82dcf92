// The border's functions that need no template: the type of an array, its text, memory apart.
#include "bind.hpp"
#include <algorithm>
#define NPY_NO_DEPRECATED_API NPY_2_0_API_VERSION
#define NPY_TARGET_VERSION NPY_2_0_API_VERSION
#include <numpy/ndarraytypes.h>

namespace rastercov {

// By their places in memory, each array after those that begin before it.
void require_apart(std::vector<Extent> &all) {
    std::sort(all.begin(), all.end(),
              [](const Extent &a, const Extent &b) { return a.first < b.first; });
    const char *end = nullptr, *end_of_outputs = nullptr;
    for (const Extent &each : all) {
        require(each.first >= (each.is_output ? end : end_of_outputs),
                "an array to write to shares memory with another array");
        end = std::max(end, each.end);
        if (each.is_output) end_of_outputs = std::max(end_of_outputs, each.end);
    }
}

PyObject *array_type() {
    static PyObject *const type = nanobind::module_::import_("numpy").attr("ndarray").ptr();
    return type;
}

bool read_array(PyObject *source, const ArrayType &wanted, void *&data, int64_t *shape) noexcept {
    if (!PyObject_TypeCheck(source, reinterpret_cast<PyTypeObject *>(array_type()))) return false;
    const auto *array = reinterpret_cast<PyArrayObject *>(source);
    const PyArray_Descr *type = PyArray_DESCR(array);
    const int flags =
        NPY_ARRAY_C_CONTIGUOUS | NPY_ARRAY_ALIGNED | (wanted.is_output ? NPY_ARRAY_WRITEABLE : 0);
    if (PyArray_NDIM(array) != wanted.n_axes || (PyArray_FLAGS(array) & flags) != flags ||
        type->kind != wanted.kind || type->elsize != wanted.size || type->byteorder == NPY_OPPBYTE)
        return false;
    data = PyArray_DATA(const_cast<PyArrayObject *>(array));
    for (int k = 0; k < wanted.n_axes; k++) {
        shape[k] = PyArray_DIM(array, k);
        if (wanted.extents[k] != Any && wanted.extents[k] != shape[k]) return false;
    }
    return reinterpret_cast<uintptr_t>(data) % wanted.size ==
           0; // numbers are aligned to their size
}

void put_array(std::string &text, const ArrayType &type) {
    text += "numpy.ndarray[dtype=";
    text += type.kind == 'b'   ? "bool"
            : type.kind == 'f' ? "float"
            : type.kind == 'i' ? "int"
                               : "uint";
    if (type.kind != 'b') text += std::to_string(8 * type.size);
    const char *before = ", shape=(";
    for (int k = 0; k < type.n_axes; k++, before = ", ")
        text.append(before).append(type.extents[k] == Any ? "*" : std::to_string(type.extents[k]));
    text += "), order='C', device='cpu'";
    text += type.is_output ? "]" : ", writable=False]";
}

} // namespace rastercov
