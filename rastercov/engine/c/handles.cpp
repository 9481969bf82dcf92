// What all calls of a library share.
//
// Twin: tests/native/test_c_border.py.
#include "c/objects.hpp"

namespace rastercov::c {
uintptr_t Handles::append(std::shared_ptr<void> object, const char *kind) {
    const std::scoped_lock lock(_changes);
    _all.push_back({++_last, std::move(object), kind});
    return _last;
}

std::shared_ptr<void> Handles::find(const void *handle, const char *kind, const char *name,
                                    bool frees) {
    const std::scoped_lock lock(_changes);
    const auto number = reinterpret_cast<uintptr_t>(handle);
    const auto is_before = [&](const Entry &each) { return each.number < number; };
    const auto entry = std::partition_point(_all.begin(), _all.end(), is_before);
    if (entry == _all.end() || entry->number != number || !entry->object || entry->kind != kind) {
        std::string text = "expected a live handle of type ";
        text += name;
        text += handle ? ", got one that was freed or has another type" : ", got null";
        text += "; create one, and free it once";
        refuse(text.c_str());
    }
    if (!frees) return entry->object;
    const auto object = std::move(entry->object);
    if (2 * ++_n_freed > _all.size()) {
        std::erase_if(_all, [](const Entry &each) { return !each.object; });
        _n_freed = 0;
    }
    return object;
}

int64_t Handles::count() {
    const std::scoped_lock lock(_changes);
    return int64_t(_all.size() - _n_freed);
}

Handles &handles() {
    static Handles all;
    return all;
}

std::string &last_error() {
    thread_local std::string text = "no call of this thread has failed";
    return text;
}
} // namespace rastercov::c
