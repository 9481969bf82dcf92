/**
 * Rules of rigs: cameras that measure a point together, as rastercov/camera/rule.py has them.
 *
 * A gate is {names, k, needs, least_deg, most_deg, most_deviation, noise_px, stripes}: the cameras by name,
 * in their order, and for each of them 1 where it is needed, its noise, and 1 where it has stripes.
 */

import { centreOf, column, cross, dot, length, scale, subtract, unit } from "rastercov/maths.js";

const LEAST = 1e-300;

/**
 * Rows of the figures of a state, {stations, gate}: a camera that is on, or those of a rig that are all on and
 * follow one another. Stations are counted among those that are on; `gate` is null for a single camera.
 */
export function rowsOf({ stations, cameras, gates = [] }) {
  const ruled = new Map(gates.flatMap((gate) => gate.names.map((name) => [name, gate])));
  const place = new Map(stations.filter((each) => each.is_on).map(({ id }, row) => [id, row]));
  return stations.flatMap((station, at) => {
    const gate = ruled.get(station.camera);
    if (!gate) return station.is_on ? [{ stations: [place.get(station.id)], gate: null }] : [];
    const own = stations.slice(at, at + gate.names.length);
    const isWhole = gate.names.every((name, k) => own[k]?.camera === name && own[k].is_on);
    return isWhole ? [{ stations: own.map(({ id }) => place.get(id)), gate: { ...gate, noise: noiseOf(gate, cameras) } }] : [];
  });
}

/** Whether the stations are those of whole rigs of one rule, which files of cameras have. */
export const isOfRigs = ({ stations, gates: [{ names }] }) =>
  stations.length % names.length === 0 && stations.every(({ camera }, at) => camera === names[at % names.length]);

/** Noise of the cameras of a gate, radians; null where it does not matter. */
function noiseOf({ names, most_deviation: limit, noise_px: pixels }, cameras) {
  const scaleOf = ({ plain: { fx, fy } }) => Math.min(fx, fy);
  return limit > 0 ? names.map((name, k) => pixels[k] / scaleOf(cameras[name])) : null;
}

/** {reason, device} of the camera that is missed most, by its number; see `Gate.failing`. */
function missed({ k, needs }, reasons) {
  const rest = [...needs.keys()].filter((row) => !needs[row]).sort((a, b) => reasons[b] - reasons[a]);
  const more = k - (needs.length - rest.length);
  let found = more > 0 ? { reason: reasons[rest[more - 1]], device: rest[more - 1] } : { reason: Infinity, device: 0 };
  for (const row of needs.keys()) if (needs[row] && reasons[row] < found.reason) found = { reason: reasons[row], device: row };
  return found;
}

/**
 * Reason of a point for a rig with a rule, by name, and the number of the camera that fails, or -1: from the
 * reasons of each, in the order of `names`. See `gated_reasons` of rastercov/coverage/area/rows.py.
 */
export function failingOf(gate, poses, reasons, { point, normal, names }) {
  const behind = names.indexOf("back_facing");
  const fronts = poses.map((pose) => dot(subtract(centreOf(pose), point), normal) >= 0);
  const from = (isFront) => missed(gate, reasons.map((reason, d) => (fronts[d] === isFront ? reason : Math.min(reason, behind))));
  const [best, other] = [from(true), from(false)];
  const { reason, device } = other.reason > best.reason ? other : best;
  if (names[reason] !== "covered") return { reason: names[reason], device };
  if (!haveAngles(gate, poses, point)) return { reason: "baseline", device: -1 };
  return { reason: isCertain(gate, poses, point) ? "covered" : "uncertain", device: -1 };
}

/** Whether the rays from a point to the cameras differ as a gate asks. */
function haveAngles({ least_deg: least, most_deg: most }, poses, point) {
  const rays = poses.map((pose) => {
    const ray = subtract(centreOf(pose), point);
    return scale(ray, 1 / Math.max(length(ray), LEAST));
  });
  const cosine = Math.min(...rays.flatMap((ray, a) => rays.slice(a + 1).map((other) => dot(ray, other))));
  const of = (degrees) => Math.cos((degrees * Math.PI) / 180);
  return cosine >= of(most) && (least === 0 || cosine <= of(least));
}

/** Whether the standard deviation of a point in its worst direction is within the limit of a gate. */
function isCertain({ most_deviation: limit, noise, stripes }, poses, point) {
  if (!(limit > 0)) return true;
  const m = Array(9).fill(0); // (limit / deviation)^2, at least 1 in all directions
  poses.forEach((pose, d) => {
    const away = subtract(point, centreOf(pose));
    const distance = Math.max(length(away), LEAST);
    const ray = scale(away, 1 / distance);
    const weight = (limit / (noise[d] * distance)) ** 2;
    const axis = stripes[d] ? unit(cross(ray, column(pose, 1))) : ray;
    for (let k = 0; k < 9; k++) {
      const square = axis[Math.floor(k / 3)] * axis[k % 3];
      m[k] += weight * (stripes[d] ? square : (k % 4 === 0) - square);
    }
  });
  for (const k of [0, 4, 8]) m[k] -= 1;
  const minor = m[0] * m[4] - m[1] * m[1];
  const whole = m[8] * minor - m[0] * m[5] * m[5] - m[4] * m[2] * m[2] + 2 * m[1] * m[2] * m[5];
  return m[0] >= 0 && minor >= 0 && whole >= 0;
}

/**
 * What fails at a point in each row of a rig, {reason, hider, device}: a name, a face or -1, and the camera of
 * a rule; `said` is {reason, hider} of each station, and `spot` {point, normal}.
 */
export function failures(rig, said, { point, normal }) {
  const names = Object.keys(rig.reasons);
  return rig.rows.map(({ stations, gate }) => {
    const own = stations.map((at) => said[at]);
    if (!gate) return { reason: names[own[0].reason], hider: own[0].hider, device: "" };
    const poses = stations.map((at) => rig.stations[at].pose);
    const { reason, device } = failingOf(gate, poses, own.map((each) => each.reason), { point, normal, names });
    return { reason, hider: reason === "occluded" ? own[device].hider : -1, device: gate.names[device] ?? "" };
  });
}
