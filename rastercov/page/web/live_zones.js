/**
 * Dead zones of the pieces that too few cameras cover: connected parts of one reason, the largest first.
 *
 * Pieces are connected where they share a part of their boundary, within a face, and across an edge that
 * faces share, unless it is a crease or an end of a group.
 */

import { inUnit, squareMetres } from "rastercov/dom.js";
import { isWithin, labelOf } from "rastercov/live_rules.js";
import { add, centroid, cornersOf, dot, length, normalOf, scale, subtract, unit } from "rastercov/maths.js";

const CREASE = Math.cos((30 * Math.PI) / 180);
const TOLERANCE_REL = 1e-9; // of sides that are one, relative to the diagonal
const LEAST_REL = 1e-7; // length of contact from which pieces are connected
const SLIVER_REL = 1e-9; // of the area of the task below which a zone is rounding
const MOST_ZONES = 100;
const MOST_FACES = 5000;

/** Zones, as `Server.zones`; `page` is a `Live`. */
export async function zonesOf(pieces, page) {
  const { areas, groupOf, data } = page;
  const { total } = page.own;
  const { bounds, groups, reasons } = data.scene;
  const size = length(subtract(bounds[1], bounds[0]));
  const polygons = polygonsOf(pieces);
  const roots = joined(polygons, { page, groupOf, tolerance: TOLERANCE_REL * size, least: LEAST_REL * size });
  const zones = new Map();
  polygons.forEach((polygon, row) => {
    const root = roots(row);
    if (!zones.has(root)) zones.set(root, []);
    zones.get(root).push(polygon);
  });
  const sized = [...zones.values()].map((parts) => ({ parts, area: parts.reduce((sum, each) => sum + each.area, 0) }));
  const boundOf = (parts) => [...new Set(parts.map(({ face }) => face))].reduce((sum, face) => sum + pieces.excess[face], 0);
  const isListed = ({ parts, area }) => area > Math.max(SLIVER_REL * total, boundOf(parts));
  const listed = sized.filter(isListed).sort((a, b) => b.area - a.area).slice(0, MOST_ZONES);
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
  return faces.map((face, row) => {
    const own = Array.from({ length: counts[row] }, (_, k) => corners.slice(at + 3 * k, at + 3 * k + 3));
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

/** Root of each polygon in the forest of those that are connected. */
function joined(polygons, mesh) {
  const parent = polygons.map((_, row) => row);
  const rootOf = (row) => {
    while (parent[row] !== row) row = parent[row] = parent[parent[row]];
    return row;
  };
  const join = (a, b) => (parent[rootOf(a)] = rootOf(b));
  const ofFace = new Map();
  polygons.forEach(({ face }, row) => ofFace.set(face, [...(ofFace.get(face) ?? []), row]));
  for (const rows of ofFace.values()) joinWithin(rows, polygons, mesh, rootOf, join);
  joinAcross(ofFace, polygons, mesh, join);
  return rootOf;
}

const sidesOf = (corners) => corners.map((corner, k) => [corner, corners[(k + 1) % corners.length]]);

/** Length along which a segment runs beside another one within a tolerance. */
function overlap([p, q], [r, s], tolerance) {
  const along = subtract(q, p);
  const size = length(along);
  if (!(size > 0)) return 0;
  const axis = scale(along, 1 / size);
  const places = [r, s].map((point) => {
    const away = subtract(point, p);
    const at = dot(away, axis);
    return length(subtract(away, scale(axis, at))) <= tolerance ? at : NaN;
  });
  return Math.min(Math.max(...places), size) - Math.max(Math.min(...places), 0);
}

function joinWithin(rows, polygons, { tolerance, least }, rootOf, join) {
  const boxes = rows.map((row) => {
    const { corners } = polygons[row];
    return [0, 1, 2].map((axis) => [Math.min(...corners.map((c) => c[axis])), Math.max(...corners.map((c) => c[axis]))]);
  });
  const isNear = (a, b) => a.every(([low, high], axis) => low <= b[axis][1] + tolerance && b[axis][0] <= high + tolerance);
  for (let a = 0; a < rows.length; a++) {
    for (let b = a + 1; b < rows.length; b++) {
      const [one, other] = [polygons[rows[a]], polygons[rows[b]]];
      if (one.reason !== other.reason || rootOf(rows[a]) === rootOf(rows[b]) || !isNear(boxes[a], boxes[b])) continue;
      const touches = sidesOf(one.corners).some((p) => sidesOf(other.corners).some((q) => overlap(p, q, tolerance) > least));
      if (touches) join(rows[a], rows[b]);
    }
  }
}

/** Joins pieces of faces that share an edge, by the sides that lie on it. */
function joinAcross(ofFace, polygons, { page, groupOf, tolerance, least }, join) {
  const edges = new Map(); // corners of an edge -> faces with pieces
  const key = (point) => point.map((x) => x + 0).join();
  for (const face of ofFace.keys()) {
    for (const [p, q] of sidesOf(cornersOf(page, face))) {
      const name = [key(p), key(q)].sort().join(" ");
      if (!edges.has(name)) edges.set(name, { ends: [p, q], faces: [] });
      edges.get(name).faces.push(face);
    }
  }
  for (const { ends, faces: near } of edges.values()) {
    if (near.length < 2) continue;
    const normals = near.map((face) => unitNormal(page, face));
    const onEdge = near.map((face) => ofFace.get(face).flatMap((row) => spansOf(polygons[row], ends, tolerance).map((span) => [row, ...span])));
    for (let a = 0; a < near.length; a++) {
      for (let b = a + 1; b < near.length; b++) {
        if (groupOf[near[a]] !== groupOf[near[b]] || dot(normals[a], normals[b]) < CREASE) continue;
        for (const [row, low, high] of onEdge[a]) {
          for (const [other, from, to] of onEdge[b]) {
            const isOne = polygons[row].reason === polygons[other].reason && Math.min(high, to) - Math.max(low, from) > least;
            if (isOne) join(row, other);
          }
        }
      }
    }
  }
}

/** Intervals along an edge on which sides of a polygon lie. */
function spansOf({ corners }, [p, q], tolerance) {
  const axis = unit(subtract(q, p));
  return sidesOf(corners).flatMap((side) => {
    const places = side.map((point) => {
      const away = subtract(point, p);
      const at = dot(away, axis);
      return length(subtract(away, scale(axis, at))) <= tolerance ? at : NaN;
    });
    return places.every(Number.isFinite) ? [[Math.min(...places), Math.max(...places)]] : [];
  });
}
