/* Rastercov for C: what cameras see of a triangle mesh, with a bound on every figure.
 *
 * Lengths are metres, images are in pixels with the first pixel's corner at (0, 0). A pose is the
 * 4 x 4 matrix world_from_camera, row by row; camera axes are x to the right, y down, z forward.
 * Arrays are the caller's and are copied; rows follow one another without gaps.
 *
 * Every function but rc_version and rc_last_error returns a code. Where it is not RC_OK, nothing
 * was written but for rows of rc_observe, rc_sunlit and rc_place that were finished, and
 * rc_last_error says why in one line. A handle is a number, not an address: one that was freed, or
 * is of another kind, is an error, never a crash. Any thread may call with any handle; calls with
 * one union, or that free it, take turns.
 *
 * No binary interface is promised before version 2.0: compile against the header of the library.
 */
#ifndef RASTERCOV_H
#define RASTERCOV_H
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define RC_API_VERSION 5 /* of this header; rc_version says that of the library */

typedef enum rc_status {
    RC_OK = 0,
    RC_BAD_ARGUMENT = 1,  /* expected X, got Y; do Z */
    RC_BAD_HANDLE = 2,    /* null, freed, or of another kind */
    RC_OUT_OF_MEMORY = 3, /* objects are as they were */
    RC_STOPPED = 4,       /* a callback returned 0; finished rows stay */
    RC_FAILED = 5         /* a callback threw an exception of C++, or a fault of the library */
} rc_status;

/* Roles of a face, added. Without any it is evaluated, hides others, and is seen from its front. */
enum { RC_OCCLUDER = 1, RC_TARGET = 2, RC_TWO_SIDED = 4 };
/* RC_CERTIFIED takes less time; the figures of both have bounds. */
typedef enum rc_method { RC_CERTIFIED = 0, RC_EXACT = 1 } rc_method;

/* Why a point is not covered: the criteria that it fails. */
enum {
    RC_NO_AREA = 0,     /* a face without area */
    RC_BACK_FACING = 1, /* seen from behind */
    RC_OUTSIDE = 2,     /* outside the image, or before the near plane */
    RC_OUT_OF_FOCUS = 3,
    RC_TOO_COARSE = 5, /* too few pixels */
    RC_OCCLUDED = 6,
    RC_TOO_OBLIQUE = 7,
    RC_COVERED = 8,
    RC_SEVERAL = 9, /* and up to 34: several of 2, 3, 5, 6 and 7; the more, the lower */
    RC_TOO_FEW_VIEWS = 35,
    RC_NO_CAMERAS = 36,
    RC_ANGLE_OUT_OF_RANGE = 37, /* of the rays to devices of a rig */
    RC_TOO_UNCERTAIN = 38,      /* measured by them */
    RC_UNSEEABLE = 39           /* from anywhere */
};

/* Formats of files of meshes. */
enum { RC_STL = 0, RC_OBJ = 1, RC_PLY = 2, RC_OFF = 3 };

/* Models of lenses. */
enum {
    RC_MODEL_PINHOLE = 0,
    RC_MODEL_OPENCV = 1,
    RC_MODEL_OPENCV_FISHEYE = 2,
    RC_MODEL_THIN_PRISM_FISHEYE = 3,
    RC_MODEL_RAD_TAN_THIN_PRISM_FISHEYE = 4,
    RC_MODEL_FISHEYE62 = 5,
    RC_MODEL_FOV = 6,
    RC_MODEL_DIVISION = 7,
    RC_MODEL_OMNI = 8,
    RC_MODEL_EUCM = 9,
    RC_MODEL_DOUBLE_SPHERE = 10,
    RC_MODEL_METASHAPE = 11,
    RC_MODEL_METASHAPE_FISHEYE = 12,
    RC_MODEL_METASHAPE_EQUISOLID = 13,
    RC_MODEL_EQUIRECTANGULAR = 14
};

typedef struct rc_mesh rc_mesh;
typedef struct rc_surface rc_surface;
typedef struct rc_lens rc_lens;
typedef struct rc_solver rc_solver;
typedef struct rc_regions rc_regions;
typedef struct rc_union rc_union;
typedef struct rc_network rc_network;
typedef struct rc_zones rc_zones;

typedef struct rc_camera { /* pixels */
    int32_t size;          /* sizeof(rc_camera), bytes: a later version may add fields at the end */
    double width, height, fx, fy, cx, cy; /* of a lens: those that it was proved for */
    double near;         /* least depth that is seen, metres; 0 for a millionth of the farthest */
    const rc_lens *lens; /* null for a pinhole */
    int32_t is_parallel; /* 1: rays along z, fx and fy in px/m; for rc_observe, rc_find_regions */
} rc_camera;

typedef struct rc_optics { /* of a lens, pixels */
    double width, height, fx, fy, cx, cy, skew;
    double max_angle_deg; /* from the axis, up to which the lens is known; 0 for no limit */
    int32_t model;        /* an RC_MODEL_... */
} rc_optics;

typedef struct rc_task { /* what a point must meet to be covered; rc_task_default for none */
    double min_depth, max_depth; /* metres: depth of field */
    double max_incidence_deg;    /* at most 90 */
    double min_pixel_density;    /* pixels per metre along the worst direction */
    double min_facing_density;   /* the same of a target that faces the camera there */
    double min_pixels_per_m2;    /* pixels per square metre */
} rc_task;

typedef struct rc_figures { /* P x F arrays, or all null: poses, faces in the caller's order */
    double *visible, *area, *area_error; /* px^2; |visible - exact| <= area_error */
    uint8_t *is_certified;               /* 1 where a proof decided, 0 where it was computed */
} rc_figures;

typedef struct rc_lit {  /* N x F arrays: directions, faces in the caller's order */
    int32_t size;        /* sizeof(rc_lit), bytes */
    double *lit, *whole; /* area across the rays, m^2; 0 of a face that turns away, or hides only */
    double *bound;       /* of the errors of both together, m^2; lit / whole is the lit share */
} rc_lit;

typedef struct rc_judged { /* of F faces, or null for what is not asked for */
    uint8_t *reasons;      /* criteria that a face fails as a whole, an RC_... or 4: no sample */
    double *coverage;      /* visible fraction of a face that meets all of them, else 0 */
    double *densities;     /* pixels per metre on the surface, along its worst direction */
    double *facing;        /* and of a target that faces the camera */
} rc_judged;

typedef struct rc_failures { /* of N points */
    uint8_t *reasons;        /* criteria that a point fails, an RC_... */
    int32_t *hiders;         /* the face that hides it, or -1 */
} rc_failures;

typedef struct rc_rule_failures { /* of N points */
    uint8_t *reasons; /* the fewest criteria that enough devices must meet, or a limit */
    int32_t *devices; /* the device that is missed most, or -1 */
} rc_rule_failures;

typedef struct rc_gate {  /* devices that measure a point together, from one side of its face */
    int32_t k;            /* of n of them, */
    const uint8_t *needs; /* n: 1 for those that must be among these; null for none */
    double least_deg, most_deg; /* angle between the rays to some two, to any two: 0 and 180 */
    double most_deviation;      /* of the point in its worst direction, metres; 0 for no limit */
    const double *noise;        /* n: standard deviation of a ray, radians, for that limit */
    const uint8_t *stripes;     /* n: 1 where only x of the image is known; null for none */
} rc_gate;

typedef struct rc_search { /* for poses that cover most together */
    int32_t size;          /* sizeof(rc_search), bytes */
    int32_t most;          /* poses to choose, 1 or more */
    double least;          /* each adds more, m^2 */
    int64_t n_given;       /* of the poses the first ones, which are there already */
    int64_t n_faces;       /* F, of: */
    const int32_t *views;  /* poses that each face needs; null for 1 */
} rc_search;

typedef struct rc_parts {    /* of N polygons, by zone or not */
    int32_t *faces, *counts; /* the face, and the number of corners of each */
    int32_t *views, *zones;  /* cameras that cover it, and the zone it is of, 0 the largest */
    int32_t *reasons;        /* an RC_...; of others below 0: bits of 2, 3, 5, 6, 7, 37, 38 */
    double *areas, *corners; /* m^2; C x 3 metres, one polygon after another */
} rc_parts;

/* Called between poses, from the thread of the caller, with its own pointer: 0 stops the call. */
typedef int (*rc_go_on)(void *context);

int rc_version(void);            /* RC_API_VERSION of the library */
const char *rc_last_error(void); /* of the last call of this thread that failed; never null */
rc_status rc_count_handles(int64_t *count); /* handles that are not freed */

/* The mesh of the bytes of a file, with `unit` metres per unit of its coordinates. Faces keep their
 * order; polygons are cut into triangles that cover them once, or a note says why not. A file that
 * asks for more faces, or more bytes by an estimate, than it may is refused before memory is taken.
 */
rc_status rc_read_mesh(const uint8_t *bytes, int64_t n_bytes, int32_t format, double unit,
                       int64_t most_faces, int64_t memory_budget, rc_mesh **mesh);
rc_status rc_mesh_free(rc_mesh *mesh);
rc_status rc_mesh_size(const rc_mesh *mesh, int64_t *n_vertices, int64_t *n_faces,
                       int64_t *n_groups, int64_t *n_text);
/* Vertices, V x 3, and faces, F x 3, for rc_surface_create; the polygon in the file, and the group
 * of each face. */
rc_status rc_mesh_read(const rc_mesh *mesh, int64_t n_vertices, int64_t n_faces, double *vertices,
                       int32_t *faces, int32_t *polygons, int32_t *groups);
/* A line for each group, its name, as in the file or empty; then one for each note on oddities. */
rc_status rc_mesh_text(const rc_mesh *mesh, int64_t n_text, uint8_t *text);

/* Vertices are V x 3, faces F x 3 rows of vertices, counter-clockwise from the front; roles, one a
 * face, may be null. Vertices at one point are one vertex, whatever their numbers. */
rc_status rc_surface_create(const double *vertices, int64_t n_vertices, const int32_t *faces,
                            int64_t n_faces, const uint8_t *roles, rc_surface **surface);
rc_status rc_surface_free(rc_surface *surface);
rc_status rc_surface_areas(const rc_surface *surface, int64_t n_faces, double *areas); /* m^2 */

/* A lens with distortion, or no pinhole, of a model with its n coefficients, the others 0: its
 * order of them is that of docs/appendix/lenses.md. Its proofs take up to a second. */
rc_status rc_lens_prove(const rc_optics *optics, const double *coefficients, int64_t n,
                        rc_lens **lens);
/* The same as one row of numbers, of their count, which rc_lens_create takes at once. */
rc_status rc_lens_size(const rc_lens *lens, int64_t *n);
rc_status rc_lens_read(const rc_lens *lens, int64_t n, double *numbers);
rc_status rc_lens_create(const double *numbers, int64_t n, rc_lens **lens);
/* Rays around what a lens shows, 4 x parts x 3, as many from each corner of the image on: with z =
 * 1 where its focus is a plane, else of unit length. */
rc_status rc_lens_border(const rc_lens *lens, int64_t parts, double *rays);
rc_status rc_lens_free(rc_lens *lens);

/* method is an rc_method; n_threads is 1 or more, and results do not depend on it. */
rc_status rc_solver_create(const rc_surface *surface, int32_t method, int32_t n_threads,
                           rc_solver **solver);
rc_status rc_solver_free(rc_solver *solver);
/* Figures of all faces through one camera in P poses. go_on may be null. */
rc_status rc_observe(rc_solver *solver, const rc_camera *camera, const double *poses,
                     int64_t n_poses, rc_go_on go_on, void *context, const rc_figures *figures);

/* What parallel rays light, by N directions to their source, N x 3 of any length above 0, such as
 * those of the sun: areas of faces from in front, of two-sided ones from either side. */
rc_status rc_sunlit(const rc_solver *solver, const double *directions, int64_t n_directions,
                    rc_go_on go_on, void *context, const rc_lit *lit);

rc_task rc_task_default(void);
/* The pose of a camera at a point that looks at another, with `up` upwards in the image, each 3
 * numbers, metres: z where it is null; the axis furthest from the view where that is along it. */
rc_status rc_look_at(const double *eye, const double *target, const double *up, double *pose);
/* Whole faces in one pose, as colours of a picture show them: one counts as covered where half of
 * what is in view is seen. */
rc_status rc_judge_faces(rc_solver *solver, const rc_camera *camera, const rc_task *task,
                         const double *pose, int64_t n_faces, const rc_judged *judged);
/* Parts of the evaluated faces that each of P poses covers. */
rc_status rc_find_regions(rc_solver *solver, const rc_camera *camera, const rc_task *task,
                          const double *poses, int64_t n_poses, rc_go_on go_on, void *context,
                          rc_regions **regions);
rc_status rc_regions_free(rc_regions *regions);
/* Covered area of each face in n_poses of the poses, from `pose` on, n_poses x F, m^2, and its
 * bound: of what may be classified wrongly, before the rounding of sums. */
rc_status rc_regions_areas(const rc_regions *regions, int64_t pose, int64_t n_poses,
                           int64_t n_faces, double *areas, double *bounds);
/* The same as convex polygons in space: their number, and that of all their corners; then the face
 * and the number of corners of each, and the corners, C x 3 metres, one polygon after another. */
rc_status rc_regions_size(const rc_regions *regions, int64_t pose, int64_t *n_polygons,
                          int64_t *n_corners);
rc_status rc_regions_read(const rc_regions *regions, int64_t pose, int64_t n_polygons,
                          int64_t n_corners, int32_t *faces, int32_t *counts, double *corners);

/* What n devices of one rig measure together, of what each sees in a pose: n regions of a pose
 * each, and these poses; of parallel rays 2^96 m back. A lamp is a camera of its cone: a gate of
 * k = 2 that needs the camera leaves of it what one lamp or more lights. */
rc_status rc_regions_together(const rc_gate *gate, const rc_regions *const *regions,
                              const double *poses, int64_t n, rc_regions **together);

/* Of all poses of n results of one surface, counted from 0 through them: one after another the pose
 * that adds most to the given and the chosen ones, of equal ones the first, as area counted up to
 * the views of each face; ends where none adds enough. Writes up to `most` poses and their gains,
 * m^2, and how many; those so far if it is stopped. */
rc_status rc_place(const rc_regions *const *regions, int64_t n, const rc_search *search,
                   rc_go_on go_on, void *context, int64_t *chosen, double *gains,
                   int64_t *n_chosen);

/* What several poses cover together, of one surface: counted up to `views` of them. */
rc_status rc_union_create(const rc_surface *surface, int32_t views, rc_union **unite);
rc_status rc_union_free(rc_union *unite);
rc_status rc_union_add(rc_union *unite, const rc_regions *regions);
/* Those of n results at once, such as of several cameras. */
rc_status rc_union_add_all(rc_union *unite, const rc_regions *const *regions, int64_t n);
/* Area of each face that at least `views` poses cover, and its bound, m^2. */
rc_status rc_union_areas(const rc_union *unite, int32_t views, int64_t n_faces, double *areas,
                         double *bounds);
/* One more pose, which covers all of the faces that are marked, F. */
rc_status rc_union_fill(rc_union *unite, int64_t n_faces, const uint8_t *faces);
/* The part of the bound of each face that can lessen an area: less where a camera is in the plane
 * of a face to rounding, m^2. */
rc_status rc_union_excess(const rc_union *unite, int64_t n_faces, double *excess);
/* Sums over parts of the surface, a row of k + 3 numbers for each, by the part of each face, F, or
 * -1: what at least 1 ... k poses cover, k being the views of the union; the bound of that; what
 * `views` of the part may cover besides, which rounding decides; and the area of the part, m^2. */
rc_status rc_union_sums(const rc_union *unite, int64_t n_faces, const int32_t *parts,
                        int64_t n_parts, const int32_t *views, double *sums);
/* A union of one more view that begins with the parts of another, and with one more pose that
 * covers all evaluated faces: what only that one covers is the rest of the surface. */
rc_status rc_union_complete(const rc_union *unite, rc_union **complete);
/* The parts of a union as convex polygons in space, as of rc_regions_size and rc_regions_read; of
 * each the area, m^2, and its tag: the poses that cover it, counted up to the views of the union.
 */
rc_status rc_union_size(const rc_union *unite, int64_t *n_polygons, int64_t *n_corners);
rc_status rc_union_read(const rc_union *unite, int64_t n_polygons, int64_t n_corners,
                        int32_t *faces, int32_t *counts, int32_t *tags, double *areas,
                        double *corners);
/* Sum of the parts that exactly `views` poses of a union of more views cover, and one pose of
 * regions among them, m^2. */
rc_status rc_union_alone(const rc_union *unite, int32_t views, const rc_regions *regions,
                         int64_t pose, double *area);
/* Cameras that cover a surface together. Each that is added is a row of its own; the last n of them
 * can be joined to a rig, one row. What was found of a camera stays for one that is equal. */
rc_status rc_network_create(const rc_surface *surface, int32_t n_threads, rc_network **network);
rc_status rc_network_free(rc_network *network);
rc_status rc_network_clear(rc_network *network); /* takes all cameras away */
rc_status rc_network_add(rc_network *network, const rc_camera *camera, const rc_task *task,
                         const double *pose);
rc_status rc_network_join(rc_network *network, const rc_gate *gate, int64_t n);
/* What a row covers, counted from 0; and what all of them cover. */
rc_status rc_network_regions(rc_network *network, int64_t row, rc_regions **regions);
rc_status rc_network_unite(rc_network *network, int32_t views, rc_union **unite);
/* Dead zones: connected parts, of one reason and one group, that fewer cameras cover than each face
 * needs, F; groups of faces, F, and proved areas that no camera can ever see, F, may be null. */
rc_status rc_find_zones(rc_network *network, int64_t n_faces, const int32_t *views,
                        const int32_t *groups, const double *unseeable, rc_zones **zones);
rc_status rc_zones_free(rc_zones *zones);
rc_status rc_zones_size(const rc_zones *zones, int64_t *n_zones, int64_t *n_polygons,
                        int64_t *n_corners);
rc_status rc_zones_read(const rc_zones *zones, int64_t n_polygons, int64_t n_corners,
                        const rc_parts *parts);
/* Zone of each of N points, N x 3 metres, on faces, and its reason; -1 and RC_COVERED in none. */
rc_status rc_reason_at(const rc_zones *zones, int64_t n_points, const double *points,
                       const int32_t *faces, int32_t *of_zones, int32_t *reasons);

/* Criteria that each of N points, N x 3 metres, on faces fails in one pose. */
rc_status rc_judge_points(const rc_surface *surface, const rc_camera *camera, const rc_task *task,
                          const double *pose, int64_t n_points, const double *points,
                          const int32_t *faces, const rc_failures *failures);
/* How near a camera for which a point or face has a reason is to covering it: more is nearer. */
int32_t rc_nearness(int32_t reason);
/* What fails of n devices that measure together, in poses as of rc_regions_together, at N points
 * with normals, of the reasons of each there, n x N. */
rc_status rc_judge_together(const rc_gate *gate, const double *poses, int64_t n, int64_t n_points,
                            const double *points, const double *normals, const uint8_t *reasons,
                            const rc_rule_failures *failures);
/* Standard deviation of points in their worst direction by all devices, metres. */
rc_status rc_measure_points(const rc_gate *gate, const double *poses, int64_t n, int64_t n_points,
                            const double *points, double *deviations);
/* 1 for each of N places of a camera, N x 3 metres, that keeps a distance from every surface and
 * from which at most half of the directions first meet the back of one-sided faces. */
rc_status rc_clear_places(const rc_surface *surface, int64_t n_points, const double *points,
                          double distance, uint8_t *is_clear);

#ifdef __cplusplus
}
#endif
#endif
