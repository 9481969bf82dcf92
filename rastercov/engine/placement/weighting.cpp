// Search for fewer cameras that cover every face, by weights of faces.
//
// One camera fewer than a cover leaves faces open. A step removes the camera whose loss is least,
// adds the one of greatest gain among those that cover an open face, taken at random, and raises
// the weight of each face still open by 1, so that faces that are hard to cover come to count most.
// The camera that was just added is not removed next; one that was removed is added again only
// after another that shares a face with it has changed. Of equal ones the one that changed first is
// taken, then the first by rank.
//
// The gain of a candidate is the weight of its open faces, the loss of a chosen camera that of its
// faces that would be open without it. One number has both, because a change of a camera leaves its
// own as it is. Weights are integers, so it is exact.
//
// C. Gao, X. Yao, T. Weise, J. Li. An efficient local search heuristic with row weighting for the
// unicost set covering problem. 2015.
//
// Twin: tests/placement/test_weighting.py, by dense arrays.
#include "bind.hpp"
#include "interrupt.hpp"

namespace rastercov {
namespace placement {
namespace {

constexpr int64_t NONE = -1;

struct Pairs { // of C candidates and F faces, both ways, and the views that each face needs
    IntArray indptr;
    Int32Array face;
    IntArray starts;
    Int32Array covering;
    Int32Array views;

    void check() const {
        const int64_t n = indptr.rows() - 1, n_faces = views.rows();
        require(n >= 0 && starts.rows() == n_faces + 1 && covering.rows() == face.rows(),
                "indptr must have one row for each candidate and one more, starts for each face");
        require(rises(indptr, face.rows()) && rises(starts, face.rows()),
                "limits of rows must rise from 0 to the number of pairs");
        require_indices(face, n_faces, "face must hold faces");
        require_indices(covering, n, "covering must hold candidates");
    }

    static bool rises(const IntArray &limits, int64_t last) {
        bool is_right = limits[0] == 0 && limits[limits.rows() - 1] == last;
        for (int64_t i = 1; i < limits.rows(); i++) is_right &= limits[i - 1] <= limits[i];
        return is_right;
    }
};

struct Sought {                   // state of a search, kept between calls
    Column<uint8_t> is_chosen;    // cameras now, which may leave faces open
    Column<int64_t> weight;       // of each face
    Column<int64_t> changed;      // step at which each candidate changed last
    Column<uint8_t> is_held_back; // removed, and nothing near it has changed since
    Column<int64_t> last;         // steps so far, and the camera added last or -1
};

class Search {
  public:
    Search(const Pairs &pairs, IntArray rank, const Sought &sought)
        : _pairs(pairs), _rank(rank), _s(sought), _count(size_t(pairs.views.rows())),
          _place(_count.size(), NONE), _score(size_t(rank.rows())) {
        for (int64_t c = 0; c < rank.rows(); c++)
            if (_s.is_chosen[c])
                for (int64_t j = _pairs.indptr[c]; j < _pairs.indptr[c + 1]; j++)
                    _count[size_t(_pairs.face[j])]++;
        for (int64_t f = 0; f < _pairs.views.rows(); f++)
            if (count(f) < _pairs.views[f]) open(f);
        for (int64_t c = 0; c < rank.rows(); c++)
            for (int64_t j = _pairs.indptr[c]; j < _pairs.indptr[c + 1]; j++) {
                const int64_t f = _pairs.face[j];
                if (count(f) - _s.is_chosen[c] < _pairs.views[f]) _score[size_t(c)] += _s.weight[f];
            }
    }

    bool is_cover() const { return _open.empty(); }
    int64_t work() const { return _work; }

    // Removes the camera of least loss.
    void drop() {
        int64_t worst = NONE;
        for (int64_t c = 0; c < _rank.rows(); c++)
            if (_s.is_chosen[c] && c != _s.last[1] && is_before(c, worst, -1)) worst = c;
        _work += _rank.rows();
        if (worst != NONE) change(worst, -1);
    }

    // Adds the camera of greatest gain of those that cover an open face.
    void add(uint32_t number) {
        const int64_t f = _open[number % _open.size()];
        int64_t best = NONE;
        for (int64_t i = _pairs.starts[f]; i < _pairs.starts[f + 1]; i++) {
            const int64_t c = _pairs.covering[i];
            if (!_s.is_chosen[c] && !_s.is_held_back[c] && is_before(c, best, 1)) best = c;
        }
        if (best == NONE) return;
        change(best, 1);
        _s.last[1] = best;
    }

    void weigh() {
        for (const int64_t f : _open) {
            _s.weight[f]++;
            each(f, [&](int64_t c) { _score[size_t(c)]++; });
        }
    }

  private:
    const Pairs &_pairs;
    IntArray _rank;
    const Sought &_s;
    std::vector<int32_t> _count; // chosen cameras of each face
    std::vector<int64_t> _open;  // open faces, in any order
    std::vector<int64_t> _place; // of each face among them, or NONE
    std::vector<int64_t> _score; // gain or loss of each candidate
    int64_t _work = 0;

    int64_t count(int64_t f) const { return _count[size_t(f)]; }

    // True if a candidate goes before another: by score times `sign`, then age, then rank.
    bool is_before(int64_t c, int64_t other, int64_t sign) const {
        if (other == NONE) return true;
        const int64_t ahead = sign * (_score[size_t(c)] - _score[size_t(other)]);
        if (ahead != 0) return ahead > 0;
        if (_s.changed[c] != _s.changed[other]) return _s.changed[c] < _s.changed[other];
        return _rank[c] < _rank[other];
    }

    template <class Visit> void each(int64_t f, Visit visit) {
        for (int64_t i = _pairs.starts[f]; i < _pairs.starts[f + 1]; i++)
            visit(int64_t(_pairs.covering[i]));
        _work += _pairs.starts[f + 1] - _pairs.starts[f];
    }

    void open(int64_t f) {
        _place[size_t(f)] = int64_t(_open.size());
        _open.push_back(f);
    }

    void close(int64_t f) {
        const int64_t place = _place[size_t(f)], moved = _open.back();
        _open[size_t(place)] = moved;
        _place[size_t(moved)] = place;
        _place[size_t(f)] = NONE;
        _open.pop_back();
    }

    // Adds (sign 1) or removes (-1) a camera.
    void change(int64_t camera, int sign) {
        for (int64_t j = _pairs.indptr[camera]; j < _pairs.indptr[camera + 1]; j++) {
            const int64_t f = _pairs.face[j];
            const int32_t views = _pairs.views[f];
            const int32_t before = _count[size_t(f)];
            const int32_t fewer = std::min(before, before + sign); // of the two numbers
            _count[size_t(f)] = before + sign;
            const bool crosses = fewer == views - 1; // open on one side
            if (crosses && sign > 0) close(f);
            if (crosses && sign < 0) open(f);
            const int64_t amount = -sign * _s.weight[f];
            each(f, [&](int64_t c) {
                _s.is_held_back[c] = 0;
                if (c != camera && fewer == (_s.is_chosen[c] ? views : views - 1))
                    _score[size_t(c)] += amount;
            });
        }
        _s.is_chosen[camera] = sign > 0;
        _s.is_held_back[camera] = sign < 0;
        _s.changed[camera] = _s.last[0];
    }
};

int64_t fewer_cameras(const Pairs &pairs, IntArray rank, Column<const uint32_t> numbers,
                      int64_t enough, const Sought &sought, Column<uint8_t> best) {
    pairs.check();
    const int64_t n = pairs.indptr.rows() - 1;
    require(have_rows(n, rank, sought.is_chosen, sought.changed, sought.is_held_back, best) &&
                sought.weight.rows() == pairs.views.rows() && sought.last.rows() == 2,
            "rank, is_chosen, changed, is_held_back and best must have one row for each candidate, "
            "weight one for each face, last two");
    Search search(pairs, rank, sought);
    const auto n_chosen = [&] {
        return std::count(sought.is_chosen.begin(), sought.is_chosen.end(), uint8_t(1));
    };
    Poll poll(64);
    for (const uint32_t number : numbers) {
        poll();
        sought.last[0]++;
        while (search.is_cover()) {
            std::copy(sought.is_chosen.begin(), sought.is_chosen.end(), best.begin());
            if (n_chosen() <= enough) return search.work();
            sought.last[1] = NONE;
            search.drop();
        }
        search.drop();
        if (search.is_cover()) continue;
        search.add(number);
        search.weigh();
    }
    if (search.is_cover())
        std::copy(sought.is_chosen.begin(), sought.is_chosen.end(), best.begin());
    return search.work();
}

} // namespace
} // namespace placement

RECORD(placement::Pairs, indptr, face, starts, covering, views);
RECORD(placement::Sought, is_chosen, weight, changed, is_held_back, last);

void register_placement_weighting(nanobind::module_ &m) {
    using namespace placement;
    def(m, "fewer_cameras", fewer_cameras,
        "Set `best`, (C,), to the smallest cover that a step finds; the work it took.\n\n"
        "A step for each of the random `numbers`, until a cover of `enough` cameras or fewer. The\n"
        "search goes on from its state `sought`; without a cover `best` remains as it is.",
        "pairs", "rank", "numbers", "enough", "sought", "best");
}

} // namespace rastercov
