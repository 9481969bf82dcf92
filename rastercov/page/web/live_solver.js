/**
 * Figures of a rig by the engine of this page: what each camera covers, what they cover together, and why
 * the rest is not covered. Nothing here knows the page: it runs in a worker, and in tests.
 *
 * A mesh is {vertices, faces, roles, isTask, group, unseeable}: metres; an RC_... sum, 1 for a face of the
 * task, the group and the area that is never seen of each face. A rig is {stations: [{id, camera, pose}],
 * cameras: {name: {lens, near, focus, task, ...}}, task, need, rows}: stations that are on; `need` views of each
 * face; numbers of a pinhole in pixels; `lens` numbers of another lens, or null, and their name, `lensName`; `rows`
 * as of `rowsOf`.
 */

import { isWithin } from "rastercov/live_rules.js";
import { centreOf, cornersOf, dot, normalOf, subtract } from "rastercov/maths.js";

/** Part of a face below which a reason is rounding, and rounding of an area. */
const SLIVER_REL = 1e-9;
/** Height over a plane that is rounding, relative to distances from the origin. */
const ROUNDING_REL = 1e-15;
const NO_ANGLES = { least_deg: 0, most_deg: 180 };
const NO_DENSITIES = { min_pixel_density: 0, min_facing_density: 0, min_pixels_per_m2: 0 };
const LARGEST_SIDE = 131072; // of an image, pixels
const MOST_SETS = 61; // of criteria that cover anything, as in core/area/stages.py; the last is of all of them
/** Results of poses that are kept. */
const MOST_KEPT = 256;
/** Lenses that are kept, some MB each; a rig of more of them makes them anew. */
const MOST_LENSES = 16;
const TINY = 2.2250738585072014e-308;

/** Sum in the order of numpy. */
export function pairwise(x, at = 0, n = x.length) {
  if (n < 8) {
    let sum = 0;
    for (let i = 0; i < n; i++) sum += x[at + i];
    return sum;
  }
  if (n <= 128) {
    const r = [x[at], x[at + 1], x[at + 2], x[at + 3], x[at + 4], x[at + 5], x[at + 6], x[at + 7]];
    let i = 8;
    for (; i < n - (n % 8); i += 8) for (let k = 0; k < 8; k++) r[k] += x[at + i + k];
    let sum = r[0] + r[1] + (r[2] + r[3]) + (r[4] + r[5] + (r[6] + r[7]));
    for (; i < n; i++) sum += x[at + i];
    return sum;
  }
  const half = Math.floor(n / 2) - (Math.floor(n / 2) % 8);
  return pairwise(x, at, half) + pairwise(x, at + half, n - half);
}

export class Solver {
  #engine;
  #solvers = new Map(); // by camera
  #lenses = new Map();
  #rows = new Map(); // faces of the task, by group
  #covered = null; // the last answer of `cover`
  #kept = new Map(); // regions of a pose, by all that they depend on

  constructor(engine, mesh) {
    this.#engine = engine;
    this.mesh = mesh;
    this.n = mesh.roles.length;
    this.call = engine.call.bind(engine);
    this.reasons = engine.constants;
    this.surface = this.#surfaceOf(mesh.roles);
    this.areas = new Float64Array(this.n);
    this.call("rc_surface_areas", this.surface, this.n, this.areas);
    this.isTask = mesh.isTask;
    this.total = pairwise(this.#ofTask(this.areas));
  }

  get size() {
    return this.#engine.size;
  }

  /** How near a station with a reason is to covering, by its row. */
  get nearness() {
    this.ranks ??= Int32Array.from({ length: 256 }, (_, reason) => this.call("rc_nearness", reason));
    return this.ranks;
  }

  #surfaceOf(roles) {
    const { vertices, faces } = this.mesh;
    return this.call("rc_surface_create", vertices, vertices.length / 3, faces, this.n, roles);
  }

  /** See `Figures.clear`. */
  clear(places, distance) {
    const isClear = new Uint8Array(places.length / 3);
    this.call("rc_clear_places", this.surface, isClear.length, places, distance, isClear);
    return isClear;
  }

  /** Values of the faces of the task; of `group` alone where one is given. */
  #ofTask(values, group = null) {
    if (!this.#rows.has(group)) {
      const isOwn = (f) => this.isTask[f] && (group === null || this.mesh.group[f] === group);
      this.#rows.set(group, Int32Array.from(this.isTask.keys()).filter(isOwn));
    }
    const rows = this.#rows.get(group);
    const own = new Float64Array(rows.length);
    for (let at = 0; at < own.length; at++) own[at] = values[rows[at]];
    return own;
  }

  /** A camera as the engine takes it. */
  #cameraOf(camera) {
    const { lens, lensName } = camera;
    if (!lens) return camera;
    if (!this.#lenses.has(lensName)) {
      if (this.#lenses.size >= MOST_LENSES) this.#forgetLenses();
      this.#lenses.set(lensName, this.call("rc_lens_create", lens, lens.length));
    }
    return { ...camera, lens: this.#lenses.get(lensName) };
  }

  #forgetLenses() {
    for (const lens of this.#lenses.values()) this.call("rc_lens_free", lens);
    this.#lenses.clear();
  }

  #solverOf(key, surface) {
    const own = `${surface} ${key}`;
    if (!this.#solvers.has(own)) {
      if (this.#solvers.size >= 16) this.#forgetSolvers();
      this.#solvers.set(own, this.call("rc_solver_create", surface, this.reasons.RC_CERTIFIED, 1));
    }
    return this.#solvers.get(own);
  }

  #forgetSolvers() {
    for (const solver of this.#solvers.values()) this.call("rc_solver_free", solver);
    this.#solvers.clear();
  }

  /** Regions of a station by some thresholds: {handle, m2, areas, key}, kept. */
  #regionsOf(station, camera, task, surface = this.surface) {
    const { lens, ...numbers } = camera;
    const key = JSON.stringify([surface, station.pose, station.camera, numbers, task]);
    return this.#keep(key, () => {
      const solver = this.#solverOf(station.camera, surface);
      return this.call("rc_find_regions", solver, this.#cameraOf(camera), task, station.pose, 1, 0, 0);
    });
  }

  /** What the stations of a rig with a rule measure together, kept. */
  #together(gate, stations, parts) {
    const { k, needs, noise, stripes, least_deg, most_deg, most_deviation } = gate;
    const own = { k, needs, noise, stripes, least_deg, most_deg, most_deviation };
    const handles = parts.map(({ handle }) => handle);
    const poses = stations.flatMap(({ pose }) => pose);
    const key = JSON.stringify([own, parts.map((each) => each.key)]);
    return this.#keep(key, () => this.call("rc_regions_together", own, handles, poses, handles.length));
  }

  #keep(key, make) {
    let found = this.#kept.get(key);
    if (!found) {
      const handle = make();
      const [areas, bounds] = [new Float64Array(this.n), new Float64Array(this.n)];
      this.call("rc_regions_areas", handle, 0, this.n, areas, bounds);
      let m2 = 0; // in the order of faces, as np.bincount
      for (const area of areas) m2 += area;
      found = { handle, m2, areas, key };
    }
    this.#kept.delete(key); // the last one that was used
    this.#kept.set(key, found);
    return found;
  }

  /** Drops what was used longest ago, but as many as an answer needs. */
  #forget(needed) {
    for (const key of this.#kept.keys()) {
      if (this.#kept.size <= Math.max(MOST_KEPT, needed)) return;
      this.#drop(key);
    }
  }

  #drop(key) {
    this.call("rc_regions_free", this.#kept.get(key).handle);
    this.#kept.delete(key);
  }

  /** Thresholds of a rig for one of its cameras, an rc_task. */
  taskOf(rig, camera) {
    const task = { ...rig.task, ...camera.task };
    const [min_depth, max_depth] = camera.focus;
    const { max_incidence_deg, min_pixel_density, min_facing_density, min_pixels_per_m2 } = task;
    return { min_depth, max_depth: max_depth ?? Infinity, max_incidence_deg, min_pixel_density, min_facing_density, min_pixels_per_m2 };
  }

  /** Regions of all rows; `relaxed` thresholds in place of theirs, `limits` of rules, and images without borders. */
  #regionsOfAll(rig, relaxed = () => ({}), surface = this.surface, limits = {}, isWide = false) {
    this.#forget(2 * rig.stations.length);
    return rig.rows.map(({ stations, gate }) => {
      const own = stations.map((at) => rig.stations[at]);
      const parts = own.map((station) => {
        const camera = rig.cameras[station.camera];
        const task = this.taskOf(rig, camera);
        return this.#regionsOf(station, isWide ? widest(camera) : camera, { ...task, ...relaxed(camera, task) }, surface);
      });
      return gate ? this.#together({ ...gate, ...limits }, own, parts) : parts[0];
    });
  }

  /** A union of regions, counted up to some views, one after another as `rastercov check`; the caller frees it. */
  #unionOf(regions, views, surface = this.surface) {
    const union = this.call("rc_union_create", surface, views);
    for (const { handle } of regions) this.call("rc_union_add", union, handle);
    return union;
  }

  #free(...unions) {
    for (const each of unions) this.call("rc_union_free", each);
  }

  /** {faces, counts, tags, areas, corners} of a union. */
  #partsOf(union) {
    const [n, nCorners] = this.call("rc_union_size", union);
    const parts = {
      faces: new Int32Array(n),
      counts: new Int32Array(n),
      tags: new Int32Array(n),
      areas: new Float64Array(n),
      corners: new Float64Array(3 * nCorners),
    };
    const { faces, counts, tags, areas, corners } = parts;
    this.call("rc_union_read", union, n, nCorners, faces, counts, tags, areas, corners);
    return parts;
  }

  /**
   * Area that a rig covers: `covered` with its bound, as `covered_area` of a summary has it; `share` of each
   * face by the views that it needs; `cameras`, the area of each station that counts, with its row: that of its rig.
   * Of a partial question only the stations are of this rig: the rest is that of the last one.
   */
  cover(rig, isPartial = false) {
    const views = this.#mostViews(rig);
    const regions = this.#regionsOfAll(rig);
    const cameras = rig.rows.flatMap(({ stations }, row) =>
      stations.map((at) => ({ station: rig.stations[at].id, m2: regions[row].m2, row })),
    );
    if (isPartial && this.#covered?.cameras.length === cameras.length) return { ...this.#covered, cameras, isPartial };
    const union = this.#unionOf(regions, views);
    const rows = Array.from({ length: views }, (_, level) => {
      const [areas, bounds] = [new Float64Array(this.n), new Float64Array(this.n)];
      this.call("rc_union_areas", union, level + 1, this.n, areas, bounds);
      return { areas, bounds };
    });
    const excess = new Float64Array(this.n);
    this.call("rc_union_excess", union, this.n, excess);
    this.#free(union);
    const bound = rows[0].bounds;
    const share = new Float64Array(this.n);
    for (let f = 0; f < this.n; f++) {
      share[f] = rows[Math.min(rig.need[f], views) - 1].areas[f] / Math.max(this.areas[f], TINY);
    }
    const required = (rig.required ?? []).map((groups) => {
      const parts = groups.map(({ row, views: own }) => this.#ofFaces(rows, bound, excess, own, row));
      const sum = (name) => parts.reduce((all, part) => all + (part[name] ?? 0), 0);
      return Object.fromEntries(["m2", "bound_m2", "doubtful_m2", "of_m2"].map((name) => [name, sum(name)]));
    });
    this.#covered = { covered: this.#summary(rig, rows, bound, excess), required, share, cameras, total: this.total };
    return this.#covered;
  }

  #mostViews(rig) {
    return rig.needed ? Math.max(1, ...Object.values(rig.needed)) : rig.task.views;
  }

  /** Area that each row alone covers, m²: of a task of k views, what exactly k of them cover. */
  alone(rig) {
    const views = this.#mostViews(rig);
    if (!rig.rows.length || rig.needed) return rig.rows.map(() => null);
    const regions = this.#regionsOfAll(rig);
    const union = this.#unionOf(regions, views + 1);
    const found = regions.map(({ handle }) => {
      const area = new Float64Array(1);
      this.call("rc_union_alone", union, views, handle, 0, area);
      return area[0];
    });
    this.#free(union);
    return found;
  }

  /** `covered_area` of a summary, as AreaNetwork.summary. */
  #summary(rig, rows, bound, excess) {
    const whole = this.#ofFaces(rows, bound, excess, rows.length, null);
    if (!rig.needed) return whole;
    const percent = whole.of_m2 > 0 ? 100 / whole.of_m2 : 0;
    const parts = rig.groups.map(({ row, views }) => this.#ofFaces(rows, bound, excess, views, row));
    const m2 = parts.reduce((sum, part) => sum + part.m2, 0);
    return { ...whole, percent: percent * m2, m2, views: rig.needed };
  }

  #ofFaces(rows, bounds, excess, views, group) {
    const of = this.#ofTask(this.areas, group);
    const total = pairwise(of);
    const own = this.#ofTask(excess, group);
    const most = this.#ofTask(bounds, group);
    const top = this.#ofTask(rows[views - 1].areas, group);
    const m2 = rows.slice(0, views).map(({ areas }) => Math.min(pairwise(this.#ofTask(areas, group)), total));
    const bound = Math.min(pairwise(own), total);
    const doubtful = pairwise(top.map((area, f) => Math.min(area + most[f], of[f]) - Math.min(area + own[f], of[f])));
    const percent = total > 0 ? 100 / total : 0;
    return {
      percent: percent * m2.at(-1),
      bound_percent: percent * bound,
      m2: m2.at(-1),
      bound_m2: bound,
      of_m2: total,
      views,
      by_views: m2.map((area, level) => ({ views: level + 1, percent: percent * area, m2: area })),
      ...(doubtful > 0 ? { doubtful_percent: percent * doubtful, doubtful_m2: doubtful } : {}),
    };
  }

  /** Whole faces through one station: {reasons, coverage, densities, facing}. */
  judge(rig, station) {
    const camera = rig.cameras[station.camera];
    const solver = this.#solverOf(`faces ${station.camera}`, this.surface);
    const judged = {
      reasons: new Uint8Array(this.n),
      coverage: new Float64Array(this.n),
      densities: new Float64Array(this.n),
      facing: new Float64Array(this.n),
    };
    this.call("rc_judge_faces", solver, this.#cameraOf(camera), this.taskOf(rig, camera), station.pose, this.n, judged);
    return judged;
  }

  /** {reasons, hiders} of points of faces in each station, in their order. */
  #judgePoints(rig, points, faces) {
    return rig.stations.map((station) => {
      const camera = rig.cameras[station.camera];
      const found = { reasons: new Uint8Array(faces.length), hiders: new Int32Array(faces.length) };
      const args = [this.surface, this.#cameraOf(camera), this.taskOf(rig, camera), station.pose];
      this.call("rc_judge_points", ...args, faces.length, points, faces, found);
      return found;
    });
  }

  /** {reason, hider} of a point of a face in each station, and the share of the face that it covers. */
  why(rig, point, face) {
    return this.#judgePoints(rig, point, [face]).map(({ reasons, hiders }, at) => {
      const station = rig.stations[at];
      const camera = rig.cameras[station.camera];
      const share = this.#regionsOf(station, camera, this.taskOf(rig, camera)).areas[face] / this.areas[face];
      return { station: station.id, reason: reasons[0], hider: hiders[0], share };
    });
  }

  /** {reasons, devices} of points in each row, by the reasons of each station; a device is that of the rule, or -1. */
  together(rig, { points, normals, reasons }) {
    const n = points.length / 3;
    return rig.rows.map(({ stations, gate }) => {
      if (!gate) return { reasons: reasons[stations[0]], devices: new Int32Array(n) };
      const found = { reasons: new Uint8Array(n), devices: new Int32Array(n) };
      const own = stations.flatMap((at) => [...reasons[at]]);
      this.call("rc_judge_together", gate, posesOf(rig, stations), stations.length, n, points, normals, own, found);
      return found;
    });
  }

  /** Standard deviations of points by a row with a limit of it, metres. */
  deviations(rig, { stations, gate }, points) {
    const found = new Float64Array(points.length / 3);
    this.call("rc_measure_points", gate, posesOf(rig, stations), stations.length, found.length, points, found);
    return found;
  }

  /**
   * What fails at spots {point, face, normal} in each row: {reason, hider, device, nearness}, a name, a face or
   * -1, the camera of a rule, and how near the row is to covering.
   */
  failures(rig, spots) {
    const names = Object.keys(rig.reasons);
    const points = spots.flatMap(({ point }) => point);
    const judged = this.#judgePoints(rig, points, spots.map(({ face }) => face));
    const normals = spots.flatMap(({ normal }) => normal);
    const rows = this.together(rig, { points, normals, reasons: judged.map(({ reasons }) => reasons) });
    return spots.map((_, at) =>
      rig.rows.map(({ stations, gate }, row) => {
        const [code, device] = [rows[row].reasons[at], rows[row].devices[at]];
        const hider = isWithin("occluded", names[code]) ? judged[stations[device]].hiders[at] : -1;
        return { reason: names[code], hider, device: gate?.names[device] ?? "", nearness: this.nearness[code] };
      }),
    );
  }

  /**
   * Convex pieces that too few stations cover, {faces, counts, corners, areas, reasons}; `reasons` are names.
   * A piece that none covers has the criteria that must be met to cover it, see core/area/stages.py.
   */
  pieces(rig) {
    const views = this.#mostViews(rig);
    const union = this.#unionOf(this.#regionsOfAll(rig), views);
    const whole = this.call("rc_union_complete", union);
    const parts = this.#partsOf(whole);
    const made = { faces: [], counts: [], corners: [], areas: [], reasons: [], views: [] };
    const isUnseeable = this.#unseeable(union);
    this.#each(parts, (p, face, corners) => {
      const seen = parts.tags[p] - 1;
      if (!(seen < rig.need[face]) || !(parts.areas[p] > 0)) return;
      if (seen === 0 && !isUnseeable(face) && rig.rows.length) return; // divided below
      const none = rig.rows.length ? "too_few_views" : "no_cameras";
      const reason = isUnseeable(face) ? "unseeable" : seen > 0 ? "too_few_views" : none;
      keep(made, face, corners, parts.areas[p], reason, seen);
    });
    if (rig.rows.length) this.#divide(rig, whole, isUnseeable, made);
    const excess = new Float64Array(this.n); // by which covered area may be less
    this.call("rc_union_excess", union, this.n, excess);
    this.#free(union, whole);
    return { ...made, excess };
  }

  /** Whether a face is one that no camera can see; none is where cameras see into bodies. */
  #unseeable(union) {
    const { unseeable } = this.mesh;
    const [areas, bounds] = [new Float64Array(this.n), new Float64Array(this.n)];
    this.call("rc_union_areas", union, 1, this.n, areas, bounds);
    const isSeen = [...unseeable].some(
      ([face, area]) => areas[face] > 2 * (this.areas[face] - area) + SLIVER_REL * this.areas[face],
    );
    return (face) => !isSeen && unseeable.has(face);
  }

  #each({ faces, counts, corners }, use) {
    for (let p = 0, at = 0; p < faces.length; at += 3 * counts[p++]) {
      use(p, faces[p], corners.subarray(at, at + 3 * counts[p]));
    }
  }

  /** Adds the pieces that no station covers, divided by the fewest criteria without which one does. */
  #divide(rig, whole, isUnseeable, made) {
    const sets = this.call("rc_union_create_sets", this.surface);
    this.call("rc_union_add_set", sets, whole, -2, 0);
    const names = [""];
    const doubt = new Float64Array(this.n);
    const left = this.areas.map((area, f) => (this.mesh.roles[f] & this.reasons.RC_OCCLUDER || isUnseeable(f) ? 0 : area));
    const asked = this.#asked(rig);
    for (const { reason, union } of this.#stages(rig, asked, () => names.length < MOST_SETS && left.some((area) => area > 0))) {
      const [areas, bounds] = [new Float64Array(this.n), new Float64Array(this.n)];
      this.call("rc_union_areas", union, 1, this.n, areas, bounds);
      const isAll = reason === asked.join("+");
      if (areas.some((area) => area > 0) && (isAll || names.length < MOST_SETS)) {
        this.call("rc_union_add_set", sets, union, 1, names.length);
        names.push(reason);
      }
      const isLast = !names.includes(reason);
      for (let f = 0; f < this.n; f++) {
        doubt[f] += bounds[f];
        if (!isLast && areas[f] >= (1 - SLIVER_REL) * this.areas[f]) left[f] = 0;
      }
      this.#free(union);
    }
    const isFacing = this.#facing(rig);
    const parts = this.#partsOf(sets);
    this.#free(sets);
    const found = [];
    this.#each(parts, (p, face, corners) => {
      const tag = parts.tags[p];
      if (tag < 0 || !(parts.areas[p] > 0) || isUnseeable(face)) return;
      const reason = names[tag] || (isFacing[face] ? "outside" : "back_facing");
      found.push({ face, corners, area: parts.areas[p], reason });
    });
    this.#withoutSlivers(found, doubt);
    for (const { face, corners, area, reason } of found) keep(made, face, corners, area, reason, 0);
  }

  /** Unions of what stations cover without some criteria, the fewest first; the caller frees them. */
  *#stages(rig, asked, isOpen) {
    const sets = Array.from({ length: 2 ** asked.length - 1 }, (_, bits) => asked.filter((_, k) => ((bits + 1) >> (asked.length - 1 - k)) & 1));
    sets.reverse().sort((a, b) => a.length - b.length); // of as many the later criteria first
    const isDense = asked.includes("too_coarse");
    for (const rows of sets) {
      if (rows.length > 1 && rows.length < asked.length && !isOpen()) continue;
      yield { reason: rows.join("+"), union: this.#without(rig, rows, false) };
      const isSteep = isDense && rows.includes("too_oblique") && !rows.includes("too_coarse");
      if (isSteep) yield { reason: rows.join("+"), union: this.#without(rig, rows, true) };
    }
  }

  /** Names of the criteria that are asked, the latest first. */
  #asked(rig) {
    const gates = rig.rows.flatMap(({ gate }) => (gate ? [gate] : []));
    const cameras = rig.rows.flatMap(({ stations }) => stations.map((at) => rig.cameras[rig.stations[at].camera]));
    const tasks = cameras.map((camera) => this.taskOf(rig, camera));
    const has = {
      uncertain: gates.some((gate) => gate.most_deviation > 0),
      baseline: gates.some((gate) => gate.least_deg > 0 || gate.most_deg < 180),
      too_oblique: tasks.some((task) => task.max_incidence_deg < 90),
      occluded: true,
      too_coarse: tasks.some((task) => Object.keys(NO_DENSITIES).some((name) => task[name] > 0)),
      out_of_focus: tasks.some((task) => task.min_depth > 0 || task.max_depth < Infinity),
      outside: cameras.some(({ lens }) => !lens),
    };
    return Object.keys(has).filter((name) => has[name]);
  }

  /** Union of what stations cover without some criteria; densities at the allowed angle where `isSteep`. */
  #without(rig, rows, isSteep) {
    const is = (name) => rows.includes(name);
    const limits = { ...(is("uncertain") && { most_deviation: 0 }), ...(is("baseline") && NO_ANGLES) };
    const relaxed = (camera, task) => ({
      ...(isSteep && task.max_incidence_deg < 90 && steep(camera, task)),
      ...(is("too_oblique") && { max_incidence_deg: 90 }),
      ...(is("too_coarse") && NO_DENSITIES),
      ...(is("out_of_focus") && { min_depth: 0, max_depth: Infinity }),
    });
    this.bare ??= this.#surfaceOf(this.mesh.roles.map((role) => (role & this.reasons.RC_TWO_SIDED) | this.reasons.RC_TARGET));
    const surface = is("occluded") ? this.bare : this.surface;
    return this.#unionOf(this.#regionsOfAll(rig, relaxed, surface, limits, is("outside")), 1, surface);
  }

  /** 1 for faces of which enough stations of some row are in front, not edge-on. */
  #facing(rig) {
    const { roles } = this.mesh;
    const found = new Uint8Array(this.n);
    for (let f = 0; f < this.n; f++) {
      const corners = cornersOf(this.mesh, f);
      const [a] = corners;
      const normal = normalOf(corners);
      const sides = rig.stations.map(({ pose }) => {
        const eye = centreOf(pose);
        const height = dot(normal, subtract(eye, a));
        const size = Math.hypot(...normal) * (Math.hypot(...eye) + Math.hypot(...a));
        return Math.abs(height) > ROUNDING_REL * size ? Math.sign(height) : 0;
      });
      const isTwoSided = roles[f] & this.reasons.RC_TWO_SIDED;
      const holds = ({ stations, gate }, side) => {
        const sees = stations.map((at) => sides[at] === side);
        return sees.filter(Boolean).length >= (gate?.k ?? 1) && sees.every((each, k) => each || !gate?.needs[k]);
      };
      found[f] = rig.rows.some((row) => holds(row, 1) || (isTwoSided && holds(row, -1)));
    }
    return found;
  }

  /** Gives reasons that are less of a face than is certain the reason of most of it. */
  #withoutSlivers(found, doubt) {
    const sizes = new Map(); // face -> reason -> area
    for (const { face, reason, area } of found) {
      if (!sizes.has(face)) sizes.set(face, new Map());
      const own = sizes.get(face);
      own.set(reason, (own.get(reason) ?? 0) + area);
    }
    for (const each of found) {
      const own = sizes.get(each.face);
      if (own.size < 2 || own.get(each.reason) > doubt[each.face] + SLIVER_REL * this.areas[each.face]) continue;
      each.reason = [...own].reduce((most, next) => (next[1] > most[1] ? next : most))[0];
    }
  }
}

/** Densities of a steep view, at the angle that is allowed, see `Rules.without` of rastercov/core/coverage/task.py. */
function steep({ lens, fx, fy }, { max_incidence_deg, min_pixel_density, min_facing_density, min_pixels_per_m2 }) {
  const cosine = Math.cos((max_incidence_deg * Math.PI) / 180);
  const across = lens ? 1 : Math.min(fx, fy) / Math.sqrt(fx * fy);
  const least = Math.max(min_facing_density, min_pixel_density / cosine, across * Math.sqrt(min_pixels_per_m2 / cosine));
  return { ...NO_DENSITIES, min_facing_density: least };
}

const posesOf = (rig, stations) => stations.flatMap((at) => rig.stations[at].pose);

/** A camera with the largest image that one may have; of a lens, that which it has. */
function widest(camera) {
  if (camera.lens) return camera;
  const [right, down] = [camera.width, camera.height].map((side) => Math.floor((LARGEST_SIDE - side) / 2));
  const { width, height, cx, cy } = camera;
  return { ...camera, width: width + 2 * right, height: height + 2 * down, cx: cx + right, cy: cy + down };
}

function keep(made, face, corners, area, reason, views) {
  made.faces.push(face);
  made.counts.push(corners.length / 3);
  made.corners.push(...corners);
  made.areas.push(area);
  made.reasons.push(reason);
  made.views.push(views);
}
