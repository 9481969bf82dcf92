// Packets of coherent rays through the pixels of one pose, and the hits of each face.
//
// A packet is a block of 4 x 4 pixels, or 4 x 2, or 2 x 2, with a ray through each pixel centre.
// Compiled by
// embree_packets.py, which sets RAYS and passes Embree's function `rtcIntersect16`, 8 or 4.
#include <algorithm>
#include <cstdint>
#include <limits>

namespace {
constexpr int LANES = RAYS, ACROSS = RAYS == 4 ? 2 : 4, DOWN = LANES / ACROSS;
constexpr std::uint32_t ALL = 0xffffffffu;

// RTCRayHit16, 8 and 4 of rtcore_ray.h, with 8 levels of instances, the most that builds of Embree
// have.
struct alignas(64) Packet {
    float origin[3][LANES], nearest[LANES], direction[3][LANES], time[LANES], farthest[LANES];
    std::uint32_t mask[LANES], id[LANES], flags[LANES];
    float normal[3][LANES], u[LANES], v[LANES];
    std::uint32_t primitive[LANES], geometry[LANES], instances[2 * 8][LANES];
};
using Intersect = void(const void *valid, void *scene, Packet *packet, void *arguments);
} // namespace

// `lens` has fx, fy, cx, cy in px, `pose` is (3, 4), camera to world, by rows, `counts` has a
// number for each face. `image`, height x width, takes the face of each pixel, -1 for none; it may
// be null.
extern "C" void cast(Intersect *intersect, void *scene, void *arguments, int width, int height,
                     const double *lens, const double *pose, std::int32_t *counts,
                     std::int32_t *image) {
    const double fx = lens[0], fy = lens[1], cx = lens[2], cy = lens[3];
    Packet packet = {};
    alignas(64) std::uint32_t valid[LANES];
    std::fill_n(packet.mask, LANES, ALL);
    float steps[3][LANES];
    for (int k = 0; k < 3; ++k)
        for (int lane = 0; lane < LANES; ++lane) {
            packet.origin[k][lane] = float(pose[4 * k + 3]);
            steps[k][lane] =
                float(pose[4 * k] * (lane % ACROSS) / fx + pose[4 * k + 1] * (lane / ACROSS) / fy);
        }
    for (int top = 0; top < height; top += DOWN)
        for (int left = 0; left < width; left += ACROSS) {
            const double x = (left + 0.5 - cx) / fx, y = (top + 0.5 - cy) / fy;
            for (int k = 0; k < 3; ++k) {
                const float corner = float(pose[4 * k] * x + pose[4 * k + 1] * y + pose[4 * k + 2]);
                for (int lane = 0; lane < LANES; ++lane)
                    packet.direction[k][lane] = corner + steps[k][lane];
            }
            std::fill_n(packet.farthest, LANES, std::numeric_limits<float>::infinity());
            std::fill_n(packet.geometry, LANES, ALL);
            const int columns = width - left, rows = height - top;
            for (int lane = 0; lane < LANES; ++lane)
                valid[lane] = lane % ACROSS < columns && lane / ACROSS < rows ? ALL : 0;
            intersect(valid, scene, &packet, arguments);
            for (int lane = 0; lane < LANES; ++lane) {
                const bool hit = packet.geometry[lane] != ALL;
                if (hit) ++counts[packet.primitive[lane]];
                if (image && valid[lane])
                    image[std::int64_t(top + lane / ACROSS) * width + left + lane % ACROSS] =
                        hit ? std::int32_t(packet.primitive[lane]) : -1;
            }
        }
}
