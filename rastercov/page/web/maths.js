/**
 * Vectors, rigid motions and projections.
 *
 * Points and directions are arrays of 3 numbers, metres. Matrices are arrays of 16 numbers, row by
 * row, and act on columns. Camera axes are those of rastercov: x right, y down, z forward.
 */

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const length = (a) => Math.hypot(a[0], a[1], a[2]);
export const distance = (a, b) => length(subtract(a, b));
export const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
export const degrees = (radians) => (radians * 180) / Math.PI;
export const radians = (degs) => (degs * Math.PI) / 180;

/** `a` at length 1; the zero vector remains. */
export function unit(a) {
  const size = length(a);
  return size > 0 ? scale(a, 1 / size) : [0, 0, 0];
}

/** Corners of a face. */
export const cornersOf = ({ vertices, faces }, face) =>
  [0, 1, 2].map((k) => [...vertices.subarray(3 * faces[3 * face + k], 3 * faces[3 * face + k] + 3)]);
/** Corners of a face of which all are in a row. */
export const soupCorners = (soup, face) => [0, 3, 6].map((at) => [...soup.subarray(9 * face + at, 9 * face + at + 3)]);
/** Normal of a triangle, as long as twice its area. */
export const normalOf = ([a, b, c]) => cross(subtract(b, a), subtract(c, a));
/** Triangles of a convex polygon. */
export const fanOf = ([first, ...rest]) => rest.slice(1).map((corner, k) => [first, rest[k], corner]);
export const centroid = ([a, b, c]) => scale(add(a, add(b, c)), 1 / 3);

/** Some points of an ellipse around a centre, by two of its half axes. */
export const ellipse = (centre, a, b, count) =>
  Array.from({ length: count }, (_, k) => {
    const angle = (2 * Math.PI * k) / count;
    return add(centre, add(scale(a, Math.cos(angle)), scale(b, Math.sin(angle))));
  });

/** Point between `a` (t = 0) and `b` (t = 1). */
export const mix = (a, b, t) => add(scale(a, 1 - t), scale(b, t));

/** Product of two matrices. */
export function multiply(a, b) {
  const product = new Array(16);
  for (let row = 0; row < 4; row++) {
    for (let column = 0; column < 4; column++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[4 * row + k] * b[4 * k + column];
      product[4 * row + column] = sum;
    }
  }
  return product;
}

/** Pose (world_from_camera) with the given axes, each of length 1, and centre. */
export const poseOf = (right, down, forward, centre) => [
  ...[right[0], down[0], forward[0], centre[0]],
  ...[right[1], down[1], forward[1], centre[1]],
  ...[right[2], down[2], forward[2], centre[2]],
  ...[0, 0, 0, 1],
];

/** Column of a pose: 0 right, 1 down, 2 forward, 3 centre. */
export const column = (pose, at) => [pose[at], pose[4 + at], pose[8 + at]];
export const centreOf = (pose) => column(pose, 3);
export const forwardOf = (pose) => column(pose, 2);

/** World point of a point in camera axes. */
export const fromCamera = (pose, p) => add(directionFromCamera(pose, p), centreOf(pose));

/** World direction of a direction in camera axes. */
export const directionFromCamera = (pose, d) => [
  pose[0] * d[0] + pose[1] * d[1] + pose[2] * d[2],
  pose[4] * d[0] + pose[5] * d[1] + pose[6] * d[2],
  pose[8] * d[0] + pose[9] * d[1] + pose[10] * d[2],
];

/** Coordinates in camera axes of a world point; the third is its depth. */
export function inCamera(pose, point) {
  const away = subtract(point, centreOf(pose));
  return [dot(column(pose, 0), away), dot(column(pose, 1), away), dot(forwardOf(pose), away)];
}

/** Rotation of a unit quaternion x y z w, by rows, as `rotations_of_quaternions` of rastercov/core/mesh/arrays.py. */
export const turnOf = ([x, y, z, w]) => [
  [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
  [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
  [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
];

/** Inverse of a rigid motion. */
export function rigidInverse(pose) {
  const axes = [column(pose, 0), column(pose, 1), column(pose, 2)];
  const centre = centreOf(pose);
  return [...axes.flatMap((axis) => [...axis, -dot(axis, centre)]), 0, 0, 0, 1];
}

/** Largest difference of the axes of a pose from orthonormal ones. */
export function driftOf(pose) {
  const axes = [0, 1, 2].map((at) => column(pose, at));
  return Math.max(...axes.flatMap((a, i) => axes.map((b, j) => Math.abs(dot(a, b) - (i === j)))));
}

/** Pose with the nearest orthonormal axes, bit for bit as `nearest_rotations` of rastercov/core/mesh/arrays.py. */
export function orthonormal(pose) {
  const one = (row, k) => Number(row === k);
  let turn = pose.map((value, k) => (k % 4 === 3 || k > 11 ? one(k, 15) : value));
  for (let step = 0; step < 6; step++) {
    const square = multiply(rigidInverse(turn), turn);
    turn = multiply(turn, square.map((value, k) => 1.5 * one(k % 5, 0) - value / 2));
  }
  return pose.map((value, k) => (k % 4 === 3 ? value : turn[k]));
}

/** Pose turned about a world axis (of length 1) through its own centre; axes stay orthonormal. */
export function rotatePose(pose, axis, angle) {
  const cosine = Math.cos(angle);
  const sine = Math.sin(angle);
  const turn = (v) =>
    add(add(scale(v, cosine), scale(cross(axis, v), sine)), scale(axis, dot(axis, v) * (1 - cosine)));
  const forward = unit(turn(forwardOf(pose)));
  const right = unit(cross(turn(column(pose, 1)), forward));
  return poseOf(right, cross(forward, right), forward, centreOf(pose));
}

/** Pose at an eye that looks at a point, upright; `other` is up where that is along the view. */
export function lookingAt(eye, point, up, other = Math.abs(up[0]) > 0.5 ? [0, 1, 0] : [1, 0, 0]) {
  const forward = unit(subtract(point, eye));
  const right = unit(cross(forward, Math.abs(dot(forward, up)) > 0.999 ? other : up));
  return poseOf(right, cross(forward, right), forward, eye);
}

/** Pose moved by a world vector. */
export function movePose(pose, by) {
  const copy = [...pose];
  copy[3] += by[0];
  copy[7] += by[1];
  copy[11] += by[2];
  return copy;
}

/** Two directions that with `up` make a right-handed frame: east and north of a horizontal plane. */
export function horizon(up) {
  const north = Math.abs(up[1]) > 0.9 ? [0, 0, -1] : [0, 1, 0];
  const east = unit(cross(north, up));
  return [east, cross(up, east)];
}

/**
 * Angles of a pose, degrees: heading from east towards north, elevation above the horizon, and roll,
 * positive where the camera turns clockwise as it looks.
 */
export function anglesOf(pose, up) {
  const [east, north] = horizon(up);
  const forward = forwardOf(pose);
  const elevation = Math.asin(clamp(dot(forward, up), -1, 1));
  const isUpright = Math.hypot(dot(forward, east), dot(forward, north)) < 1e-7;
  const along = isUpright ? scale(column(pose, 1), -Math.sign(dot(forward, up))) : forward;
  const heading = Math.atan2(dot(along, north), dot(along, east));
  const level = poseFromAngles(degrees(heading), degrees(elevation), 0, up, [0, 0, 0]);
  const right = column(pose, 0);
  const roll = Math.atan2(dot(right, column(level, 1)), dot(right, column(level, 0)));
  return { heading: degrees(heading), elevation: degrees(elevation), roll: degrees(roll) };
}

/** Pose at `centre` with the angles of `anglesOf`, degrees. */
export function poseFromAngles(heading, elevation, roll, up, centre) {
  const [east, north] = horizon(up);
  const [h, e] = [radians(heading), radians(elevation)];
  const flat = add(scale(east, Math.cos(h)), scale(north, Math.sin(h)));
  const forward = add(scale(flat, Math.cos(e)), scale(up, Math.sin(e)));
  const right = unit(cross(flat, up));
  return rotatePose(poseOf(right, cross(forward, right), forward, centre), forward, radians(roll));
}

/**
 * Clip space from camera axes, of a pinhole.
 *
 * @param {number} slopeX half the width of the image at depth 1
 * @param {number} slopeY half its height at depth 1
 * @param {number} near depth of the near plane, metres
 * @param {number} far depth of the far plane, metres
 */
export const perspective = (slopeX, slopeY, near, far) => [
  ...[1 / slopeX, 0, 0, 0],
  ...[0, -1 / slopeY, 0, 0],
  ...[0, 0, (far + near) / (far - near), (-2 * far * near) / (far - near)],
  ...[0, 0, 1, 0],
];

/** Clip space from camera axes, of a parallel projection; half sides in metres. */
export const parallel = (halfWidth, halfHeight, near, far) => [
  ...[1 / halfWidth, 0, 0, 0],
  ...[0, -1 / halfHeight, 0, 0],
  ...[0, 0, 2 / (far - near), -(far + near) / (far - near)],
  ...[0, 0, 0, 1],
];

/** The eight corners of a box [[x, y, z], [x, y, z]]. */
export const boxCorners = ([low, high]) =>
  [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((axis) => ((k >> axis) & 1 ? high : low)[axis]));

/** Pairs of indices into `boxCorners`: the twelve edges. */
export const BOX_EDGES = [0, 1, 2, 3, 4, 5, 6, 7].flatMap((k) =>
  [1, 2, 4].filter((bit) => !(k & bit)).map((bit) => [k, k | bit]),
);

/** Middle and half diagonal of a box, metres. */
export function sphereAround([low, high]) {
  return { centre: mix(low, high, 0.5), radius: Math.max(distance(low, high) / 2, 1e-6) };
}
