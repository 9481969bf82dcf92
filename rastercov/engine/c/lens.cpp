// Lenses of C: records of ideal planes from one row of numbers.
//
// Twins: tests/native/test_wasm.py, tests/native/test_c_border.py.
#include "c/objects.hpp"

namespace rastercov::c {
namespace {
constexpr int64_t PARTS = lens::CELLS * lens::PARTS;
constexpr double MOST_NUMBERS = 1e8;
constexpr auto WANTED = "expected numbers of rc_lens_read; read them anew";

// Reads numbers one after another; refuses what is not there.
class Reader {
  public:
    explicit Reader(const std::vector<double> &numbers)
        : _at(numbers.data()), _end(numbers.data() + numbers.size()) {}

    const double *take(int64_t n) {
        require(n >= 0 && n <= _end - _at, WANTED);
        const double *const first = _at;
        _at += n;
        return first;
    }
    double number() { return *take(1); }
    // A whole number within 0 ... most, or from `least` on.
    int64_t count(double most, double least = 0.0) {
        const double value = number();
        require(value >= least && value <= most && value == std::floor(value), WANTED);
        return int64_t(value);
    }
    bool is_at_end() const { return _at == _end; }

  private:
    const double *_at, *_end;
};

lens::PlaneRecord record_of(Reader &from) {
    lens::PlaneRecord record = {};
    record.code = from.count(double(lens::N_BASES));
    record.params = {from.take(lens::SIZE), {}};
    record.frame = {from.take(9), {}};
    for (double *each : {&record.fx, &record.fy, &record.cx, &record.cy}) *each = from.number();
    int64_t sizes[3];
    for (int64_t &each : sizes) each = from.count(double(MOST_SIDES));
    lens::Corners *const polygons[] = {&record.region, &record.hole, &record.window};
    for (int k = 0; k < 3; k++) *polygons[k] = {from.take(2 * sizes[k]), {sizes[k]}};
    record.longest = {from.take(lens::TABLE), {}};
    record.parts_of = from.count(double(lens::MOST), double(lens::FEWEST));
    record.is_graded = from.count(1.0) != 0;
    for (double *each : {&record.width, &record.height, &record.bend, &record.stretch,
                         &record.speed, &record.tolerance, &record.arc_half, &record.arc_bend})
        *each = from.number();
    return record;
}

// Children and kinds are whole numbers of their own types, from `children` and `kinds` on.
lens::Tree tree_of(Reader &from, int32_t *children, uint8_t *kinds) {
    const int64_t n = from.count(MOST_NUMBERS);
    const auto root = from.count(double(n) - 1, double(lens::UNDECIDED));
    const double *const lines = from.take(3 * n);
    for (int64_t k = 0; k < 2 * n; k++)
        children[k] = int32_t(from.count(double(n) - 1, double(lens::UNDECIDED)));
    for (int64_t k = 0; k < n; k++) kinds[k] = uint8_t(from.count(2.0));
    return {{lines, {n}}, {children, {n}}, {kinds, {n}}, root};
}

lens::Slopes slopes_of(Reader &from) {
    lens::Slopes slopes = {};
    for (double *each : {&slopes.low_x, &slopes.low_y, &slopes.per_x, &slopes.per_y})
        *each = from.number();
    slopes.second = {from.take(PARTS * PARTS), {}};
    slopes.third = {from.take(PARTS * PARTS), {}};
    slopes.sizes = {from.take(2 * lens::CELLS * lens::CELLS), {}};
    slopes.near_axis = {from.take(4), {}};
    return slopes;
}

Lens pinhole_of(Reader &from) {
    Lens pinhole = {};
    for (double *each :
         {&pinhole.fx, &pinhole.fy, &pinhole.cx, &pinhole.cy, &pinhole.width, &pinhole.height})
        *each = from.number();
    require(pinhole.fx > 0 && pinhole.fy > 0 && pinhole.width > 0 && pinhole.height > 0, WANTED);
    return pinhole;
}

// Sets the rows of the lens for loops over faces to those of its planes.
void set_rows(LensObject &to) {
    constexpr int64_t POLYGON = 2 * MOST_SIDES;
    const auto n = int64_t(to.planes.size());
    const int64_t sizes[] = {9, lens::SIZE, POLYGON, POLYGON, lens::TABLE, 1, 1, 1};
    double *columns[8];
    int64_t total = 0;
    for (const int64_t size : sizes) total += size * n;
    to.rows.assign(size_t(total), 0.0);
    double *at = to.rows.data();
    for (int k = 0; k < 8; at += sizes[k++] * n) columns[k] = at;
    to.counts.assign(size_t(3 * n), 0);
    to.flags = std::make_unique<bool[]>(size_t(n));
    for (int64_t p = 0; p < n; p++) {
        const lens::PlaneRecord &plane = to.planes[size_t(p)].record;
        const auto put = [&](int column, const double *from, int64_t count) {
            std::copy_n(from, count, columns[column] + sizes[column] * p);
        };
        put(0, plane.frame.begin(), 9);
        put(1, plane.params.begin(), lens::SIZE);
        put(2, plane.region.begin(), plane.region.size());
        put(3, plane.hole.begin(), plane.hole.size());
        put(4, plane.longest.begin(), lens::TABLE);
        put(5, &plane.bend, 1);
        put(6, &plane.arc_half, 1);
        put(7, &plane.arc_bend, 1);
        to.counts[size_t(p)] = plane.region.rows();
        to.counts[size_t(n + p)] = plane.hole.rows();
        to.counts[size_t(2 * n + p)] = plane.parts_of;
        to.flags[size_t(p)] = plane.is_graded;
    }
    CurvedLens &curved = to.curved;
    curved.frames = {columns[0], {n}};
    curved.own_params = {columns[1], {n}};
    curved.regions = {columns[2], {n}};
    curved.holes = {columns[3], {n}};
    curved.longest = {columns[4], {n}};
    curved.bends = {columns[5], {n}};
    curved.arc_halves = {columns[6], {n}};
    curved.arc_bends = {columns[7], {n}};
    curved.region_sides = {to.counts.data(), {n}};
    curved.hole_sides = {to.counts.data() + n, {n}};
    curved.parts_of = {to.counts.data() + 2 * n, {n}};
    curved.is_graded = {to.flags.get(), {n}};
    curved.tolerance = to.planes[0].record.tolerance;
}

} // namespace

std::shared_ptr<LensObject> lens_from(std::vector<double> numbers) {
    auto made = std::make_shared<LensObject>();
    made->numbers = std::move(numbers);
    made->children.resize(made->numbers.size());
    made->kinds.resize(made->numbers.size());
    Reader from(made->numbers);
    CurvedLens &curved = made->curved;
    curved.code = from.count(double(lens::N_BASES));
    curved.by_distance = from.count(1.0) != 0;
    made->has_closed_form = from.count(1.0) != 0;
    const int64_t n = from.count(64.0, 1.0);
    curved.width = from.number();
    curved.height = from.number();
    from.number(); // the blind area
    curved.params = {from.take(lens::SIZE), {}};
    int64_t used = 0;
    for (int64_t k = 0; k < n; k++) {
        const lens::PlaneRecord record = record_of(from);
        made->planes.push_back({record, pinhole_of(from)});
        made->trees.push_back(
            tree_of(from, made->children.data() + 2 * used, made->kinds.data() + used));
        used += made->trees.back().lines.rows();
        made->slopes.push_back(slopes_of(from));
    }
    require(from.is_at_end(), WANTED);
    set_rows(*made);
    return made;
}

std::shared_ptr<engine::CameraTask> LensObject::task_of(const Rules &rules) const {
    require(!has_closed_form || rules.min_pixels_per_m2 <= 0,
            "expected min_pixels_per_m2 0 for a lens of equal area or a panorama; leave it out");
    // What else there is in the plane, the lens decides.
    Rules of_pinhole = rules;
    of_pinhole.z_n = of_pinhole.min_pixel_density = of_pinhole.min_facing_density = 0.0;
    of_pinhole.min_pixels_per_m2 = 0.0;
    of_pinhole.z_f = INFINITY;
    auto task = std::make_shared<engine::CameraTask>();
    for (size_t k = 0; k < planes.size(); k++) {
        const lens::PlaneRecord &record = planes[k].record;
        area::LensCriteria own = {};
        own.pinhole = {planes[k].pinhole, of_pinhole, GAP_REL, 0.0, false};
        own.rules = rules;
        own.by_distance = curved.by_distance;
        own.axis = {record.frame.data + 6, {}};
        own.gap = STRIP_REL;
        own.tree = trees[k];
        own.code = record.code;
        own.params = record.params;
        own.frame = record.frame;
        own.slopes = slopes[k];
        own.has_border = record.has_border();
        task->planes.push_back(own);
    }
    return task;
}

std::shared_ptr<const LensObject> lens_of(const rc_camera &camera) {
    if (!camera.lens) return nullptr;
    return object_of(camera.lens);
}
} // namespace rastercov::c

using namespace rastercov;
using namespace rastercov::c;

rc_status rc_lens_create(const double *numbers, int64_t n, rc_lens **lens) {
    return guard("making a lens", [&] {
        expect_result(lens);
        expect(n > 0 && double(n) <= MOST_NUMBERS, "1 to 100000000 numbers", n,
               "pack the lens anew");
        expect_array(numbers, "numbers");
        *lens = handles().add<rc_lens>(lens_from({numbers, numbers + n}));
    });
}
rc_status rc_lens_free(rc_lens *lens) { return free_handle(lens); }
