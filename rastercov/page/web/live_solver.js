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

/** Names of the bits of a reason that has no number, the last criterion first. */
const CRITERIA = ["uncertain", "baseline", "too_oblique", "occluded", "too_coarse", "out_of_focus", "outside"];
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

  /** What judges whole faces through a camera. */
  #solverOf(camera) {
    if (!this.#solvers.has(camera)) {
      if (this.#solvers.size >= 16) this.#forgetSolvers();
      this.#solvers.set(camera, this.call("rc_solver_create", this.surface, this.reasons.RC_CERTIFIED, 1));
    }
    return this.#solvers.get(camera);
  }

  #forgetSolvers() {
    for (const solver of this.#solvers.values()) this.call("rc_solver_free", solver);
    this.#solvers.clear();
  }

  /** The network of a rig, a row for each of its own; it keeps what it found of cameras that are equal. */
  #networkOf(rig) {
    this.network ??= this.call("rc_network_create", this.surface, 1);
    this.call("rc_network_clear", this.network);
    for (const { stations, gate } of rig.rows) {
      for (const at of stations) {
        const { camera: name, pose } = rig.stations[at];
        const camera = rig.cameras[name];
        this.call("rc_network_add", this.network, this.#cameraOf(camera), this.taskOf(rig, camera), pose);
      }
      if (gate) this.call("rc_network_join", this.network, gate, stations.length);
    }
    return this.network;
  }

  /** {m2, areas} of what a row covers; `use` takes the regions besides. */
  #areasOf(network, row, use = () => null) {
    const regions = this.call("rc_network_regions", network, row);
    const [areas, bounds] = [new Float64Array(this.n), new Float64Array(this.n)];
    this.call("rc_regions_areas", regions, 0, this.n, areas, bounds);
    use(regions);
    this.call("rc_regions_free", regions);
    let m2 = 0; // in the order of faces, as np.bincount
    for (const area of areas) m2 += area;
    return { m2, areas };
  }

  /** Thresholds of a rig for one of its cameras, an rc_task. */
  taskOf(rig, camera) {
    const task = { ...rig.task, ...camera.task };
    const [min_depth, max_depth] = camera.focus;
    const { max_incidence_deg, min_pixel_density, min_facing_density, min_pixels_per_m2 } = task;
    return { min_depth, max_depth: max_depth ?? Infinity, max_incidence_deg, min_pixel_density, min_facing_density, min_pixels_per_m2 };
  }

  /**
   * Area that a rig covers: `covered` with its bound, as `covered_area` of a summary has it; `share` of each
   * face by the views that it needs; `cameras`, the area of each station that counts, with its row: that of its rig.
   * Of a partial question only the stations are of this rig: the rest is that of the last one.
   */
  cover(rig, isPartial = false) {
    const views = this.#mostViews(rig);
    const network = this.#networkOf(rig);
    const cameras = rig.rows.flatMap(({ stations }, row) => {
      const { m2 } = this.#areasOf(network, row);
      return stations.map((at) => ({ station: rig.stations[at].id, m2, row }));
    });
    if (isPartial && this.#covered?.cameras.length === cameras.length) return { ...this.#covered, cameras, isPartial };
    const union = this.call("rc_network_unite", network, views);
    const rows = Array.from({ length: views }, (_, level) => {
      const [areas, bounds] = [new Float64Array(this.n), new Float64Array(this.n)];
      this.call("rc_union_areas", union, level + 1, this.n, areas, bounds);
      return { areas, bounds };
    });
    const excess = new Float64Array(this.n);
    this.call("rc_union_excess", union, this.n, excess);
    this.call("rc_union_free", union);
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
    const network = this.#networkOf(rig);
    const union = this.call("rc_network_unite", network, views + 1);
    const area = new Float64Array(1);
    const alone = rig.rows.map((_, row) => {
      this.#areasOf(network, row, (regions) => this.call("rc_union_alone", union, views, regions, 0, area));
      return area[0];
    });
    this.call("rc_union_free", union);
    return alone;
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
    const solver = this.#solverOf(station.camera);
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
    const network = this.#networkOf({ ...rig, rows: rig.stations.map((_, at) => ({ stations: [at], gate: null })) });
    return this.#judgePoints(rig, point, [face]).map(({ reasons, hiders }, at) => {
      const share = this.#areasOf(network, at).areas[face] / this.areas[face];
      return { station: rig.stations[at].id, reason: reasons[0], hider: hiders[0], share };
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
   * What fails at spots {point, face, normal} in each row: {reason, hider, device, camera, nearness}, a name, a
   * face or -1, the camera of a rule that fails, that of the reason, and how near the row is to covering.
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
        const camera = rig.stations[stations[Math.max(device, 0)]].camera;
        return { reason: names[code], hider, device: gate?.names[device] ?? "", camera, nearness: this.nearness[code] };
      }),
    );
  }

  /**
   * Convex pieces of the dead zones of a rig, {faces, counts, corners, areas, reasons, zones}, the zones by falling
   * area; `reasons` are names.
   */
  pieces(rig) {
    const network = this.#networkOf(rig);
    this.unseeable ??= Float64Array.from({ length: this.n }, (_, face) => this.mesh.unseeable.get(face) ?? 0);
    const found = this.call("rc_find_zones", network, this.n, rig.need, Int32Array.from(this.mesh.group), this.unseeable);
    const [, n, nCorners] = this.call("rc_zones_size", found);
    const numbers = ["faces", "counts", "views", "zones", "reasons"].map((name) => [name, new Int32Array(n)]);
    const parts = { ...Object.fromEntries(numbers), areas: new Float64Array(n), corners: new Float64Array(3 * nCorners) };
    this.call("rc_zones_read", found, n, nCorners, parts);
    this.call("rc_zones_free", found);
    const names = Object.keys(rig.reasons);
    const nameOf = (code) => names[code] ?? CRITERIA.filter((_, k) => (code >> (CRITERIA.length - 1 - k)) & 1).join("+");
    return { ...parts, reasons: Array.from(parts.reasons, nameOf) };
  }
}

const posesOf = (rig, stations) => stations.flatMap((at) => rig.stations[at].pose);
