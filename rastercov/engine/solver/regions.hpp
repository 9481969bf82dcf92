// Parts of faces that a pose covers, as convex polygons in their planes, with their memory.
//
// Twins: tests/area/test_regions.py, tests/area/test_lens_regions.py.
#pragma once
#include "area/region.hpp"
#include "solver/camera.hpp"
#include "solver/plane_solver.hpp"

namespace rastercov::engine {

// Regions of one pose.
struct Regions {
    std::vector<double> xy; // corners of pieces, by piece
    std::vector<int64_t> n_corners;
    std::vector<int32_t> face; // of each piece
    // Faces with an area or a bound, m^2; `excess` is the part of the bound that can lessen it.
    std::vector<int32_t> listed;
    std::vector<double> area, bound, excess;
    std::vector<double> cut_short; // area that no density decides because divisions ended, m^2
};

class RegionCutter {
  public:
    // Cuts what is visible through a pinhole, or in one ideal plane of a lens, and adds it to
    // `out`.
    void cut(const PlaneSolver &solved, const area::Planes &planes, const area::LensCriteria &given,
             bool is_lens, std::vector<Regions> &out);

  private:
    struct Room2 { // what one step finds
        Room<double> xy, area, bound, doubt;
        Room<int64_t> starts;
        Room<int32_t> face;
        int64_t used[2];
        double cut_short;
        area::Found found;
    };
    template <class Step> const area::Found &run(Room2 &room, int64_t n_faces, Step step);
    static void make(Room2 &room, int64_t n, int64_t corners, int64_t n_faces);

    Room2 _rooms[2];
};

// What was found, with the faces that have an area or a bound.
Regions copy_regions(const area::Found &found);

// Regions of the planes of one pose in one table, by face.
Regions join_regions(std::vector<Regions> parts, const area::Planes &planes);

} // namespace rastercov::engine
