/**
 * Places where cameras may hang, and those they keep out of: drawn, and kept while a camera is dragged.
 * The server has the last word; here they only stop a drag where it would.
 */

import { BOX_EDGES, boxCorners, centreOf, clamp, distance, ellipse, movePose, subtract } from "rastercov/maths.js";

const ALLOWED = [0.1, 0.6, 0.35, 0.8];
const FORBIDDEN = [0.85, 0.15, 0.2, 0.9];
const FACES = [
  [0, 1, 3, 2],
  [4, 5, 7, 6],
  [0, 1, 5, 4],
  [2, 3, 7, 6],
  [0, 2, 6, 4],
  [1, 3, 7, 5],
];

/** Whether there is anything to show. */
export const hasConstraints = (constraints) =>
  Boolean(constraints && (constraints.boxes?.length || constraints.keep_out?.length));

/** Draws boxes of mounting places in green and keep-outs in red. */
export function drawConstraints(sketch, constraints) {
  for (const box of constraints.boxes ?? []) drawBox(sketch, box, ALLOWED, 0); // no tint over the colours of faces
  for (const part of constraints.keep_out ?? []) {
    if (part.box) drawBox(sketch, part.box, FORBIDDEN, 0.06);
    else drawBall(sketch, part.centre, part.radius, FORBIDDEN);
  }
}

function drawBox(sketch, box, colour, opacity) {
  const corners = boxCorners(box);
  for (const [a, b] of BOX_EDGES) sketch.line(corners[a], corners[b], colour, 1.5);
  if (opacity)
    for (const face of FACES)
      sketch.polygon(
        face.map((at) => corners[at]),
        [...colour.slice(0, 3), opacity],
      );
}

function drawBall(sketch, centre, radius, colour) {
  const arms = [0, 1, 2].map((axis) => [0, 1, 2].map((k) => (k === axis ? radius : 0)));
  arms.forEach((arm, axis) => sketch.path(ellipse(centre, arm, arms[(axis + 1) % 3], 48), colour, 1.2, true));
}

/**
 * The pose that is wanted, moved to the nearest mounting place; null where it would enter a keep-out, or
 * where constraints are not kept, the pose as it is.
 */
export function allowPose(constraints, state, wanted) {
  const isKept = state.is_kept ?? constraints?.is_kept;
  if (!constraints || !isKept) return wanted;
  const centre = centreOf(wanted);
  const place = nearestPlace(constraints.boxes ?? [], centre);
  const isOut = (constraints.keep_out ?? []).some((part) => isInside(part, place));
  return isOut ? null : movePose(wanted, subtract(place, centre));
}

function nearestPlace(boxes, point) {
  const places = boxes.map(([low, high]) => point.map((x, axis) => clamp(x, low[axis], high[axis])));
  if (!places.length) return point;
  return places.reduce((best, place) => (distance(place, point) < distance(best, point) ? place : best));
}

function isInside(part, point) {
  if (part.box) return point.every((x, axis) => x > part.box[0][axis] && x < part.box[1][axis]);
  return distance(point, part.centre) < part.radius;
}
