// The least and the greatest of some numbers.
#pragma once
#include <algorithm>
#include <limits>

namespace rastercov {

struct Range {
    double least = std::numeric_limits<double>::infinity();
    double most = -least;

    void add(double value) {
        least = std::min(least, value);
        most = std::max(most, value);
    }
    void add(const Range &other) {
        add(other.least);
        add(other.most);
    }
};

// Of the coordinates of some points in a plane.
struct Rectangle {
    Range x, y;

    void add(double at_x, double at_y) {
        x.add(at_x);
        y.add(at_y);
    }
};

} // namespace rastercov
