// Edges that are an event for some camera centre: behind them it may see what another one does not.
//
// Twins: rastercov.reference.tolerance, point by point.
#pragma once
#include "exact/segments.hpp"
#include "tolerance/mount.hpp"

namespace rastercov::engine {

// Listed by the cells of a grid over the image.
class EventField {
  public:
    struct Edge {
        area::Hiding hiding;
        int32_t index;
        double tangent;    // of the disc of parallel rays, or 0
        double nearest;    // least depth
        double grow = 0.0; // distance in the image within which it may seem to be, by depth: see
                           // `reach`
        double u[2] = {}, v[2] = {}; // ends in the image, at depth 1

        double deepest() const { return std::max(hiding.ends[0].z, hiding.ends[1].z); }
        // That distance for what it hides up to a depth.
        double reach(double deepest, double d) const {
            if (tangent > 0) return tangent * (deepest - nearest);
            return grow * std::clamp(1 - (nearest - d) / deepest, 0.0, 1.0);
        }
        // Its extent in the image, and a margin.
        exact::Bounds box(double margin) const {
            return {std::min(u[0], u[1]) - margin, std::max(u[0], u[1]) + margin,
                    std::min(v[0], v[1]) - margin, std::max(v[0], v[1]) + margin};
        }
        // Sets its ends in the image.
        void project();
        // Sets it to a part of what it was, from 0 to 1.
        void set_part(const Edge &whole, const exact::Part &part);
        // Distance from another one in the image.
        double distance(const Edge &other) const;
    };

    // False if the surface may be so near to a camera centre, in view, that nothing is bounded.
    // `border` has the inward normals of the widest image.
    bool set(const Posed &of, const std::array<Vector, 4> &border, double widest);
    // The same of a disc of parallel rays, whose image has this half side.
    void set_parallel(const Posed &of, double widest);
    void clear() {
        _edges.clear();
        _n_events = 0;
    }
    const std::vector<Edge> &edges() const { return _edges; }
    // Sets it to some of its edges, or parts of these.
    void set(std::vector<Edge> &&edges);
    // Leaves what some camera centre may see of the edges: along what the nominal one sees, and
    // where shadows of such parts of others reach, again and again.
    void narrow(const Posed &seen);
    int64_t n_events() const { return _n_events; }
    // Greatest tangent of the angle of a ray in view with the nominal axis.
    double widest() const { return _widest; }

    // Calls with the edges whose extent and margin reach into a box of the image, each once until
    // `begin`.
    void begin() { _round++; }
    template <class Each> void each_in(const exact::Bounds &box, Each each) {
        const int64_t left = cell_of(box.u_min), right = cell_of(box.u_max);
        const int64_t top = cell_of(box.v_min), bottom = cell_of(box.v_max);
        for (int64_t row = top; row <= bottom; row++)
            for (int64_t cell = row * _side + left; cell <= row * _side + right; cell++)
                for (int64_t at = _starts[size_t(cell)]; at < _starts[size_t(cell) + 1]; at++) {
                    const auto k = size_t(_entries[size_t(at)]);
                    const Edge &edge = _edges[k];
                    if (_seen[k] == _round || are_apart(edge.box(edge.grow), box)) continue;
                    _seen[k] = _round;
                    each(k);
                }
    }

  private:
    template <class Height> void set_sides(const FacePlanes &planes, double margin, Height height);
    template <class Each> bool each_event(const Posed &of, Each each);
    void list_edges();
    template <class Visit> void each_cell(const Edge &edge, Visit visit) const;
    int64_t cell_of(double at) const {
        return std::clamp(int64_t((at / _widest + 1) * double(_side) / 2), int64_t(0), _side - 1);
    }

    double _widest = 0.0;
    int64_t _side = 1;
    int64_t _n_events = 0;
    std::vector<Edge> _edges;
    std::vector<int8_t> _sides; // of faces: which all camera centres see, 0 for none
    std::vector<int64_t> _starts;
    std::vector<int32_t> _entries;
    std::vector<int64_t> _seen;
    int64_t _round = 0;
};

} // namespace rastercov::engine
