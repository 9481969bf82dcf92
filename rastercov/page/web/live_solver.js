/**
 * Figures of a rig by the engine of this page: what each camera covers, what they cover together, and why
 * the rest is not covered. Nothing here knows the page: it runs in a worker, and in tests.
 *
 * A mesh is {vertices, faces, roles, isTask, group, unseeable}: metres; an RC_... sum, 1 for a face of the
 * task, the group and the area that is never seen of each face. A rig is {stations: [{id, camera, pose}],
 * cameras: {name: {lens, near, focus, task, ...}}, task, need, views, rows}: stations that are on; `need` views of
 * each face, and `views` of each group; numbers of a pinhole in pixels; `lens` numbers of another lens, or null, and their name, `lensName`; `rows`
 * as of `rowsOf`.
 */

import { isWithin } from "rastercov/live_rules.js";

/** Names of the bits of a reason that has no number, the last criterion first. */
const CRITERIA = ["uncertain", "baseline", "too_oblique", "occluded", "too_coarse", "out_of_focus", "outside"];
/** Lenses that are kept, some MB each, and solvers; a rig of more of them makes them anew. */
const MOST_KEPT = 16;
const TINY = 2.2250738585072014e-308;
/** Sums over groups. */
const SUMMED = ["m2", "bound_m2", "doubtful_m2", "of_m2"];

/** Makes what a key has, once while it is kept. */
function keep(make, free) {
  const known = new Map();
  return (key, ...of) => {
    if (!known.has(key)) {
      if (known.size >= MOST_KEPT) {
        known.forEach(free);
        known.clear();
      }
      known.set(key, make(...of));
    }
    return known.get(key);
  };
}

export class Solver {
  #engine;
  #solverOf; // of a camera: what judges whole faces through it
  #lensOf;
  #parts = {}; // part of each face of the task, or -1: 0 for the whole, or its group
  #covered = null; // the last answer of `cover`

  constructor(engine, mesh) {
    this.#engine = engine;
    this.mesh = mesh;
    this.n = mesh.roles.length;
    this.call = engine.call.bind(engine);
    this.reasons = engine.constants;
    this.surface = this.#surfaceOf(mesh.roles);
    this.#lensOf = keep((lens) => this.call("rc_lens_create", lens, lens.length), (lens) => this.call("rc_lens_free", lens));
    this.#solverOf = keep(
      () => this.call("rc_solver_create", this.surface, this.reasons.RC_CERTIFIED, 1),
      (solver) => this.call("rc_solver_free", solver),
    );
    this.areas = new Float64Array(this.n);
    this.call("rc_surface_areas", this.surface, this.n, this.areas);
    const partsBy = (of) => Int32Array.from(mesh.isTask, (isTask, f) => (isTask ? of(f) : -1));
    this.#parts = { whole: partsBy(() => 0), groups: partsBy((f) => mesh.group[f]) };
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

  /** A camera as the engine takes it. */
  #cameraOf(camera) {
    const { lens, lensName } = camera;
    return lens ? { ...camera, lens: this.#lensOf(lensName, lens) } : camera;
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
    const areas = new Float64Array(this.n);
    this.call("rc_regions_areas", regions, 0, 1, this.n, areas, areas.slice());
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
    const levels = Array.from({ length: views }, (_, level) => {
      const areas = new Float64Array(this.n);
      this.call("rc_union_areas", union, level + 1, this.n, areas, areas.slice());
      return areas;
    });
    const [whole] = this.#sums(union, this.#parts.whole, [views], views);
    const groups = this.#sums(union, this.#parts.groups, rig.views, views);
    this.call("rc_union_free", union);
    const share = Float64Array.from(this.areas, (area, f) => levels[Math.min(rig.need[f], views) - 1][f] / Math.max(area, TINY));
    const sumOf = (rows) => Object.fromEntries(SUMMED.map((name) => [name, rows.reduce((all, row) => all + groups[row][name], 0)]));
    const { m2, doubtful_m2 } = rig.needed ? sumOf(rig.groups) : whole;
    const covered = figuresOf({ ...whole, m2, doubtful_m2 }, rig.needed ?? views);
    this.#covered = { covered, required: (rig.required ?? []).map(sumOf), share, cameras };
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

  /** Covered area of each part of the surface, counted up to its own of the `most` views of a union. */
  #sums(union, parts, views, most) {
    const sums = new Float64Array(views.length * (most + 3));
    this.call("rc_union_sums", union, this.n, parts, views.length, views, sums);
    return views.map((own, row) => {
      const levels = [...sums.subarray(row * (most + 3), (row + 1) * (most + 3))];
      const [bound_m2, doubtful_m2, of_m2] = levels.splice(most);
      return { levels: levels.slice(0, own), m2: levels[own - 1], bound_m2, doubtful_m2, of_m2 };
    });
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

  /** What hides points of a face in each station, the `hiders` or -1, and the share of the face that it covers. */
  why(rig, points, face) {
    const network = this.#networkOf({ ...rig, rows: rig.stations.map((_, at) => ({ stations: [at], gate: null })) });
    return this.#judgePoints(rig, points, Array(points.length / 3).fill(face)).map(({ hiders }, at) => {
      const share = this.#areasOf(network, at).areas[face] / this.areas[face];
      return { station: rig.stations[at].id, hiders, share };
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
    const points = spots.flatMap(({ point }) => point);
    const judged = this.#judgePoints(rig, points, spots.map(({ face }) => face));
    const failed = this.failed(rig, { points, normals: spots.flatMap(({ normal }) => normal), reasons: judged.map(({ reasons }) => reasons) });
    return spots.map((_, at) =>
      failed.map((of, row) => {
        const { stations } = rig.rows[row];
        const { reason, place, ...rest } = of(at);
        const hider = isWithin("occluded", reason) ? judged[stations[place]].hiders[at] : -1;
        return { ...rest, reason, hider, camera: rig.stations[stations[Math.max(place, 0)]].camera };
      }),
    );
  }

  /** Of each row a function of a point: {reason, place, device, nearness}, as `failures`, by the reasons of each station. */
  failed(rig, on) {
    const names = Object.keys(rig.reasons);
    return this.together(rig, on).map(({ reasons, devices }, row) => (at) => {
      const [code, place] = [reasons[at], devices[at]];
      return { reason: names[code], place, device: rig.rows[row].gate?.names[place] ?? "", nearness: this.nearness[code] };
    });
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

/** `covered_area` of a summary, as AreaNetwork.summary. */
function figuresOf({ levels, m2, bound_m2, doubtful_m2, of_m2 }, views) {
  const percent = (part) => (of_m2 > 0 ? 100 * (part / of_m2) : 0);
  return {
    percent: percent(m2),
    bound_percent: percent(bound_m2),
    m2,
    bound_m2,
    of_m2,
    views,
    by_views: levels.map((area, level) => ({ views: level + 1, percent: percent(area), m2: area })),
    ...(doubtful_m2 > 0 ? { doubtful_percent: percent(doubtful_m2), doubtful_m2 } : {}),
  };
}

const posesOf = (rig, stations) => stations.flatMap((at) => rig.stations[at].pose);
