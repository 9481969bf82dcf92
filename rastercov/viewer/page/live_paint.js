/**
 * Colours of faces by the figures of this page: what rastercov/report/modes.py does, by the same levels.
 *
 * A painter gives {levels, palette, legend, scale}. `own` has what all of them need: n faces, their areas,
 * isTask, the labels, colours and hatches of reasons, and palettes, as the page was written with.
 */

import { centreOf, centroid, cornersOf, degrees, dot, length, normalOf, subtract } from "rastercov/maths.js";

const NOTHING = 0;
const OCCLUDER = 1;
const FIRST = 2;
const LAST = 255;
const MOST_VIEWS = 12;

/** Level of each face on a scale, of values in [0, 1]; those that are 0 have none. */
function onScale(own, values, { low = 0, high = 1, unit = "", none = "no coverage", isLog = false } = {}) {
  const levels = own.isTask.map((isTask, f) => {
    if (!isTask) return OCCLUDER;
    const value = Math.min(1, Math.max(0, values[f] || 0));
    return value > 0 ? FIRST + roundEven(value * (LAST - FIRST)) : NOTHING;
  });
  const legend = legendOf(own, levels, own.scale, { [NOTHING]: none, [OCCLUDER]: "occluder" });
  return { levels, palette: own.scale, legend, scale: { low, high, unit, is_log: isLog, first: FIRST, last: LAST } };
}

/** Rounded as numpy does: halves to the even number. */
function roundEven(x) {
  const near = Math.round(x);
  return Math.abs(x - Math.trunc(x)) === 0.5 && near % 2 ? near - 1 : near;
}

/** Classes that occur, by falling area; words by level. */
function legendOf(own, levels, palette, words, hatches = []) {
  const areas = new Float64Array(256);
  const counts = new Uint32Array(256);
  const scored = new Uint32Array(256);
  levels.forEach((level, f) => {
    areas[level] += own.areas[f];
    counts[level] += 1;
    scored[level] += own.isTask[f];
  });
  const entries = Object.entries(words).map(([key, label]) => {
    const level = Number(key);
    return {
      level,
      label,
      colour: [...palette.subarray(3 * level, 3 * level + 3)],
      percent: scored[level] ? (100 * areas[level]) / own.total : null,
      hatch: hatches[level] ?? 0,
    };
  });
  return entries.filter(({ level }) => counts[level]).sort((a, b) => (b.percent ?? -1) - (a.percent ?? -1));
}

const classes = (own, levels, palette, words, hatches) => ({
  levels,
  palette,
  legend: legendOf(own, levels, palette, words, hatches),
  scale: null,
});

/** Levels of rows from 0, which begin again after the last; -1 has none. */
const cycled = (own, rows) =>
  own.isTask.map((isTask, f) => (!isTask ? OCCLUDER : rows[f] < 0 ? NOTHING : FIRST + (rows[f] % (LAST - FIRST + 1))));

const paletteOf = (colours) => {
  const palette = new Uint8Array(3 * 256);
  colours.forEach((colour, level) => palette.set(colour, 3 * level));
  return palette;
};

const colourAt = (palette, level) => [...palette.subarray(3 * level, 3 * level + 3)];

function byReason(own, { rows }) {
  const names = Object.values(own.reasons);
  const levels = own.isTask.map((isTask, f) => (isTask ? rows[f] : names.length));
  const words = { ...names, [names.length]: "occluder" };
  return classes(own, levels, own.reasonPalette, words, own.hatches);
}

function byViews(own, { views }) {
  const capped = views.map((n) => Math.min(n, MOST_VIEWS));
  const most = Math.max(1, ...new Set(capped.filter((_, f) => own.isTask[f])));
  const levels = cycled(own, capped.map((n) => n - 1));
  const at = (n) => (n > 0 ? FIRST + roundEven((n / most) * (LAST - FIRST)) : NOTHING);
  const steps = Array.from({ length: most + 1 }, (_, n) => colourAt(own.scale, at(n)));
  const words = { [NOTHING]: "no view", [OCCLUDER]: "occluder" };
  for (let n = 1; n <= most; n++) {
    words[OCCLUDER + n] = `${n} ${n === 1 ? "view" : "views"}${n === MOST_VIEWS ? " or more" : ""}`;
  }
  return classes(own, levels, paletteOf([steps[0], own.occluder, ...steps.slice(1)]), words);
}

function byCamera(own, { bestRow, stations }) {
  const colours = stations.slice(0, LAST - FIRST + 1).map(({ row }) => own.cameraColours[row % own.cameraColours.length]);
  const words = { [NOTHING]: "not covered", [OCCLUDER]: "occluder" };
  stations.slice(0, LAST - FIRST + 1).forEach(({ name }, at) => (words[FIRST + at] = name));
  return classes(own, cycled(own, bestRow), paletteOf([own.uncovered, own.occluder, ...colours]), words);
}

/** By factors, from the values that 2 and 98 % of the area are below. */
function byDensity(own, { densities, unit }) {
  const known = [...densities.keys()].filter((f) => own.isTask[f] && densities[f] > 0);
  let [low, high] = [1, 10];
  if (known.length) {
    known.sort((a, b) => densities[a] - densities[b]);
    const weight = known.reduce((sum, f) => sum + own.areas[f], 0);
    const at = (part) => {
      let sum = 0;
      return densities[known.find((f) => (sum += own.areas[f]) >= part * weight) ?? known.at(-1)];
    };
    [low, high] = [at(0.02), at(0.98)];
    high = Math.max(high, low * (1 + 1e-9));
  }
  const part = (value) => Math.max(Math.log(Math.max(value, low) / low) / Math.log(high / low), 1e-9);
  const shares = densities.map((value) => (value > 0 ? part(value) : 0));
  return onScale(own, shares, { low, high, unit, none: "not covered", isLog: true });
}

/** Least angles of incidence, degrees; infinite where no station covers the face. */
function byIncidence(own, { incidence }) {
  const shares = incidence.map((angle) => (angle < Infinity ? Math.max(angle / 90, 1e-9) : 0));
  return reversed(own, onScale(own, shares, { low: 0, high: 90, unit: "deg", none: "not covered" }));
}

/** The same with the other end of the scale in the colour of what is covered. */
function reversed(own, found) {
  const palette = own.scale.slice();
  for (let level = FIRST; level <= LAST; level++) palette.set(colourAt(own.scale, LAST + FIRST - level), 3 * level);
  return { ...found, palette };
}

/** What fails of a rig with a rule. */
function byDevice(own, { measured: { labels, device } }) {
  const colours = [own.uncovered, own.occluder, ...own.cameraColours.slice(0, labels.length - 1), own.covered];
  const words = { [NOTHING]: "not covered", [OCCLUDER]: "occluder" };
  labels.forEach((label, at) => (words[FIRST + at] = label));
  return classes(own, cycled(own, device), paletteOf(colours), words);
}

const byDeviation = (own, { measured: { deviation } }) =>
  reversed(own, byDensity(own, { densities: deviation.map((value) => 1e6 * value), unit: "um" }));


function byLevel(own, { facing, levels: known }) {
  const limits = Object.entries(known);
  const rows = facing.map((value) => (value > 0 ? limits.filter(([, least]) => least <= value).length : -1));
  const words = { [NOTHING]: "not covered", [OCCLUDER]: "occluder", [FIRST]: `below ${limits[0]?.[0]}` };
  limits.forEach(([name, least], at) => (words[FIRST + 1 + at] = `${name}, ${least} px/m or more`));
  const found = classes(own, cycled(own, rows), own.levelPalette, words);
  found.legend.sort((a, b) => (a.percent === null) - (b.percent === null) || b.level - a.level);
  return found;
}

const PAINTERS = {
  area: (own, { share }) => onScale(own, share),
  reason: byReason,
  coverage: (own, { best }) => onScale(own, best),
  camera: byCamera,
  views: byViews,
  density: byDensity,
  incidence: byIncidence,
  level: byLevel,
  device: byDevice,
  uncertainty: byDeviation,
};

/** Modes of rigs with a rule. */
export const OF_RULES = ["device", "uncertainty"];

/** Modes that this page paints. */
export const LIVE_MODES = Object.keys(PAINTERS);

/** Faces in the colours of a mode; `figures` as `facesOf` and the solver have them. */
export const painted = (own, mode, figures) => PAINTERS[mode](own, figures);

/** Least angle of incidence at which a station covers each face, at its centroid, degrees; or infinity. */
export function leastIncidence(mesh, rig, judged) {
  const covered = Object.keys(rig.reasons).indexOf("covered");
  return Float64Array.from(judged[0]?.reasons ?? [], (_, f) => {
    const corners = cornersOf(mesh, f);
    const normal = normalOf(corners);
    const centre = centroid(corners);
    const cosines = judged.flatMap(({ reasons }, row) => {
      if (reasons[f] !== covered) return [];
      const away = subtract(centreOf(rig.stations[row].pose), centre);
      return [Math.min(1, Math.abs(dot(away, normal)) / (length(away) * length(normal)))];
    });
    return cosines.length ? degrees(Math.acos(Math.max(...cosines))) : Infinity;
  });
}

/** Figures of whole faces by all stations, of what the solver judged of each, in their order. */
export function facesOf(own, judged, need) {
  const { n } = own;
  const rows = new Uint8Array(n);
  const views = new Int32Array(n);
  const best = new Float64Array(n);
  const bestRow = new Int32Array(n).fill(-1);
  const densities = new Float64Array(n);
  const facing = new Float64Array(n);
  const names = Object.keys(own.reasons);
  const covered = names.indexOf("covered");
  judged.forEach((each, row) => {
    for (let f = 0; f < n; f++) {
      const doesCover = each.reasons[f] === covered;
      if (each.coverage[f] > best[f]) [best[f], bestRow[f]] = [each.coverage[f], row];
      if (!doesCover) {
        if (own.nearness[each.reasons[f]] > own.nearness[rows[f]]) rows[f] = each.reasons[f];
        continue;
      }
      views[f] += 1;
      densities[f] = Math.max(densities[f], each.densities[f]);
      facing[f] = Math.max(facing[f], each.facing[f]);
    }
  });
  for (let f = 0; f < n; f++) {
    if (views[f] >= need[f] && judged.length) rows[f] = covered;
    else if (!judged.length) rows[f] = names.indexOf("no_cameras");
    else if (views[f]) rows[f] = names.indexOf("too_few_views");
  }
  for (let f = 0; f < n; f++) if (!views[f]) bestRow[f] = -1;
  return { rows, views, best, bestRow, densities, facing };
}
