/**
 * Rules of rigs: cameras that measure a point together, as rastercov/core/camera/rule.py has them.
 *
 * A gate is {names, k, needs, least_deg, most_deg, most_deviation, image_noise, stripes}: the cameras by name,
 * in their order, and for each of them 1 where it is needed, its noise in pixels, and 1 where it has stripes.
 */

import { centroid, cornersOf, normalOf } from "rastercov/maths.js";

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

/** Noise of the cameras of a gate, radians; null where it does not matter. */
function noiseOf({ names, most_deviation: limit, image_noise: pixels }, cameras) {
  const scaleOf = ({ plain: { fx, fy } }) => Math.min(fx, fy);
  return limit > 0 ? names.map((name, k) => pixels[k] / scaleOf(cameras[name])) : null;
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

/**
 * Whole faces by the rules of a rig, of what was judged of each through its stations: the place in `labels` of
 * the camera or limit that fails, the last where none does, or -1; and the largest `deviation` at the corners
 * of those that are measured, metres.
 */
export function measureFaces(mesh, rig, judged, solver) {
  const names = [...new Set(rig.rows.flatMap(({ gate }) => gate?.names ?? []))];
  const n = judged[0]?.reasons.length ?? 0;
  const labels = [...names.map((name) => `${name} fails`), rig.reasons.baseline, rig.reasons.uncertain, "covered"];
  const found = { labels, device: new Int32Array(n).fill(-1), deviation: new Float64Array(n) };
  if (!names.length) return found;
  const { RC_COVERED, RC_TOO_UNCERTAIN, RC_ANGLE_OUT_OF_RANGE } = solver.reasons;
  const place = { [RC_COVERED]: names.length + 2, [RC_TOO_UNCERTAIN]: names.length + 1, [RC_ANGLE_OUT_OF_RANGE]: names.length };
  const corners = Array.from({ length: n }, (_, f) => cornersOf(mesh, f));
  const spots = { points: corners.flatMap(centroid), normals: corners.flatMap(normalOf), reasons: judged.map(({ reasons }) => reasons) };
  const best = new Int32Array(n).fill(-1);
  solver.together(rig, spots).forEach(({ reasons, devices }, row) => {
    const { stations, gate } = rig.rows[row];
    if (!gate) return;
    for (let f = 0; f < n; f++) {
      if (solver.nearness[reasons[f]] <= best[f]) continue;
      best[f] = solver.nearness[reasons[f]];
      found.device[f] = place[reasons[f]] ?? names.indexOf(gate.names[devices[f]]);
    }
    if (!(gate.most_deviation > 0)) return;
    const measured = [...reasons.keys()].filter((f) => reasons[f] === RC_COVERED);
    const own = solver.deviations(rig, { stations, gate }, measured.flatMap((f) => corners[f].flat()));
    measured.forEach((f, at) => (found.deviation[f] = Math.max(found.deviation[f], ...own.subarray(3 * at, 3 * at + 3))));
  });
  return found;
}
