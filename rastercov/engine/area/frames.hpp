// Frame of a face, see rastercov.core.area.polygons.
//
// The third corner is orthogonalized against the longest edge twice, so that y is right to its last
// digits. Scalar products add in one order everywhere.
//
// Twin: tests/area/test_face_frames.py.
#pragma once
#include <cmath>

namespace rastercov::area {

struct Frame {
    double origin[3], x_axis[3] = {}, y_axis[3], longest = -1.0, x, y;

    explicit Frame(const double *const (&points)[3]) {
        int first = 0;
        for (int k = 0; k < 3; k++) {
            double side[3];
            for (int i = 0; i < 3; i++) side[i] = points[(k + 1) % 3][i] - points[k][i];
            const double length = std::sqrt(dot(side, side));
            if (!(length > longest)) continue;
            longest = length;
            first = k;
            for (int i = 0; i < 3; i++) x_axis[i] = side[i] / length;
        }
        const double *const third = points[(first + 2) % 3];
        double away[3], across[3];
        for (int i = 0; i < 3; i++) {
            origin[i] = points[first][i];
            away[i] = third[i] - origin[i];
        }
        x = dot(away, x_axis);
        for (int i = 0; i < 3; i++) across[i] = away[i] - x * x_axis[i];
        const double left = dot(across, x_axis);
        for (int i = 0; i < 3; i++) across[i] -= left * x_axis[i];
        y = std::sqrt(dot(across, across));
        for (int i = 0; i < 3; i++) y_axis[i] = across[i] / y;
    }
    double area() const { return longest * y / 2; }
    double normal(int i) const {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        return x_axis[j] * y_axis[k] - x_axis[k] * y_axis[j];
    }

  private:
    static double dot(const double *a, const double *b) {
        return (a[0] * b[0] + a[2] * b[2]) + a[1] * b[1];
    }
};

} // namespace rastercov::area
