/**
 * Colours of faces by the figures of this page. Colours, words and scales of each mode are `own.scales` and
 * `own.classes`, which rastercov/report/live.py takes from faces that rastercov/report/modes.py has painted.
 *
 * `own` has n faces, their areas, isTask, and the `total` of these areas.
 */

import { centreOf, centroid, clamp, cornersOf, degrees, dot, normalOf, subtract, unit } from "rastercov/maths.js";

/** Values of modes: above 0 on a scale, else rows of classes, with -1 for none. */
const VALUES = {
  area: ({ share }) => share,
  reason: ({ rows }) => rows,
  coverage: ({ best }) => best,
  camera: ({ bestRow }) => bestRow,
  views: ({ views }, { views: classes }) => views.map((n) => Math.min(n, classes.length) - 1),
  density: ({ densities }) => densities,
  incidence: ({ incidence }) => incidence.map((angle) => (angle < Infinity ? Math.max(angle, 1e-7) : 0)),
  level: ({ facing, levels }) =>
    facing.map((value) => (value > 0 ? Object.values(levels).filter((least) => least <= value).length : -1)),
  device: ({ measured }) => measured.device,
  uncertainty: ({ measured }) => measured.deviation.map((value) => 1e6 * value),
};

/** Modes of rigs with a rule. */
export const OF_RULES = ["device", "uncertainty"];

/** Modes that this page paints. */
export const LIVE_MODES = Object.keys(VALUES);

/** Rounded as numpy does: halves to the even number. */
function roundEven(x) {
  const near = Math.round(x);
  return Math.abs(x - Math.trunc(x)) === 0.5 && near % 2 ? near - 1 : near;
}

/** Classes of a mode, of those of Python: cameras and devices of a rig after them. */
function classesOf(own, mode, values, { heads, measured }) {
  const { classes, cameraColours, covered } = own;
  if (mode === "views") return classes.views[values.reduce((most, n, f) => (own.isTask[f] && n > most ? n : most), 0)];
  if (mode in classes) return classes[mode];
  const { first, words, colours } = classes.none;
  const names = mode === "camera" ? heads.map(({ name }) => name) : measured.labels;
  const rows = mode === "camera" ? heads.map(({ row }) => row) : [...names.keys()];
  const more = rows.map((row) => cameraColours[row % cameraColours.length]);
  if (mode === "device") more[more.length - 1] = covered;
  const upTo = 256 - first;
  return { ...classes.none, words: [...words, ...names.slice(0, upTo)], colours: [...colours, ...more.slice(0, upTo)] };
}

/** Faces in the colours of a mode, {levels, palette, legend, scale}; `figures` as `facesOf` and the solver have them. */
export function paintFaces(own, mode, figures) {
  const values = VALUES[mode](figures, own.classes);
  if (own.scales[mode]) return onScale(own, own.scales[mode], values, mode === "uncertainty" ? [0, 1] : [0.02, 0.98]);
  const { first, occluder, words, colours, hatches } = classesOf(own, mode, values, figures);
  const levels = own.isTask.map((isTask, f) => (!isTask ? occluder : values[f] < 0 ? 0 : first + (values[f] % (256 - first))));
  const palette = new Uint8Array(3 * 256);
  colours.forEach((colour, level) => palette.set(colour, 3 * level));
  const legend = legendOf(own, levels, palette, words, hatches);
  if (mode === "level") legend.sort((a, b) => (a.percent === null) - (b.percent === null) || b.level - a.level);
  return { levels, palette, legend, scale: null };
}

/** Level of each face on a scale; those that are not above 0 have none. */
function onScale(own, { palette, words, scale }, values, shares) {
  const { first, last, is_log: isLog } = scale;
  const [low, high] = isLog ? endsOf(own, values, shares) : [scale.low, scale.high];
  const part = (value) => (isLog ? Math.log(value / low) / Math.log(high / low) : value / high);
  const at = (value) => first + roundEven(clamp(part(value), 0, 1) * (last - first));
  const levels = own.isTask.map((isTask, f) => (!isTask ? 1 : values[f] > 0 ? at(values[f]) : 0));
  return { levels, palette, legend: legendOf(own, levels, palette, words, []), scale: { ...scale, low, high } };
}

/** The values that two shares of the area are below. */
function endsOf({ isTask, areas }, values, shares) {
  const known = [...values.keys()].filter((f) => isTask[f] && values[f] > 0).sort((a, b) => values[a] - values[b]);
  if (!known.length) return [1, 10];
  const weight = known.reduce((sum, f) => sum + areas[f], 0);
  const [low, high] = shares.map((share) => {
    let sum = 0;
    return values[known.find((f) => (sum += areas[f]) >= share * weight) ?? known.at(-1)];
  });
  return [low, Math.max(high, low * (1 + 1e-9))];
}

/** Classes that occur, by falling area; words and hatches by level. */
function legendOf(own, levels, palette, words, hatches) {
  const [areas, counts, scored] = [new Float64Array(256), new Uint32Array(256), new Uint32Array(256)];
  levels.forEach((level, f) => {
    areas[level] += own.areas[f];
    counts[level] += 1;
    scored[level] += own.isTask[f];
  });
  const entries = words.map((label, level) => ({
    level,
    label,
    colour: [...palette.subarray(3 * level, 3 * level + 3)],
    percent: scored[level] ? 100 * (areas[level] / own.total) : null,
    hatch: hatches[level] ?? 0,
  }));
  return entries.filter(({ level }) => counts[level]).sort((a, b) => (b.percent ?? -1) - (a.percent ?? -1));
}

/** Least angle of incidence at which a row covers each face, at its centroid, degrees; or infinity. */
export function leastIncidence(mesh, rig, rows) {
  const covered = Object.keys(rig.reasons).indexOf("covered");
  return Float64Array.from(rows[0]?.reasons ?? [], (_, f) => {
    const corners = cornersOf(mesh, f);
    const normal = unit(normalOf(corners));
    const rays = rig.rows.map(({ stations: [at] }) => unit(subtract(centreOf(rig.stations[at].pose), centroid(corners))));
    const cosines = rays.filter((_, row) => rows[row].reasons[f] === covered).map((ray) => Math.abs(dot(ray, normal)));
    return cosines.length ? degrees(Math.acos(Math.min(1, Math.max(...cosines)))) : Infinity;
  });
}

/** Figures of whole faces by all heads and cameras, of what was judged of each, in their order. */
export function facesOf({ n, reasons, nearness }, judged, need) {
  const [best, densities, facing] = [0, 0, 0].map(() => new Float64Array(n));
  const [views, bestRow, nearest] = [0, 0, 0].map(() => new Int32Array(n));
  const rows = new Uint8Array(n);
  const names = Object.keys(reasons);
  const [covered, none, few] = ["covered", "no_cameras", "too_few_views"].map((name) => names.indexOf(name));
  for (let f = 0; f < n; f++) {
    judged.forEach((each, row) => {
      if (each.coverage[f] > best[f]) [best[f], bestRow[f]] = [each.coverage[f], row];
      if (each.reasons[f] === covered) {
        views[f] += 1;
        densities[f] = Math.max(densities[f], each.densities[f]);
        facing[f] = Math.max(facing[f], each.facing[f]);
      } else if (!row || nearness[each.reasons[f]] > nearness[rows[f]]) [rows[f], nearest[f]] = [each.reasons[f], row];
    });
    if (!views[f]) bestRow[f] = -1;
    if (!judged.length) rows[f] = none;
    else if (views[f]) rows[f] = views[f] >= need[f] ? covered : few;
  }
  return { rows, views, best, bestRow, nearest, densities, facing };
}
