// The border's functions that need no template: errors, the type of an array, its text, memory
// apart.
#include "bind.hpp"
#include "interrupt.hpp"
#include <algorithm>
#include <cstdio>
#include <cstring>
#define NPY_NO_DEPRECATED_API NPY_1_22_API_VERSION
#define NPY_TARGET_VERSION NPY_1_22_API_VERSION
#include <numpy/ndarraytypes.h>

namespace rastercov {
namespace {

// Sets the error of Python for memory that ran out in a function, by the sentence on it.
void set_out_of_memory(const char *doing) {
    const int length = int(std::min<size_t>(std::strcspn(doing, ".:;\n"), 75));
    char text[200];
    std::snprintf(text, sizeof text,
                  "expected memory for \"%.*s\", got too little; pass less at once or free memory",
                  length, doing);
    try {
        const auto errors = nanobind::module_::import_("rastercov.base.errors");
        PyErr_SetString(errors.attr("ResourceError").ptr(), text);
    } catch (nanobind::python_error &error) {
        error.restore(); // no memory for that, either
    }
}

} // namespace

void translate_errors() {
    nanobind::register_exception_translator([](const std::exception_ptr &raised, void *) {
        try {
            std::rethrow_exception(raised);
        } catch (const OutOfMemory &error) {
            set_out_of_memory(error.doing);
        } catch (const std::bad_alloc &) {
            set_out_of_memory("Make an object");
        } catch (const Interrupted &) {
            PyErr_SetNone(PyExc_KeyboardInterrupt);
        }
    });
}

// By their places in memory, each array after those that begin before it.
void require_apart(std::vector<Extent> &all) {
    std::sort(all.begin(), all.end(),
              [](const Extent &a, const Extent &b) { return a.first < b.first; });
    const char *end = nullptr, *end_of_outputs = nullptr;
    for (const Extent &each : all) {
        require(
            each.first >= (each.is_output ? end : end_of_outputs),
            "expected outputs with memory of their own, got one that shares memory with another "
            "array; pass a copy");
        end = std::max(end, each.end);
        if (each.is_output) end_of_outputs = std::max(end_of_outputs, each.end);
    }
}

PyObject *array_type() {
    static PyObject *const type = nanobind::module_::import_("numpy").attr("ndarray").ptr();
    return type;
}

// Bytes of a number of a type of numpy, from bool to double. The field with the size itself has
// another place in numpy 1 than in numpy 2; those before it, which are read here, have not moved.
constexpr int SIZES[] = {1, 1, 1, 2, 2, sizeof(int), sizeof(int), sizeof(long), sizeof(long),
                         8, 8, 4, 8};
static_assert(NPY_BOOL == 0 && NPY_INT == 5 && NPY_LONG == 7 && NPY_LONGLONG == 9 &&
              NPY_DOUBLE == 12);

int size_of(int type_number) {
    return type_number >= 0 && type_number < int(std::size(SIZES)) ? SIZES[type_number] : 0;
}

bool read_array(PyObject *source, const ArrayType &wanted, void *&data, int64_t *shape) noexcept {
    if (!PyObject_TypeCheck(source, reinterpret_cast<PyTypeObject *>(array_type()))) return false;
    auto *array = reinterpret_cast<PyArrayObject *>(source);
    const PyArray_Descr *type = PyArray_DESCR(array);
    const int flags =
        NPY_ARRAY_C_CONTIGUOUS | NPY_ARRAY_ALIGNED | (wanted.is_output ? NPY_ARRAY_WRITEABLE : 0);
    if (PyArray_NDIM(array) != wanted.n_axes || (PyArray_FLAGS(array) & flags) != flags ||
        type->kind != wanted.kind || size_of(type->type_num) != wanted.size ||
        type->byteorder == NPY_OPPBYTE)
        return false;
    data = PyArray_DATA(array);
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
