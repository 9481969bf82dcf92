"""Loops over poses, bands of the image and clusters; `rastercov.raster.cpu` shows the stages."""

import numpy as np

from rastercov.kernels.jit import compiled, part_of
from rastercov.kernels.raster_clipping import clip_and_triangulate
from rastercov.kernels.raster_coverage import (
    count_hidden,
    count_samples_2x2,
    counts_in_blocks,
)
from rastercov.kernels.raster_fill import cull_and_bin, fill_any, fill_small
from rastercov.kernels.raster_memory import (
    ALL_LANES,
    BEHIND,
    BOTTOM,
    CELL_BITS,
    CLEAR_ALL_SAMPLES,
    EYE,
    FACES_IN_VAIN,
    FORWARD,
    FRUSTUM_PLANES,
    GUARD_BAND,
    INTRINSICS,
    LANES,
    LARGE,
    LEFT,
    MAGNIFICATION,
    NEAR,
    NORMAL_LENGTH,
    PLANE,
    PREFETCH_DISTANCE,
    RIGHT,
    SIDE,
    SIDE_BITS,
    STEP_BITS,
    STRIP_BITS,
    TOP,
    Bins,
    Cluster,
    Counts,
    Faces,
    Image,
    Mesh,
    Plane,
    Setup,
    Target,
    Vertices,
    Window,
    Workspace,
)
from rastercov.kernels.raster_occlusion import (
    bound_cells,
    is_hidden,
    order_by_depth,
    samples_in_box,
)
from rastercov.kernels.raster_stage_cull import clusters_in_band, cull_clusters
from rastercov.kernels.raster_stage_depth import nearest_vertex, prefetch_counts
from rastercov.kernels.raster_stage_vertices import project_vertices
from rastercov.kernels.simd_kernel import (
    align_stack,
    append_set_bits,
    offset,
    pointer,
    pointers,
    prefetch_values,
)


@compiled
def put_frustum(camera, width, top, bottom, planes):
    """Write the frustum of the rows from `top` up to `bottom`, see `FRUSTUM_PLANES`.

    A point p from the camera centre is outside where normal . p < 0; by the last plane, < near.
    """
    fx, fy = camera[INTRINSICS], camera[INTRINSICS + 1]
    cx, cy = camera[INTRINSICS + 2], camera[INTRINSICS + 3]
    for i in range(3):
        right, down, forward = camera[3 * i], camera[3 * i + 1], camera[3 * i + 2]
        planes[PLANE * LEFT + i] = fx * right + cx * forward
        planes[PLANE * RIGHT + i] = (width - cx) * forward - fx * right
        planes[PLANE * TOP + i] = fy * down + (cy - top) * forward
        planes[PLANE * BOTTOM + i] = (bottom - cy) * forward - fy * down
        planes[PLANE * FORWARD + i] = forward
    for k in range(FRUSTUM_PLANES):
        x, y, z = planes[PLANE * k], planes[PLANE * k + 1], planes[PLANE * k + 2]
        planes[PLANE * k + NORMAL_LENGTH] = np.sqrt(x**2 + y**2 + z**2)


@part_of
def clear(samples, window, image):
    """Clear the strips of blocks that a range of samples reaches; False where it is empty."""
    first_x, last_x, first_y, last_y = samples
    if first_x > last_x or first_y > last_y:
        return False
    if image.is_clear:
        return True
    shift = SIDE_BITS + STRIP_BITS
    for row in range((first_y - window.top) >> SIDE_BITS, ((last_y - window.top) >> SIDE_BITS) + 1):
        for strip in range(first_x >> shift, (last_x >> shift) + 1):
            block = row * window.columns + (strip << STRIP_BITS)
            if image.marks[block >> STRIP_BITS] == 0:
                image.marks[block >> STRIP_BITS] = 1
                start = block << (2 * SIDE_BITS)
                for sample in range(start, start + (LANES << STRIP_BITS)):
                    image.depth[sample] = 0.0
    return True


@part_of
def uncut(box, window):
    """Window without cut blocks where every sample that a box in steps reaches is inside the image.

    The image is convex, so its rows between the first and the last of the box contain it as well.
    """
    left, right = np.int64(box[0]) >> STEP_BITS, np.int64(box[1]) >> STEP_BITS
    top, bottom = np.int64(box[2]) >> STEP_BITS, np.int64(box[3]) >> STEP_BITS
    full_x, full_y = window.full_x, window.full_y
    if full_x == 0 and top >= 0 and bottom < window.height:
        first = max(window.first[top], window.first[bottom])
        last = min(window.last[top], window.last[bottom])
        if left >= first and right < last:
            full_x = np.int32((window.right + 1) >> SIDE_BITS)
            full_y = np.int32(window.height >> SIDE_BITS)
    return Window(
        window.right, window.top, window.bottom, window.hides_back, window.columns, window.height,
        full_x, full_y, window.inner, window.first, window.last,
    )  # fmt: skip


@part_of
def draw_cluster(mesh, cluster, workspace, target):
    """Draw the faces of a cluster that need no clipping.

    Returns how many samples were empty, the faces that were tried (`LANES` per wide one), and the
    number of those in `bins.clipped`. Faces of a cluster behind what is drawn are only counted.
    """
    camera, _, vertices, bins, setup, setup_64_bit, bit_indices, _ = workspace
    window, image, counts, tests_cells = target
    if counts.with_drawn:
        prefetch_counts(counts.drawn, mesh.lines, cluster.first_line, cluster.end_line)
    box = project_vertices(mesh, cluster, camera, vertices)
    low_x, high_x, low_y, high_y = box
    if low_x == BEHIND and high_x == BEHIND:
        return 0, 0, 0
    is_plain = np.int64(max(high_x - low_x, high_y - low_y) < LARGE)
    if high_x >= BEHIND:
        is_plain, tests_cells = 0, False
        right, bottom = (window.right + 1) << STEP_BITS, (window.bottom + 1) << STEP_BITS
        box = (np.int32(0), np.int32(right), np.int32(window.top << STEP_BITS), np.int32(bottom))
    samples = samples_in_box(box, window)
    if not clear(samples, window, image):
        return 0, 0, 0
    is_behind = False
    if tests_cells:
        nearest = nearest_vertex(vertices, cluster.end_vertex - cluster.first_vertex)
        is_behind = is_hidden(samples, nearest, window, image)
        if is_behind and not counts.with_drawn:
            return 0, 0, 0
    window = uncut(box, window)
    target = Target(window, image, counts, tests_cells)
    faces = Faces(mesh, cluster.first_slot, vertices, bins.coverage_2x2)
    n_slots = cluster.end_slot - cluster.first_slot
    n = cull_and_bin(faces, n_slots, window, is_plain, counts, bit_indices, bins)
    in_blocks = counts_in_blocks(window, counts)
    if counts.with_drawn and not in_blocks:
        count_samples_2x2(bins.samples_2x2, n.samples_2x2, faces, counts.drawn)
        count_samples_2x2(bins.hidden_samples_2x2, n.hidden_samples_2x2, faces, counts.drawn)
    filled, n_tried = 0, n.wide * LANES
    if is_behind:
        if in_blocks:
            count_hidden(bins.samples_2x2, n.samples_2x2, faces, setup, target)
        count_hidden(bins.larger, n.larger, faces, setup, target)
    elif n.samples_2x2 + n.larger:
        n_tried += n.samples_2x2 + n.larger
        prefetch_counts(counts.visible, mesh.lines, cluster.first_line, cluster.end_line)
        filled = fill_small(bins, n.samples_2x2, n.larger, faces, setup, target)
    if n.hidden_larger:
        count_hidden(bins.hidden_larger, n.hidden_larger, faces, setup, target)
    if n.wide:
        no_plane = Plane(np.nan, np.nan, np.nan)
        filled += fill_any(bins.wide, n.wide, faces, setup_64_bit, target, no_plane)
    return filled, n_tried, n.clipped


@compiled
def draw_clipped(mesh, cluster, n, workspace, target, scratch):
    """Clip and draw the faces in `workspace.bins.clipped`; returns how many samples were empty."""
    fan = Mesh(mesh.points, scratch.fan_corners, scratch.fan_faces, mesh.lines)
    faces = Faces(fan, 0, workspace.vertices, workspace.bins.coverage_2x2)
    filled = 0
    for k in range(n):
        n_parts, plane = clip_and_triangulate(
            mesh, cluster.first_slot + workspace.bins.clipped[k], cluster, workspace.camera,
            target.window, workspace.vertices, fan, scratch.polygon, scratch.polygon_out,
        )  # fmt: skip
        filled += fill_any(scratch.identity, n_parts, faces, workspace.setup_64_bit, target, plane)
    return filled


@part_of
def draw_band(
    window, n_bands, canvas, clusters, mesh, buffers, counts, cell_bounds, scratch, workspace
):
    """Draw the clusters that reach into a band; returns how many samples were empty."""
    fy, cy = canvas.intrinsics[1], canvas.intrinsics[3]
    top, bottom = window.top, window.bottom + 1
    off_centre = max(abs(canvas.intrinsics[2]), abs(cy))
    is_centred = np.int64(off_centre < GUARD_BAND >> STEP_BITS >> 1)
    frustum, kept, seen = workspace.frustum, buffers.kept, buffers.seen
    put_frustum(workspace.camera, canvas.size[0], top, bottom, frustum)
    n_seen = 0
    for at in range(0, clusters.n, LANES):
        found = kept[at // LANES] & ALL_LANES
        if found and n_bands > 1:
            found &= clusters_in_band(
                clusters.bounds, clusters.stride, at, buffers.centres, fy,
                cy - top, frustum[PLANE * TOP + NORMAL_LENGTH],
                bottom - cy, frustum[PLANE * BOTTOM + NORMAL_LENGTH],
            )  # fmt: skip
        n_seen = append_set_bits(workspace.bit_indices, found, at, seen, n_seen)
    n_samples = buffers.n_marks * (LANES << STRIP_BITS)
    is_clear = n_samples < CLEAR_ALL_SAMPLES * n_seen
    for strip in range(buffers.n_marks):
        buffers.marks[strip] = is_clear
    if is_clear:
        for sample in range(n_samples):
            buffers.depth[sample] = 0.0
    n_rows = ((window.bottom - window.top) >> CELL_BITS) + 1
    for cell in range(n_rows * (window.columns >> SIDE_BITS)):
        buffers.cell_depth[cell] = 0.0 if cell_bounds is None else cell_bounds[cell]
    ordered = buffers.ordered
    forward = offset(buffers.centres, clusters.stride)
    order_by_depth(clusters, seen, n_seen, forward, workspace.bucket_ends, ordered)
    image = Image(buffers.depth, buffers.face, buffers.cell_depth, buffers.marks, is_clear)
    filled, in_vain, tests_cells = 0, 0, cell_bounds is not None
    filled_when_bounded = 0
    for i in range(n_seen):
        if i + PREFETCH_DISTANCE < n_seen:
            ahead = ordered[i + PREFETCH_DISTANCE]
            begin, end = clusters.vertex_starts[ahead], clusters.vertex_starts[ahead + 1]
            prefetch_values(mesh.points, 3 * np.int64(begin), 3 * np.int64(end))
            begin, end = clusters.face_starts[ahead], clusters.face_starts[ahead + 1]
            prefetch_values(mesh.corners, begin, end)
            prefetch_values(mesh.faces, begin, end)
        k = ordered[i]
        cluster = Cluster(
            np.int64(clusters.vertex_starts[k]), np.int64(clusters.vertex_starts[k + 1]),
            np.int64(clusters.face_starts[k]), np.int64(clusters.face_starts[k + 1]),
            np.int64(clusters.line_starts[k]), np.int64(clusters.line_starts[k + 1]),
            kept[k // LANES] >> (LANES + (k & (LANES - 1))) & is_centred,
        )  # fmt: skip
        target = Target(window, image, counts, tests_cells)
        n_new, n_tried, n_clipped = draw_cluster(mesh, cluster, workspace, target)
        filled += n_new
        if n_new == 0:
            in_vain += n_tried
            if in_vain >= FACES_IN_VAIN and filled > filled_when_bounded:
                in_vain, tests_cells, filled_when_bounded = 0, True, filled
                bound_cells(window, image)
        if n_clipped:
            filled += draw_clipped(mesh, cluster, n_clipped, workspace, target, scratch)
    return filled


@part_of
def cull_pose(pose, near, hides_backs, top, bottom, canvas, clusters, buffers, workspace):
    """Write the camera of a pose, and the bits of clusters that may be visible in some band."""
    camera = workspace.camera
    for i in range(3):
        for k in range(3):
            camera[3 * i + k] = pose[4 * i + k]
        camera[EYE + i] = pose[4 * i + 3]
    for k in range(4):
        camera[INTRINSICS + k] = canvas.intrinsics[k]
    camera[NEAR], camera[MAGNIFICATION] = near, canvas.magnification[1]
    put_frustum(camera, canvas.size[0], top, bottom, workspace.frustum)
    for at in range(0, clusters.n, LANES):
        bits = cull_clusters(
            clusters.bounds, clusters.stride, at, camera, workspace.frustum,
            canvas.magnification[0], hides_backs, buffers.centres,
        )  # fmt: skip
        valid = ALL_LANES >> max(LANES - (clusters.n - at), 0)
        buffers.kept[at // LANES] = bits & (valid | ALL_LANES << LANES)


@compiled
def count_poses(poses, canvas, bands, clusters, buffers, output, scratch):
    """Count the samples of poses.

    Parameters
    ----------
    poses : Poses
        `world_from_camera` (P, 4, 4) float64, from the same origin as the vertices; its first two
        axes need not be orthogonal, since `rastercov.raster.sample_grid` mixes them to rotate the
        samples. `near` (P,) float64: depth of the near plane. `cull` (P,) bool: back faces are
        hidden.
    canvas : Canvas
        `magnification` (2,) float64: least and greatest magnification of a length parallel to the
        image over its depth, in samples. `intrinsics` (4,) float64: fx, fy, cx, cy in samples.
        `size` (2,) int64: width and height in samples. `inner` (rows of blocks, 2) int64: first
        block of each row that is wholly inside the image, and the one after the last. `first`,
        `last` (height,) int32: samples of each row that count, from the first up to the last.
        `is_rolled` bool: samples within the width and the height may be outside the image.
    bands : (B, 2) int64
        First row of each band of the image, and the row after its last. They are multiples of
        `SIDE`, except at the end of the image.
    clusters : Clusters
    buffers : Buffers
        Scratch. `marks` (M,) uint8: strips that are cleared. `depth`, `face` (M * samples of a
        strip,) float32, int32: afterwards the last band of the last pose, in blocks: 1/z where
        marked, 0 where empty, and the face. `kept` (K / LANES,) int64: see `cull_clusters`.
        `centres` (2, K) float64. `seen` (K + LANES,) int32: clusters in a band.
    output : Output
        `visible`, `drawn` (P, F) int32: samples; `drawn` only `with_drawn`, else one row that is
        not written. `filled` (P,) int64: samples with a face in them. `weights` (N,) uint8: how
        often each sample of the image counts in the first two, in the order of `Buffers` for all
        of its rows; None where each counts once. `cell_bounds` (cells,) float32: inf for cells
        whose samples do not count, 0 for others; None without weights.
    scratch : Scratch
        From `make_scratch`.
    """
    align_stack()
    canvas, clusters = pointers(canvas), pointers(clusters)
    buffers, scratch = pointers(buffers), pointers(scratch)
    mesh = Mesh(clusters.points, clusters.corners, clusters.faces, clusters.lines)
    workspace = workspace_of(scratch)
    width, height = canvas.size[0], canvas.size[1]
    columns = (width + (SIDE << STRIP_BITS) - 1) >> (SIDE_BITS + STRIP_BITS) << STRIP_BITS
    full_x = 0 if canvas.is_rolled else width >> SIDE_BITS
    full_y = 0 if canvas.is_rolled else height >> SIDE_BITS
    visible, drawn, with_drawn = output.visible, output.drawn, output.with_drawn
    for p in range(len(poses.near)):
        visible[p] = 0
        if with_drawn:
            drawn[p] = 0
        hides_backs = ALL_LANES if poses.cull[p] and not with_drawn else 0
        cull_pose(
            pointer(poses.world_from_camera[p]), poses.near[p], hides_backs, bands[0, 0],
            bands[-1, 1], canvas, clusters, buffers, workspace,
        )  # fmt: skip
        filled = 0
        for band in range(len(bands)):
            window = Window(
                np.int32(width - 1), np.int32(bands[band, 0]), np.int32(bands[band, 1] - 1),
                np.int32(poses.cull[p]), np.int32(columns), height, np.int32(full_x),
                np.int32(full_y), canvas.inner, canvas.first, canvas.last,
            )  # fmt: skip
            block = (bands[band, 0] >> SIDE_BITS) * columns
            weights = offset(pointer(output.weights), block << 2 * SIDE_BITS)
            cell_bounds = offset(pointer(output.cell_bounds), block >> 2 * SIDE_BITS)
            counts = Counts(
                pointer(visible[p]), pointer(drawn[p if with_drawn else 0]), with_drawn, weights
            )
            filled += draw_band(
                window, len(bands), canvas, clusters, mesh, buffers, counts, cell_bounds, scratch,
                workspace,
            )  # fmt: skip
        output.filled[p] = filled


@part_of
def workspace_of(scratch):
    """Scratch pointers by stage."""
    vertices = Vertices(scratch.u, scratch.v, scratch.w, scratch.x, scratch.y)
    bins = Bins(
        scratch.samples_2x2, scratch.larger, scratch.hidden_samples_2x2, scratch.hidden_larger,
        scratch.wide, scratch.clipped, scratch.coverage_2x2,
    )  # fmt: skip
    rest = (
        scratch.bounds, scratch.plane64, scratch.plane32, scratch.sample, scratch.depth,
        scratch.masks,
    )  # fmt: skip
    return Workspace(
        scratch.camera, scratch.frustum, vertices, bins, Setup(scratch.edges, *rest),
        Setup(scratch.edges_64_bit, *rest), scratch.bit_indices, scratch.bucket_ends,
    )  # fmt: skip


@compiled
def read_band(top, bottom, columns, buffers, image_face, image_depth):
    """Copy the band that `count_poses` left in its buffers to the rows of an image."""
    for row in range(top, bottom):
        for column in range(image_face.shape[1]):
            block = ((row - top) >> SIDE_BITS) * columns + (column >> SIDE_BITS)
            if buffers.marks[block >> STRIP_BITS]:
                sample = (block << SIDE_BITS) + (row & (SIDE - 1))
                sample = (sample << SIDE_BITS) + (column & (SIDE - 1))
                if buffers.depth[sample] > 0:
                    image_face[row, column] = buffers.face[sample]
                    image_depth[row, column] = np.float32(1.0 / buffers.depth[sample])
