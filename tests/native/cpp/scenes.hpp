// A unit box, cameras that look at it, and handles that are freed at the end of a test.
#pragma once
#include "rastercov.h"
#include <array>
#include <stddef.h>
#include <vector>

struct Scene {
    std::vector<double> vertices = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0,
                                    0, 0, 1, 1, 0, 1, 1, 1, 1, 0, 1, 1};
    std::vector<int32_t> faces = {0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7, 0, 1, 5, 0, 5, 4,
                                  1, 2, 6, 1, 6, 5, 2, 3, 7, 2, 7, 6, 3, 0, 4, 3, 4, 7};
    rc_camera camera = {sizeof(rc_camera), 640, 480, 800, 800, 320, 240, 0, nullptr, 0};
    rc_task task = rc_task_default();
    // From above, at heights of 4 m and more.
    std::vector<double> poses(int64_t n) const {
        std::vector<double> all;
        for (int64_t p = 0; p < n; p++)
            for (const double each :
                 {1., 0., 0., .5, 0., -1., 0., .5, 0., 0., -1., 4. + double(p), 0., 0., 0., 1.})
                all.push_back(each);
        return all;
    }
    int64_t n_faces() const { return int64_t(faces.size() / 3); }
    rc_surface *surface(const uint8_t *roles = nullptr) const {
        rc_surface *made = nullptr;
        rc_surface_create(vertices.data(), int64_t(vertices.size() / 3), faces.data(), n_faces(),
                          roles, &made);
        return made;
    }
};

inline int64_t n_handles() {
    int64_t n = -1;
    rc_count_handles(&n);
    return n;
}

struct Figures {
    std::vector<double> visible, area, error;
    std::vector<uint8_t> certified;
    Figures(int64_t n, double value)
        : visible(size_t(n), value), area(visible), error(visible), certified(size_t(n), 7) {}
    rc_figures out() { return {visible.data(), area.data(), error.data(), certified.data()}; }
};
