// Border between Python and C++: what a .cpp needs to offer its functions; see docs/engine.md.
//
// An argument is a scalar, an Array, or a record: a struct of these that Python passes as a
// (named) tuple. An array of another type, shape, stride or alignment, or one that cannot be
// written where it must be, is a TypeError; none is ever copied. What shares memory with an output
// is a ValueError. Memory that runs out is a ResourceError with the first sentence on the function.
// The lock of Python is released while a function runs.
//
// All files include this one: what needs no template is compiled once, in bind.cpp, and the text of
// a signature is put together when a module is loaded, where nanobind would do so in its types.
#pragma once
#include "array.hpp"
#include <nanobind/nanobind.h>
#include <new>
#include <string>
#include <utility>
#include <vector>

namespace rastercov {

template <class S>
concept IsRecord = requires { Record<S>::fields; };

// Calls `each` with all fields of a record.
template <class S, auto... FIELDS, class Each>
void each_field(S &record, Fields<FIELDS...>, Each each) {
    (each(record.*FIELDS), ...);
}

struct Extent { // bytes of an array
    const char *first, *end;
    bool is_output;
};

template <class T> void collect_extents(const T &, std::vector<Extent> &) {}
template <class T, int64_t... E>
void collect_extents(const Array<T, E...> &array, std::vector<Extent> &found) {
    if (array.size())
        found.push_back({reinterpret_cast<const char *>(array.begin()),
                         reinterpret_cast<const char *>(array.end()), !std::is_const_v<T>});
}
template <IsRecord S> void collect_extents(const S &record, std::vector<Extent> &found) {
    each_field(record, Record<S>::fields,
               [&](const auto &field) { collect_extents(field, found); });
}

// Refuses an output that shares memory with another array.
void require_apart(std::vector<Extent> &all);

// The type numpy.ndarray. A module asks for it when it is loaded: later calls do not throw.
PyObject *array_type();

// The letter of numpy for a kind of numbers.
template <class T>
constexpr char KIND = std::is_same_v<T, bool>       ? 'b'
                      : std::is_floating_point_v<T> ? 'f'
                      : std::is_signed_v<T>         ? 'i'
                                                    : 'u';

struct ArrayType {
    char kind;
    int size; // of an element, bytes
    bool is_output;
    int n_axes;
    const int64_t *extents;
};
template <class> struct TypeOf;
template <class T, int64_t... E> struct TypeOf<Array<T, E...>> {
    static constexpr ArrayType type = {KIND<std::remove_const_t<T>>, sizeof(T), !std::is_const_v<T>,
                                       sizeof...(E), Array<T, E...>::EXTENTS.data()};
};

// Sets the address and the shape of an array of numpy; false if it is not of the type.
bool read_array(PyObject *source, const ArrayType &type, void *&data, int64_t *shape) noexcept;

// Text of a type, for signatures.
template <class> struct Type {};
void put_array(std::string &text, const ArrayType &type);
template <class T> void put_type(std::string &text, Type<T>) {
    if constexpr (std::is_void_v<T>) text += "None";
    else if constexpr (std::is_same_v<T, bool>) text += "bool";
    else if constexpr (std::is_integral_v<T>) text += "int";
    else if constexpr (std::is_floating_point_v<T>) text += "float";
    else text += nanobind::type_name(nanobind::type<T>()).c_str();
}
template <class A, class B> void put_type(std::string &text, Type<std::pair<A, B>>) {
    put_type(text += "tuple[", Type<A>());
    put_type(text += ", ", Type<B>());
    text += "]";
}
template <class T, int64_t... E> void put_type(std::string &text, Type<Array<T, E...>>) {
    put_array(text, TypeOf<Array<T, E...>>::type);
}
template <IsRecord S> void put_type(std::string &text, Type<S>) {
    const char *before = "tuple[";
    [&]<auto... FIELDS>(Fields<FIELDS...>) {
        (put_type(text += std::exchange(before, ", "),
                  Type<std::remove_cvref_t<decltype(std::declval<S>().*FIELDS)>>()),
         ...);
    }(Record<S>::fields);
    text += "]";
}

// Signature of a function or of a method, where `self` comes first.
template <class R, class... Args, class... Names>
std::string signature(const char *name, bool is_method, Names... names) {
    static_assert(sizeof...(Names) == sizeof...(Args), "one name an argument");
    std::string text = std::string("def ") + name + (is_method ? "(self" : "(");
    [[maybe_unused]] const char *before = is_method ? ", " : "";
    (put_type(text.append(std::exchange(before, ", ")).append(names).append(": "),
              Type<std::remove_cvref_t<Args>>()),
     ...);
    put_type(text += ") -> ", Type<R>());
    return text;
}

// Memory that ran out; the text is a literal, for there may be no memory for another one.
struct OutOfMemory : std::bad_alloc {
    const char *doing;
    explicit OutOfMemory(const char *doing) : doing(doing) {}
};

// Makes errors of C++ those of Python; once a module.
void translate_errors();

// Calls a function, and says what it was doing where memory runs out.
template <class Call> auto call_within_memory(const char *doing, Call call) {
    try {
        return call();
    } catch (const std::bad_alloc &) {
        throw OutOfMemory(doing);
    }
}

// Calls a function on arguments that share no memory with an output, without the lock of Python.
template <class Call, class... Args>
auto call_apart(const char *doing, Call call, const Args &...args) {
    return call_within_memory(doing, [&] {
        std::vector<Extent> extents;
        (collect_extents(args, extents), ...);
        require_apart(extents);
        const nanobind::gil_scoped_release unlocked;
        return call();
    });
}

// Adds a function to a module, its arguments by name; `doc` is a literal.
template <class R, class... Args, class... Names>
void def(nanobind::module_ &m, const char *name, R (*function)(Args...), const char *doc,
         Names... names) {
    m.def(
        name,
        [function, doc](Args... args) -> R {
            return call_apart(doc, [&] { return function(args...); }, args...);
        },
        nanobind::arg(names)...,
        nanobind::sig(signature<R, Args...>(name, false, names...).c_str()), doc);
}

// Adds a method to a class: a function that takes the object first.
template <class C, class R, class... Args, class... Names>
void def(nanobind::class_<C> &type, const char *name, R (*function)(C &, Args...), const char *doc,
         Names... names) {
    type.def(
        name,
        [function, doc](C &self, Args... args) -> R {
            return call_apart(doc, [&] { return function(self, args...); }, args...);
        },
        nanobind::arg(names)..., nanobind::sig(signature<R, Args...>(name, true, names...).c_str()),
        doc);
}

// Adds a method of the object itself.
template <class C, class R, class... Args, class... Names>
void def(nanobind::class_<C> &type, const char *name, R (C::*method)(Args...), const char *doc,
         Names... names) {
    type.def(
        name,
        [method, doc](C &self, Args... args) -> R {
            return call_apart(doc, [&] { return (self.*method)(args...); }, args...);
        },
        nanobind::arg(names)..., nanobind::sig(signature<R, Args...>(name, true, names...).c_str()),
        doc);
}

// Adds a constructor to a class; an object keeps the first argument alive.
template <class C, class... Args, class... Names>
void def(nanobind::class_<C> &type, nanobind::init<Args...> init, Names... names) {
    type.def(std::move(init), nanobind::arg(names)..., nanobind::keep_alive<1, 2>(),
             nanobind::call_guard<nanobind::gil_scoped_release>(),
             nanobind::sig(signature<void, Args...>("__init__", true, names...).c_str()));
}

} // namespace rastercov

namespace nanobind::detail {

template <class T, int64_t... E> struct type_caster<rastercov::Array<T, E...>> {
    using View = rastercov::Array<T, E...>;
    NB_TYPE_CASTER(View, const_name("array"))

    // The arguments of a call keep the array, so that its memory stays until the call ends.
    bool from_python(handle source, uint32_t, // NOLINT(bugprone-exception-escape): see array_type
                     cleanup_list *) noexcept {
        void *data = nullptr;
        const bool is_right = rastercov::read_array(source.ptr(), rastercov::TypeOf<View>::type,
                                                    data, value.shape.data());
        value.data = static_cast<T *>(data);
        return is_right;
    }
};

template <rastercov::IsRecord S> struct type_caster<S> {
    NB_TYPE_CASTER(S, const_name("tuple"))

    bool from_python(handle source, uint32_t flags, cleanup_list *cleanup) noexcept {
        return [&]<auto... FIELDS>(rastercov::Fields<FIELDS...>) {
            Py_ssize_t k = 0;
            return PyTuple_Check(source.ptr()) &&
                   size_t(PyTuple_Size(source.ptr())) == sizeof...(FIELDS) &&
                   (load(value.*FIELDS, PyTuple_GetItem(source.ptr(), k++), flags, cleanup) && ...);
        }(rastercov::Record<S>::fields);
    }

  private:
    template <class Field>
    static bool load(Field &field, PyObject *item, uint32_t flags, cleanup_list *cleanup) noexcept {
        make_caster<Field> caster;
        if (!caster.from_python(item, flags, cleanup)) return false;
        field = caster.operator cast_t<Field>();
        return true;
    }
};

} // namespace nanobind::detail
