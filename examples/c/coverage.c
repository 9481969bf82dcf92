/* Area of a box with a lid that two cameras cover: each alone, and together.
 *   make lib && cc examples/c/coverage.c -Ibuild/include -Lbuild/lib -lrastercov -o coverage */
#include <rastercov.h>
#include <stdio.h>
#include <stdlib.h>

#define FACES 14
#define POSES 2

static const double vertices[12][3] = {
    {0, 0, 0}, {1, 0, 0}, {1, 1, 0},         {0, 1, 0},        {0, 0, 1},       {1, 0, 1},
    {1, 1, 1}, {0, 1, 1}, {-0.2, -0.2, 1.5}, {1.2, -0.2, 1.5}, {1.2, 0.5, 1.5}, {-0.2, 0.5, 1.5}};
static const int32_t faces[FACES][3] = {{0, 2, 1}, {0, 3, 2}, {4, 5, 6},  {4, 6, 7},  {0, 1, 5},
                                        {0, 5, 4}, {1, 2, 6}, {1, 6, 5},  {2, 3, 7},  {2, 7, 6},
                                        {3, 0, 4}, {3, 4, 7}, {8, 9, 10}, {8, 10, 11}};
static const uint8_t roles[FACES] = {[12] = RC_OCCLUDER, [13] = RC_OCCLUDER};
/* world_from_camera: from above, and from in front of the side y = 1. */
static const double poses[POSES][16] = {{1, 0, 0, 0.5, 0, -1, 0, 0.5, 0, 0, -1, 4, 0, 0, 0, 1},
                                        {-1, 0, 0, 0.5, 0, 0, -1, 4, 0, -1, 0, 0.5, 0, 0, 0, 1}};

static void check(rc_status status) {
    if (status == RC_OK) return;
    fprintf(stderr, "error: %s\n", rc_last_error());
    exit(2);
}

static double total(const double *areas) {
    double sum = 0;
    for (int f = 0; f < FACES; f++) sum += areas[f];
    return sum;
}

int main(void) {
    const rc_camera camera = {sizeof camera, 640, 480, 800, 800, 320, 240, 0, NULL, 0};
    const rc_task task = rc_task_default();
    double areas[FACES], bounds[FACES];
    rc_surface *surface;
    rc_solver *solver;
    rc_regions *regions;
    rc_union *both;
    check(rc_surface_create(vertices[0], 12, faces[0], FACES, roles, &surface));
    check(rc_solver_create(surface, RC_CERTIFIED, 1, &solver));
    check(rc_find_regions(solver, &camera, &task, poses[0], POSES, NULL, NULL, &regions));
    for (int pose = 0; pose < POSES; pose++) {
        check(rc_regions_areas(regions, pose, 1, FACES, areas, bounds));
        printf("camera %d covers %.9f m2\n", pose, total(areas));
    }
    check(rc_union_create(surface, 1, &both));
    check(rc_union_add(both, regions));
    check(rc_union_areas(both, 1, FACES, areas, bounds));
    printf("together they cover %.9f m2, within %.1e m2\n", total(areas), total(bounds));
    check(rc_union_free(both));
    check(rc_regions_free(regions));
    check(rc_solver_free(solver));
    check(rc_surface_free(surface));
    return 0;
}
