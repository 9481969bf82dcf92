/** Dead zones as the lists of a page have them: of the pieces that the engine has linked, the largest first. */

import { inUnit, squareMetres } from "rastercov/dom.js";
import { isWithin, labelOf } from "rastercov/live_rules.js";
import { add, centroid, clamp, cornersOf, cross, fanOf, length, normalOf, scale, subtract, unit } from "rastercov/maths.js";
import { text_with_sign } from "rastercov/texts.js";

const SLIVER_REL = 1e-9; // of the area of the task below which a zone is rounding
const MOST_ZONES = 100;
const MOST_FACES = 5000;
/** Points of a zone that are judged; fewer for many cameras, down to the pairs of these, as in core/area/zones.py. */
const [MOST_POINTS, LEAST_POINTS, PAIRS] = [32, 4, 4_000_000];
const UNEXPLAINED = new Set(["unseeable", "too_few_views", "no_cameras"]);

/** Zones, as `Server.zones`; `page` is a `Live`. */
export async function zonesOf(pieces, page) {
  const { areas, groupOf, data } = page;
  const { total } = page.own;
  const { groups, reasons } = data.scene;
  const zones = [];
  polygonsOf(pieces).forEach((polygon, row) => (zones[pieces.zones[row]] ??= []).push(polygon));
  const sized = zones.map((parts) => ({ parts, area: parts.reduce((sum, each) => sum + each.area, 0) }));
  const listed = sized.filter(({ area }) => area > SLIVER_REL * total).slice(0, MOST_ZONES);
  const judged = await judgedOf(listed, page);
  return listed.map(({ parts, area }, row) => {
    const [{ face, reason }] = parts;
    const centre = scale(parts.reduce((sum, each) => add(sum, scale(middleOf(each.corners), each.area)), [0, 0, 0]), 1 / area);
    const on = [...new Set(parts.map((each) => each.face))].sort((a, b) => a - b);
    const normal = on.reduce((sum, each) => add(sum, scale(unitNormal(page, each), areas[each])), [0, 0, 0]);
    const group = groups[groupOf[face]].name;
    const { hider, device } = whatFails(judged[row], reason, page);
    const by = hider === bodyOf(group) ? `self-${reasons.occluded}` : `${reasons.occluded} by ${hider}`;
    const label = labelOf(reasons, reason).replace(reasons.occluded, hider ? by : "$&") + (device ? ` (${device})` : "");
    const digits = clamp(1 - Math.floor(Math.log10(Math.sqrt(area))), 0, 9);
    const at = centre.map((value) => text_with_sign(value, digits)).join(", ");
    const words = `dead zone ${squareMetres(area)} around (${at}) ${inUnit("m")} in group ${group}: ${label}`;
    return { area, percent: 100 * (area / total), centre, normal: unit(normal), group, reason, words, faces: on.slice(0, MOST_FACES) };
  });
}

/** The part of which a group is a CAD face, or the group. */
const bodyOf = (group) => group.replace(/^(.+)\/face \d+$/, "$1");

/** What fails at points of each zone in each row, see `Solver.failures`; nothing of those that no criterion explains. */
async function judgedOf(zones, page) {
  const { length: n } = page.history.state.stations.filter((each) => each.is_on);
  const each = Math.trunc(clamp(PAIRS / Math.max(1, zones.length * n), LEAST_POINTS, MOST_POINTS));
  const spots = zones.flatMap(({ parts }, zone) => (UNEXPLAINED.has(parts[0].reason) ? [] : spotsOf(parts, each, zone * each, page)));
  const judged = await page.failures(spots);
  const found = zones.map(() => []);
  spots.forEach(({ row }, at) => found[Math.floor(row / each)].push(judged[at]));
  return found;
}

/** Points of a zone at equal steps of the area of the triangles that its pieces are fans of, as `points_of` in core/area/zones.py. */
export function spotsOf(parts, each, first, page) {
  const fans = parts.flatMap(({ corners, face }) => fanOf(corners).map(([a, b, c]) => ({ a, u: subtract(b, a), v: subtract(c, a), face })));
  let sum = 0;
  const ends = fans.map(({ u, v }) => (sum += length(cross(u, v)) / 2));
  return Array.from({ length: each }, (_, k) => {
    const at = ends.findIndex((end) => end >= ((k + 0.5) / each) * sum);
    const { a, u, v, face } = fans[at < 0 ? fans.length - 1 : at];
    const place = [0.7548776662466927, 0.5698402909980532].map((step) => ((first + k + 1) * step) % 1);
    const [x, y] = place[0] + place[1] > 1 ? place.map((value) => 1 - value) : place;
    return { point: add(a, add(scale(u, x), scale(v, y))), face, normal: unitNormal(page, face), row: first + k };
  });
}

/** {hider, device} of a zone, by what fails at its points: the body that hides most, and the camera of a rule that fails most. */
function whatFails(points, reason, { data: { scene }, groupOf, history: { state } }) {
  const [hidden, failing] = [scene.groups.map(() => 0), new Map(Object.keys(state.cameras).map((name) => [name, 0]))];
  for (const { hider, camera, reason: own } of points.flat()) {
    if (hider >= 0) hidden[groupOf[hider]] += 1;
    if (isWithin(own === "covered" ? "occluded" : own, reason)) failing.set(camera, failing.get(camera) + 1);
  }
  const most = Math.max(...hidden);
  const names = Object.keys(scene.reasons);
  const isOfCameras = state.gates && names.includes(reason) && names.indexOf(reason) < names.indexOf("baseline");
  const device = [...failing].reduce((best, next) => (next[1] > best[1] ? next : best), ["", 0])[0];
  return {
    hider: isWithin("occluded", reason) && most > 0 ? bodyOf(scene.groups[hidden.indexOf(most)].name) : "",
    device: isOfCameras ? device : "",
  };
}

/** Pieces {face, corners, area, reason}. */
export function polygonsOf({ faces, counts, corners, areas, reasons }) {
  let at = 0;
  return Array.from(faces, (face, row) => {
    const own = Array.from({ length: counts[row] }, (_, k) => [...corners.subarray(at + 3 * k, at + 3 * k + 3)]);
    at += 3 * counts[row];
    return { face, corners: own, area: areas?.[row], reason: reasons[row] };
  });
}

/** Centroid of a convex polygon. */
function middleOf(polygon) {
  const triangles = fanOf(polygon);
  const sizes = triangles.map((each) => length(normalOf(each)));
  const sum = triangles.reduce((total, each, k) => add(total, scale(centroid(each), sizes[k])), [0, 0, 0]);
  return scale(sum, 1 / sizes.reduce((total, size) => total + size));
}

const unitNormal = (mesh, face) => unit(normalOf(cornersOf(mesh, face)));
