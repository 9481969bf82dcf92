/** Dead zones as the lists of a page have them: of the pieces that the engine has linked, the largest first. */

import { inUnit, squareMetres } from "rastercov/dom.js";
import { isWithin, labelOf } from "rastercov/live_rules.js";
import { add, centroid, cornersOf, length, normalOf, scale, unit } from "rastercov/maths.js";

const SLIVER_REL = 1e-9; // of the area of the task below which a zone is rounding
const MOST_ZONES = 100;
const MOST_FACES = 5000;

/** Zones, as `Server.zones`; `page` is a `Live`. */
export async function zonesOf(pieces, page) {
  const { areas, groupOf, data } = page;
  const { total } = page.own;
  const { groups, reasons } = data.scene;
  const zones = [];
  polygonsOf(pieces).forEach((polygon, row) => (zones[pieces.zones[row]] ??= []).push(polygon));
  const sized = zones.map((parts) => ({ parts, area: parts.reduce((sum, each) => sum + each.area, 0) }));
  const listed = sized.filter(({ area }) => area > SLIVER_REL * total).slice(0, MOST_ZONES);
  const middles = listed.map(({ parts }) => {
    const most = parts.reduce((best, each) => (each.area > best.area ? each : best));
    return { point: middleOf(most.corners), face: most.face, normal: unitNormal(page, most.face) };
  });
  const failed = await page.failures(middles);
  return listed.map(({ parts, area }, row) => {
    const centre = scale(parts.reduce((sum, each) => add(sum, scale(middleOf(each.corners), each.area)), [0, 0, 0]), 1 / area);
    const on = [...new Set(parts.map((each) => each.face))].sort((a, b) => a - b);
    const normal = on.reduce((sum, face) => add(sum, scale(unitNormal(page, face), areas[face])), [0, 0, 0]);
    const group = groups[groupOf[parts[0].face]].name;
    const { reason } = parts[0];
    const own = failed[row].filter((each) => isWithin(each.reason, reason));
    const hider = mostOf(own, (each) => (each.hider < 0 ? "" : groupOf[each.hider]))?.hider ?? -1;
    const by = hider < 0 ? "" : groupOf[hider] === groupOf[parts[0].face] ? "self-" : ` by ${groups[groupOf[hider]].name}`;
    const device = mostOf(own, (each) => each.device)?.device;
    const occluded = by === "self-" ? `self-${reasons.occluded}` : `${reasons.occluded}${by}`;
    const label = labelOf(reasons, reason).replace(reasons.occluded, occluded) + (device ? ` (${device})` : "");
    const digits = Math.min(Math.max(0, 1 - Math.floor(Math.log10(Math.sqrt(area)))), 9);
    const at = centre.map((value) => (Number(value.toFixed(digits)) + 0).toFixed(digits)).join(", ");
    const words = `dead zone ${squareMetres(area)} around (${at}) ${inUnit("m")} in group ${group}: ${label}`;
    return { area, percent: (100 * area) / total, centre, normal: unit(normal), group, reason, words, faces: on.slice(0, MOST_FACES) };
  });
}

/** The first of those that share the most frequent value; undefined where none has one. */
function mostOf(entries, of) {
  const counts = new Map();
  for (const each of entries) counts.set(of(each), (counts.get(of(each)) ?? 0) + 1);
  counts.delete("");
  const most = Math.max(...counts.values());
  return entries.find((each) => counts.get(of(each)) === most);
}

function polygonsOf({ faces, counts, corners, areas, reasons }) {
  let at = 0;
  return Array.from(faces, (face, row) => {
    const own = Array.from({ length: counts[row] }, (_, k) => [...corners.subarray(at + 3 * k, at + 3 * k + 3)]);
    at += 3 * counts[row];
    return { face, corners: own, area: areas[row], reason: reasons[row] };
  });
}

/** Centroid of a convex polygon. */
function middleOf([first, ...rest]) {
  const triangles = rest.slice(1).map((corner, k) => [first, rest[k], corner]);
  const sizes = triangles.map((each) => length(normalOf(each)));
  const sum = triangles.reduce((total, each, k) => add(total, scale(centroid(each), sizes[k])), [0, 0, 0]);
  return scale(sum, 1 / sizes.reduce((total, size) => total + size));
}

const unitNormal = (mesh, face) => unit(normalOf(cornersOf(mesh, face)));
