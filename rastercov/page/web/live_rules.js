/**
 * Rules of rigs: cameras that measure a point together, as rastercov/core/camera/rule.py has them.
 *
 * A gate is {names, k, needs, least_deg, most_deg, most_deviation, image_noise, stripes}: the cameras by name,
 * in their order, and for each of them 1 where it is needed, its noise in pixels, and 1 where it has stripes.
 */

import { centroid, cornersOf, normalOf } from "rastercov/maths.js";

/**
 * Heads and single cameras of a state, {name, ids, gate, isWhole, counts}, as rastercov/page/rig_state.py has them:
 * sensors of a head follow one another, and count if all are on; `gate` is null for a single camera.
 */
export function headsOf({ stations, gates = [] }) {
  const heads = [];
  for (let at = 0; at < stations.length; at += heads.at(-1).ids.length) {
    const gate = gates.find(({ names }) => names.includes(stations[at].camera)) ?? null;
    const isWhole = !gate || gate.names.every((name, k) => stations[at + k]?.camera === name);
    const own = stations.slice(at, at + (gate && isWhole ? gate.names.length : 1));
    const common = own[0].name.slice(0, Math.max(0, own[0].name.lastIndexOf("/")));
    const name = own.length > 1 ? common || `head ${heads.length + 1}` : own[0].name;
    heads.push({ name, ids: own.map(({ id }) => id), gate, isWhole, counts: isWhole && own.every((each) => each.is_on) });
  }
  return heads;
}

/** Rows of the figures of a state, {stations, gate}, by heads that count; stations are counted among those that are on. */
export function rowsOf(state) {
  const place = new Map(state.stations.filter((each) => each.is_on).map(({ id }, row) => [id, row]));
  return headsOf(state)
    .filter(({ counts }) => counts)
    .map(({ ids, gate }) => ({
      stations: ids.map((id) => place.get(id)),
      gate: gate && { ...gate, noise: noiseOf(gate, state.cameras) },
    }));
}

/** Noise of the cameras of a gate, radians; null where it does not matter. */
function noiseOf({ names, most_deviation: limit, image_noise: pixels, stripes }, cameras) {
  return limit > 0 ? names.map((name, k) => pixels[k] / scaleOf(cameras[name].plain, stripes[k])) : null;
}

/** Pixels per radian on the axis of a camera, as pixels_a_radian. */
function scaleOf({ fx, fy, model, distortion: [first] = [] }, isStriped) {
  const slopes = { omni: 1 / (1 + first), double_sphere: 1 / (1 + first), fov: first && (2 * Math.tan(first / 2)) / first };
  return (isStriped ? fx : Math.min(fx, fy)) * (slopes[model] || 1);
}

/** Words on the reasons of a name, by those of single ones. */
export function labelOf(reasons, name) {
  const labels = name.split("+").map((each) => reasons[each]);
  return labels.length < 2 ? labels[0] : `${labels.slice(0, -1).join(", ")} and ${labels.at(-1)}`;
}

/** Whether all criteria of a reason are among those of another. */
export const isWithin = (name, other) => name.split("+").every((each) => other.split("+").includes(each));

/** What fails in the row with a rule that comes nearest to measuring a point, of all that `failed`; or undefined. */
export function nearest({ rows }, failed) {
  const ofRules = failed.filter((_, row) => rows[row].gate);
  return ofRules.reduce((most, each) => (most?.nearness >= each.nearness ? most : each), undefined);
}

/** Centroids and normals of the faces of meshes. */
const SPOTS = new WeakMap();

/** What was judged of whole faces in each row: by a camera, or by the rule of a head and the best of its sensors. */
export function joinRows(mesh, rig, judged, solver) {
  if (rig.rows.every(({ gate }) => !gate)) return rig.rows.map(({ stations: [at] }) => judged[at]);
  if (!SPOTS.has(mesh)) {
    const corners = Array.from({ length: judged[0].reasons.length }, (_, f) => cornersOf(mesh, f));
    SPOTS.set(mesh, { points: corners.flatMap(centroid), normals: corners.flatMap(normalOf) });
  }
  const spots = { ...SPOTS.get(mesh), reasons: judged.map(({ reasons }) => reasons) };
  const { RC_COVERED } = solver.reasons;
  return solver.together(rig, spots).map(({ reasons, devices }, row) => {
    const own = rig.rows[row].stations.map((at) => judged[at]);
    if (!rig.rows[row].gate) return own[0];
    const best = (key) =>
      Float64Array.from(reasons, (reason, f) =>
        reason === RC_COVERED ? Math.max(...own.map((each) => (each.reasons[f] === RC_COVERED ? each[key][f] : 0))) : 0,
      );
    return { reasons, devices, coverage: best("coverage"), densities: best("densities"), facing: best("facing") };
  });
}

/**
 * The place in `labels` of the sensor or limit that fails in the row that comes nearest to covering a face, of the
 * `faces` of `facesOf`, the last where one covers it, or -1; and the largest `deviation` at the corners of those that
 * are measured, metres.
 */
export function measureFaces(mesh, rig, rows, faces, solver) {
  const names = Object.keys(rig.cameras);
  const labels = [...names.map((name) => `${name} fails`), rig.reasons.baseline, rig.reasons.uncertain, "covered"];
  const codes = Object.keys(rig.reasons);
  const limits = { [codes.indexOf("baseline")]: names.length, [codes.indexOf("uncertain")]: names.length + 1 };
  const device = faces.nearest.map((row, f) => {
    if (faces.views[f]) return names.length + 2;
    const { stations, gate } = rig.rows[row] ?? { stations: [] };
    return limits[faces.rows[f]] ?? names.indexOf(gate ? gate.names[rows[row].devices[f]] : rig.stations[stations[0]]?.camera);
  });
  const deviation = new Float64Array(device.length);
  rows.forEach(({ reasons }, row) => {
    const { stations, gate } = rig.rows[row];
    if (!(gate?.most_deviation > 0)) return;
    const measured = [...reasons.keys()].filter((f) => reasons[f] === solver.reasons.RC_COVERED);
    const own = solver.deviations(rig, { stations, gate }, measured.flatMap((f) => cornersOf(mesh, f).flat()));
    measured.forEach((f, at) => (deviation[f] = Math.max(deviation[f], ...own.subarray(3 * at, 3 * at + 3))));
  });
  return { labels, device, deviation };
}
