/* Rastercov for C: what cameras see of a triangle mesh, with a bound on every figure.
 *
 * Lengths are metres, images are in pixels with the first pixel's corner at (0, 0). A pose is the
 * 4 x 4 matrix world_from_camera, row by row; camera axes are x to the right, y down, z forward.
 * Arrays are the caller's and are copied; rows follow one another without gaps.
 *
 * Every function but rc_version and rc_last_error returns a code. Where it is not RC_OK, nothing
 * was written but for rows of rc_observe that were finished, and rc_last_error says why in one
 * line. A handle is a number, not an address: one that was freed, or is of another kind, is an
 * error, never a crash. Any thread may call with any handle; calls with one union, or that free it,
 * take turns.
 *
 * No binary interface is promised before version 2.0: compile against the header of the library.
 */
#ifndef RASTERCOV_H
#define RASTERCOV_H
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define RC_API_VERSION 1 /* of this header; rc_version says that of the library */

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

typedef struct rc_surface rc_surface;
typedef struct rc_solver rc_solver;
typedef struct rc_regions rc_regions;
typedef struct rc_union rc_union;

typedef struct rc_camera { /* a pinhole; pixels */
    double width, height, fx, fy, cx, cy;
    double near; /* least depth that is seen, metres; 0 for a millionth of the farthest */
} rc_camera;

typedef struct rc_task { /* what a point must meet to be covered; rc_task_default for none */
    double min_depth, max_depth; /* metres: depth of field */
    double max_incidence_deg;    /* at most 90 */
    double min_pixel_density;    /* pixels per metre along the worst direction */
    double min_pixels_per_m2;    /* pixels per square metre */
} rc_task;

typedef struct rc_figures { /* P x F arrays, or all null: poses, faces in the caller's order */
    double *visible, *area, *area_error; /* px^2; |visible - exact| <= area_error */
    uint8_t *is_certified;               /* 1 where a proof decided, 0 where it was computed */
} rc_figures;

/* Called between poses, from the thread of the caller, with its own pointer: 0 stops the call. */
typedef int (*rc_go_on)(void *context);

int rc_version(void);            /* RC_API_VERSION of the library */
const char *rc_last_error(void); /* of the last call of this thread that failed; never null */
rc_status rc_count_handles(int64_t *count); /* handles that are not freed */

/* Vertices are V x 3, faces F x 3 rows of vertices, counter-clockwise from the front; roles, one a
 * face, may be null. Vertices at one point are one vertex, whatever their numbers. */
rc_status rc_surface_create(const double *vertices, int64_t n_vertices, const int32_t *faces,
                            int64_t n_faces, const uint8_t *roles, rc_surface **surface);
rc_status rc_surface_free(rc_surface *surface);
rc_status rc_surface_areas(const rc_surface *surface, int64_t n_faces, double *areas); /* m^2 */

/* method is an rc_method; n_threads is 1 or more, and results do not depend on it. */
rc_status rc_solver_create(const rc_surface *surface, int32_t method, int32_t n_threads,
                           rc_solver **solver);
rc_status rc_solver_free(rc_solver *solver);
/* Figures of all faces through one camera in P poses. go_on may be null. */
rc_status rc_observe(rc_solver *solver, const rc_camera *camera, const double *poses,
                     int64_t n_poses, rc_go_on go_on, void *context, const rc_figures *figures);

rc_task rc_task_default(void);
/* Parts of the evaluated faces that each of P poses covers. */
rc_status rc_find_regions(rc_solver *solver, const rc_camera *camera, const rc_task *task,
                          const double *poses, int64_t n_poses, rc_go_on go_on, void *context,
                          rc_regions **regions);
rc_status rc_regions_free(rc_regions *regions);
/* Covered area of each face in one of the poses, and its bound, m^2. */
rc_status rc_regions_areas(const rc_regions *regions, int64_t pose, int64_t n_faces, double *areas,
                           double *bounds);
/* The same as convex polygons in space: their number, and that of all their corners; then the face
 * and the number of corners of each, and the corners, C x 3 metres, one polygon after another. */
rc_status rc_regions_size(const rc_regions *regions, int64_t pose, int64_t *n_polygons,
                          int64_t *n_corners);
rc_status rc_regions_read(const rc_regions *regions, int64_t pose, int64_t n_polygons,
                          int64_t n_corners, int32_t *faces, int32_t *counts, double *corners);

/* What several poses cover together, of one surface: counted up to `views` of them. */
rc_status rc_union_create(const rc_surface *surface, int32_t views, rc_union **unite);
rc_status rc_union_free(rc_union *unite);
rc_status rc_union_add(rc_union *unite, const rc_regions *regions);
/* Area of each face that at least `views` poses cover, and its bound, m^2. */
rc_status rc_union_areas(const rc_union *unite, int32_t views, int64_t n_faces, double *areas,
                         double *bounds);

#ifdef __cplusplus
}
#endif
#endif
