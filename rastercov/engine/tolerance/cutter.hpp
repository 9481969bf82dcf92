// Parts of faces that a pinhole covers whatever the errors of its mounting, and those that it may
// cover with some.
//
// Invariants: what is sure lies in the nominal regions; each method can be called again after an
// error.
//
// Twins: rastercov.reference.tolerance, point by point.
#pragma once
#include "area/circle.hpp"
#include "tolerance/events.hpp"
#include "tolerance/shapes.hpp"
#include "tolerance/tolerance.hpp"

namespace rastercov::engine {

constexpr double MARGIN_REL = 1e-9; // of the diagonal, by which the ball is larger: rounding

// Depths in focus and dense enough on a plane at a height, whatever the errors (sign -1), or with
// some (+1); before the error of the depth itself.
struct DepthRange {
    double least, most;
};
DepthRange depths_of(const Mount &mount, const Rules &rules, double height, double sign);

// Factor by which errors may lessen the density along the worst direction in a polygon, but for the
// focal length: 0 where there is no bound. See docs/appendix/tolerance.md.
double density_factor(const Mount &mount, const Plane &plane, const Corners &polygon);

// Appends the part of a polygon within a circle that is dense enough.
void append_criteria(int64_t f, const Points &polygon, area::Circle &circle,
                     area::Criteria criteria, area::Scratch &scratch, const area::Found &out);

struct Directions;

class ToleranceCutter {
  public:
    // Part of nominal regions that is covered whatever the errors.
    Tolerated sure(const Posed &nominal);
    // Parts that are covered with some errors, of what the nominal camera centre sees of both sides
    // of all faces in a wider image.
    Tolerated possible(const Posed &seen);
    // Areas of faces by a disc of parallel rays, (F, 3), m^2: what all of it lights, at least and
    // at most, and what some of it may light. `lit` are the regions of its middle, of both sides.
    void sweep(const Posed &lit, Array<double, Any, 3> areas);

  private:
    // Regions that grow; see area::Found.
    struct Pieces {
        Room<double> xy, area, bound, doubt;
        Room<int64_t> starts;
        Room<int32_t> face;
        int64_t used[2];
        double cut_short;

        area::Found all() {
            return {xy.rows<2>(xy.size() / 2),
                    starts.all(),
                    face.all(),
                    {used, {2}},
                    area.all(),
                    bound.all(),
                    doubt.all(),
                    {&cut_short, {1}}};
        }
        void make(int64_t n, int64_t corners, int64_t n_faces) {
            xy.take(2 * corners);
            starts.take(n + 1);
            starts[0] = 0;
            face.take(n);
            for (Room<double> *each : {&area, &bound, &doubt}) each->take(n_faces);
        }
        // What a step finds, with more room as it needs it.
        template <class Step> void run(int64_t n_faces, Step step) {
            if (area.size() != n_faces) make(first_room(1024), first_room(8192), n_faces);
            while (true) {
                used[0] = used[1] = 0;
                cut_short = 0.0;
                for (Room<double> *each : {&area, &bound, &doubt}) each->fill(0.0);
                step(all());
                if (used[0] <= face.size() && 2 * used[1] <= xy.size()) return;
                make(more_room(used[0]), more_room(used[1]), n_faces);
            }
        }
    };
    // Sets what all steps of a pose need; false where the surface may reach a camera centre.
    bool begin(const Posed &of, bool is_sure, Tolerated &result);
    // Sets `_shapes` to the shadows on the face of `_scratch` of edges that may reach some pieces;
    // false where one has no end.
    bool cast(const Posed &of, const area::PieceTable &pieces, int64_t first, int64_t last,
              Tolerated &result);
    void cut_face(int64_t f, const Posed &of, const Directions &directions, int64_t first,
                  int64_t last, const area::Found &out);
    void cut_criteria(const Posed &of, const area::Found &out);
    void subtract_shadows(const Posed &of, const area::PieceTable &from, const area::Found &out,
                          Tolerated &result);
    double lay(const Corners &polygon);
    void hide_seen(int64_t f, const Posed &seen, const Corners &whole);
    double lay_shadows(const Posed &seen, Tolerated &result);
    bool lay_possible(int64_t f, const Posed &seen, const Corners &whole, const area::Found &out,
                      Tolerated &result);
    void add_possible(int64_t f, const Posed &seen, const area::Found &out, Tolerated &result);
    double left_of(const Posed &of, const area::PieceTable &pieces, int64_t first, int64_t last,
                   double if_unbounded);
    // Of parts that are not seen.
    int64_t n_hidden() const { return int64_t(_hidden_starts.size()) - 1; }
    area::PieceTable hidden() const {
        return {{_hidden_xy.data(), {_hidden_starts.back()}},
                {_hidden_starts.data(), {n_hidden() + 1}},
                {}};
    }

    std::array<Vector, 4> _border; // inward normals of the widest image
    EventField _field;
    Pieces _cut, _left;
    area::Scratch _scratch;
    area::Overlay _overlay;
    std::vector<double> _hidden_xy;
    std::vector<int64_t> _hidden_starts;
    struct Cast {
        double xy[2 * area::MOST_SHADOW_CORNERS];
        int64_t n;
        exact::Bounds box;
        double area;
    };
    std::vector<Cast> _shadows;
    Shapes _shapes;
};

} // namespace rastercov::engine
