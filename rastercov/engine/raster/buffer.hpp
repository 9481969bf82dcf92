// Zeros that start at a cache line, so that no block of samples crosses into a second one.
//
// Twins: tests/raster/test_clusters.py.
#pragma once
#include "raster/records.hpp"
#include <memory>
#include <new>

namespace rastercov::raster {

template <class T> struct Buffer {
    struct Free {
        void operator()(T *data) const { ::operator delete[](data, std::align_val_t(CACHE_LINE)); }
    };
    std::unique_ptr<T[], Free> memory;
    Column<T> all;

    Buffer() : Buffer(0) {}
    explicit Buffer(int64_t n)
        : memory(new (std::align_val_t(CACHE_LINE)) T[size_t(n)]()), all{memory.get(), {n}} {}
};

} // namespace rastercov::raster
