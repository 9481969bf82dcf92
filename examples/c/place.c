/* Of cameras around a box the two that cover most together; area that the sun lights at noon.
 *   make lib && cc examples/c/place.c -Ibuild/include -Lbuild/lib -lrastercov -o place */
#include <rastercov.h>
#include <stdio.h>
#include <stdlib.h>

#define FACES 12
#define POSES 8

static const double vertices[8][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                      {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
static const int32_t faces[FACES][3] = {{0, 2, 1}, {0, 3, 2}, {4, 5, 6}, {4, 6, 7},
                                        {0, 1, 5}, {0, 5, 4}, {1, 2, 6}, {1, 6, 5},
                                        {2, 3, 7}, {2, 7, 6}, {3, 0, 4}, {3, 4, 7}};

static void check(rc_status status) {
    if (status == RC_OK) return;
    fprintf(stderr, "error: %s\n", rc_last_error());
    exit(2);
}

int main(void) {
    const rc_camera camera = {sizeof camera, 640, 480, 800, 800, 320, 240, 0, NULL, 0};
    const rc_task task = rc_task_default();
    const rc_search search = {sizeof search, 2, 0, 0, 0, NULL};
    const double middle[3] = {0.5, 0.5, 0.5}, to_sun[3] = {-0.001, -0.416, 0.909};
    double poses[POSES][16], gains[2], lit[FACES], whole[FACES], bound[FACES], sum = 0;
    const rc_lit areas = {sizeof areas, lit, whole, bound};
    int64_t chosen[2], n;
    rc_surface *surface;
    rc_solver *solver;
    rc_regions *regions;
    for (int k = 0; k < POSES; k++) {
        const double eye[3] = {0.5 + (k % 3 - 1) * 3, 0.5 + (k / 3 - 1) * 4, 2 + k % 2};
        check(rc_look_at(eye, middle, NULL, poses[k]));
    }
    check(rc_surface_create(vertices[0], 8, faces[0], FACES, NULL, &surface));
    check(rc_solver_create(surface, RC_CERTIFIED, 1, &solver));
    check(rc_find_regions(solver, &camera, &task, poses[0], POSES, NULL, NULL, &regions));
    const rc_regions *all[1] = {regions};
    check(rc_place(all, 1, &search, NULL, NULL, chosen, gains, &n));
    for (int k = 0; k < n; k++) printf("camera %d adds %.9f m2\n", (int)chosen[k], gains[k]);
    check(rc_sunlit(solver, to_sun, 1, NULL, NULL, &areas));
    for (int f = 0; f < FACES; f++) sum += lit[f];
    printf("the sun lights %.9f m2 across its rays\n", sum);
    check(rc_regions_free(regions));
    check(rc_solver_free(solver));
    check(rc_surface_free(surface));
    return 0;
}
