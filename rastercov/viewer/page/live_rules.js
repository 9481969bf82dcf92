/**
 * Rules of rigs: cameras that measure a point together, as rastercov/camera/rule.py has them.
 *
 * A gate is {names, k, needs, least_deg, most_deg, most_deviation, image_noise, stripes}: the cameras by name,
 * in their order, and for each of them 1 where it is needed, its noise in pixels, and 1 where it has stripes.
 */

import { centreOf, centroid, column, cornersOf, cross, dot, length, normalOf, scale, subtract, unit } from "rastercov/maths.js";

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
function noiseOf({ names, most_deviation: limit, image_noise: pixels }, cameras) {
  const scaleOf = ({ plain: { fx, fy } }) => Math.min(fx, fy);
  return limit > 0 ? names.map((name, k) => pixels[k] / scaleOf(cameras[name])) : null;
}

const TOGETHER = ["outside", "out_of_focus", "too_coarse", "occluded", "too_oblique"];
const SETS = Array.from({ length: 32 }, (_, bits) => bits).sort((a, b) => sizeOf(a) - sizeOf(b) || b - a);

function sizeOf(bits) {
  return TOGETHER.filter((_, k) => (bits >> k) & 1).length;
}

/** Bits of the criteria of a reason, as rastercov/coverage/reasons.py has them. */
const bitsOf = (name) => name.split("+").reduce((sum, each) => sum + (TOGETHER.includes(each) ? 1 << TOGETHER.indexOf(each) : 0), 0);

const nameOf = (bits) => TOGETHER.filter((_, k) => (bits >> k) & 1).reverse().join("+") || "covered";

/** Words on the reasons of a name, by those of single ones. */
export function labelOf(reasons, name) {
  const labels = name.split("+").map((each) => reasons[each]);
  return labels.length < 2 ? labels[0] : `${labels.slice(0, -1).join(", ")} and ${labels.at(-1)}`;
}

/** Whether all criteria of a reason are among those of another. */
export const isWithin = (name, other) => name.split("+").every((each) => other.split("+").includes(each));

/** How near a camera with a reason is to covering, by the row of its name: `RANK` of rastercov/coverage/reasons.py. */
export function nearness(names, row) {
  const first = ["degenerate", "back_facing", "outside"].indexOf(names[row]);
  if (first >= 0) return first;
  if (names[row].includes("+")) return 3 + row;
  return names[row] === "covered" ? 1e6 : 1000 + row;
}

/** Name of the fewest criteria that cameras of a rule must meet on one side; undefined where none suffice. */
function fewest({ k, needs }, reasons, fronts) {
  const holds = (left, isFront) => {
    const passes = reasons.map((name, d) => {
      const bits = bitsOf(name);
      return fronts[d] === isFront && (bits || name === "covered") && !(bits & ~left);
    });
    return passes.filter(Boolean).length >= k && passes.every((each, d) => each || !needs[d]);
  };
  const left = SETS.find((bits) => holds(bits, true) || holds(bits, false));
  return left === undefined ? undefined : nameOf(left);
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
  const ranks = reasons.map((row) => nearness(names, row));
  const last = nearness(names, behind);
  const from = (isFront) => missed(gate, ranks.map((rank, d) => (fronts[d] === isFront ? rank : Math.min(rank, last))));
  const [best, other] = [from(true), from(false)];
  const { reason: rank, device } = other.reason > best.reason ? other : best;
  const every = reasons.map((row) => names[row]);
  const reason = fewest(gate, every, fronts) ?? names.find((_, row) => nearness(names, row) === rank);
  if (reason !== "covered") return { reason, device };
  if (!haveAngles(gate, poses, point)) return { reason: "baseline", device: -1 };
  const isCertain = deviationAt(gate, poses, point) <= gate.most_deviation;
  return { reason: isCertain ? "covered" : "uncertain", device: -1 };
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

/** Standard deviation of a point in its worst direction, by all cameras of a gate, metres; 0 without a limit. */
function deviationAt({ most_deviation: limit, noise, stripes }, poses, point) {
  if (!(limit > 0)) return 0;
  const m = [0, 1, 2].map(() => [0, 0, 0]); // information, in that of the nearest camera
  const rays = poses.map((pose) => subtract(point, centreOf(pose)));
  const sizes = rays.map((ray, d) => noise[d] * Math.max(length(ray), LEAST));
  const nearest = Math.min(...sizes);
  rays.forEach((ray, d) => {
    const axis = unit(stripes[d] ? cross(ray, column(poses[d], 1)) : ray);
    for (let k = 0; k < 9; k++) {
      const [row, at] = [Math.floor(k / 3), k % 3];
      const square = axis[row] * axis[at];
      m[row][at] += (nearest / sizes[d]) ** 2 * (stripes[d] ? square : (row === at) - square);
    }
  });
  return nearest / Math.sqrt(Math.max(0, leastEigenvalue(m)));
}

/** Of a symmetric matrix, 3 x 3, by Jacobi's rotations. */
function leastEigenvalue(m) {
  for (let turn = 0; turn < 24; turn++) {
    const [p, q] = [[0, 1], [0, 2], [1, 2]][turn % 3];
    if (m[p][q] === 0) continue;
    const theta = (m[q][q] - m[p][p]) / (2 * m[p][q]);
    const t = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.hypot(theta, 1));
    const [c, s] = [1 / Math.hypot(t, 1), t / Math.hypot(t, 1)];
    for (const row of m) [row[p], row[q]] = [c * row[p] - s * row[q], s * row[p] + c * row[q]];
    for (let k = 0; k < 3; k++) [m[p][k], m[q][k]] = [c * m[p][k] - s * m[q][k], s * m[p][k] + c * m[q][k]];
  }
  return Math.min(m[0][0], m[1][1], m[2][2]);
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
    return { reason, hider: isWithin("occluded", reason) ? own[device].hider : -1, device: gate.names[device] ?? "" };
  });
}

/** What fails in the row with a rule that comes nearest to measuring a point, of all that `failed`; or undefined. */
export function nearest({ rows, reasons }, failed) {
  const names = Object.keys(reasons);
  const rank = ({ reason }) => nearness(names, names.indexOf(reason));
  const ofRules = failed.filter((_, row) => rows[row].gate);
  return ofRules.reduce((most, each) => (most && rank(most) >= rank(each) ? most : each), undefined);
}

/**
 * Whole faces by the rules of a rig, of what was judged of each through its stations: the place in `labels` of
 * the camera or limit that fails, the last where none does, or -1; and the largest `deviation` at the corners
 * of those that are measured, metres.
 */
export function measuredFaces(mesh, rig, judged) {
  const names = [...new Set(rig.rows.flatMap(({ gate }) => gate?.names ?? []))];
  const n = judged[0]?.reasons.length ?? 0;
  const { baseline, uncertain } = rig.reasons;
  const labels = [...names.map((name) => `${name} fails`), baseline, uncertain, "covered"];
  const found = { labels, device: new Int32Array(n).fill(-1), deviation: new Float64Array(n) };
  for (let f = 0; f < n && names.length; f++) {
    const corners = cornersOf(mesh, f);
    const said = judged.map(({ reasons }) => ({ reason: reasons[f], hider: -1 }));
    const failed = failures(rig, said, { point: centroid(corners), normal: normalOf(corners) });
    const { reason, device } = nearest(rig, failed);
    const place = { covered: names.length + 2, uncertain: names.length + 1, baseline: names.length };
    found.device[f] = place[reason] ?? names.indexOf(device);
    failed.forEach(({ reason: why }, row) => {
      const { stations, gate } = rig.rows[row];
      if (!gate || why !== "covered") return;
      const poses = stations.map((at) => rig.stations[at].pose);
      found.deviation[f] = Math.max(found.deviation[f], ...corners.map((corner) => deviationAt(gate, poses, corner)));
    });
  }
  return found;
}
