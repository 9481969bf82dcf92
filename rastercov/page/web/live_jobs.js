/**
 * Work of a page: the best next camera, some one after another, or a better pose, with progress and an end.
 *
 * Poses look at what is not covered, from allowed places around its normals; each is judged by the exact area
 * that all cameras cover together. The engine, or rastercov where that cannot, answers between two poses, so that
 * the page can be used meanwhile; an edit ends the work. A plan that says how is carried out by rastercov.
 */

import { refuse } from "rastercov/api.js";
import { editState, focusOf, stationOf } from "rastercov/live_rig.js";
import { polygonsOf } from "rastercov/live_zones.js";
import { add, clamp, column, distance, dot, length, lookingAt, movePose, multiply, normalOf, rotatePose, scale, subtract, unit } from "rastercov/maths.js";
import { squareMetres } from "rastercov/dom.js";
import { distances_to_try } from "rastercov/texts.js";

const MARGIN_REL = 1e-3; // distance from the box of places, relative to the size of the scene
const [FIRST_STEP, LAST_STEP] = [0.04, 0.002]; // of a search around a pose, relative to the size of the scene
const TURN = 2.5; // radians for a step of that size
const MOST_STEPS = 40;
const PLAN_EVERY = 300; // ms between two looks at the work of a plan
const LEAST_GAIN = 1e-9; // of the area of the task

/** Numbers in [0, 1), the same for the same seed. */
function numbers(seed) {
  let state = (seed * 2654435761 + 1) >>> 0;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

export class Work {
  #job = { id: null };

  constructor(live) {
    this.live = live;
  }

  /** Begins; the promise ends when it has begun. */
  start(what) {
    const job = { id: (this.#job.id ?? 0) + 1, kind: what.kind, status: "running", done: 0, total: null, words: "" };
    this.#job = job;
    this.began = this.stepBegan = performance.now();
    this.#run(job, what).then(
      (words) => Object.assign(job, { status: "done", words }),
      (error) => Object.assign(job, error === CANCELLED ? { status: "cancelled", words: "cancelled; nothing was changed" } : { status: "failed", words: error.message }),
    );
  }

  described() {
    const now = performance.now();
    const times = { seconds: (now - this.began) / 1000, step_seconds: (now - this.stepBegan) / 1000 };
    return this.#job.status === "running" ? { ...this.#job, ...times } : { ...this.#job };
  }

  cancel() {
    this.#job.isCancelled = true;
    return this.described();
  }

  async #run(job, what) {
    const { live } = this;
    const { history } = live;
    if (what.kind === "place" && live.data.scene.placement.is_by_plan) return this.#byPlan(job, what);
    if ((live.data.goals ?? []).some((each) => each.is_most && each.name === live.goal)) refuse(`expected a goal that requires coverage, got ${live.goal}, which limits it; click another goal, or the task`);
    if (what.kind === "refine") return this.#refine(job, what.station);
    const { revision } = history;
    const before = history.state;
    const shown = live.shown(before);
    let state = shown;
    const chosen = what.camera ?? Object.keys(state.cameras)[0];
    const camera = state.gates?.find(({ names }) => names.includes(chosen))?.names[0] ?? chosen;
    if (!(camera in state.cameras)) refuse(`there is no camera ${camera}; choose one from the list`);
    const isPlace = what.kind === "place";
    const count = isPlace ? (what.cameras ?? 1) : 1;
    if (isPlace) state = { ...state, stations: [] };
    let gain = 0;
    for (let number = 0; number < count; number++) {
      Object.assign(job, { words: isPlace ? `camera ${number + 1} of ${count}` : ADD, done: 0, total: this.live.data.scene.placement.tries });
      this.stepBegan = performance.now();
      const best = await this.#best(job, state, camera, number, { revision, shown, before });
      if (!best && number === 0 && !job.done) refuse("expected uncovered area, got none; no further camera is needed");
      if (!best && number === 0) refuse(`none of ${job.total} poses tried covers more; change the lens or the thresholds`);
      if (!best) break;
      for (const each of best.more) [state] = editState(state, { do: "add", ...each });
      gain += best.gain;
    }
    const n = state.stations.length;
    const words = isPlace ? `place ${n} ${n === 1 ? "camera" : "cameras"}` : ADD;
    history.take(live.atRest(state, shown, before), words);
    return `${words}: ${gainText(gain, state, isPlace ? "" : "more ")}`;
  }

  /** A compass search around the pose of a station: the best of twelve steps, smaller ones where none is better. */
  async #refine(job, id) {
    const { live } = this;
    const { history } = live;
    const { state: before, revision } = history;
    const state = live.shown(before);
    const own = stationOf(state, id);
    if (!own.is_on) refuse(`expected a camera that is on, got ${own.name}; switch it on`);
    const { size } = this;
    const worth = async (pose) => {
      this.#check(job, revision);
      const stations = state.stations.map((each) => (each === own ? { ...each, pose } : each));
      return live.worth({ ...state, stations }, state, before);
    };
    const words = `refine ${own.name}`;
    Object.assign(job, { words, done: 0, total: 12 * MOST_STEPS });
    const [free] = live.server ? await this.#clear(state, [[{ camera: own.camera, pose: own.pose }]]) : [[own]];
    if (!free) refuse(`expected ${own.name} near an allowed place, got it farther away; move it closer`);
    const start = checkWorth(await worth(own.pose));
    let best = { pose: own.pose, m2: start };
    if (free[0].pose.some((value, k) => value !== own.pose[k])) best = { pose: free[0].pose, m2: await worth(free[0].pose) };
    let step = FIRST_STEP;
    for (let round = 0; round < MOST_STEPS && step > LAST_STEP; round++) {
      let next = best;
      const tried = neighbours(best.pose, step * size, step * TURN).map((pose) => [{ camera: own.camera, pose }]);
      for (const [{ pose }] of await this.#clear(state, tried, own.pose)) {
        const m2 = await worth(pose);
        if (m2 > next.m2 + LEAST_GAIN * size ** 2) next = { pose, m2 };
        job.done += 1;
      }
      if (next === best) step /= 2;
      best = next;
    }
    if (best.m2 <= start) return `${words}: no better pose found`;
    const [made] = editState(state, { do: "pose", station: id, pose: best.pose });
    history.take(live.atRest(made, state, before), words);
    return `${words}: ${gainText(best.m2 - start, state)}`;
  }

  /** Follows a plan that an earlier page of the program began. */
  async resume() {
    if ((await this.live.server?.job())?.status === "running") this.start({ kind: "place", isBegun: true });
  }

  /** Cameras of the plan, as `rastercov place` chooses them. */
  async #byPlan(job, { cameras = null, isBegun }) {
    const { server, history, first } = this.live;
    const { revision } = history;
    if (!isBegun) await server.startJob({ cameras });
    for (;;) {
      if (job.isCancelled) await server.cancelJob();
      const { status, stations, ...said } = await server.job();
      Object.assign(job, { done: said.done, total: said.total, words: said.words });
      this.stepBegan = performance.now() - 1000 * (said.step_seconds ?? 0);
      if (status === "cancelled") throw CANCELLED;
      if (status === "failed") refuse(said.words);
      if (history.revision !== revision) throw EDITED;
      if (status === "done") {
        history.take({ ...first, stations }, said.words);
        return `${said.words}: done`;
      }
      await new Promise((resolve) => setTimeout(resolve, PLAN_EVERY));
    }
  }

  /** {more, gain} of the cameras that add most, {camera, pose} each, or null. */
  async #best(job, state, camera, seed, { revision, shown, before }) {
    const { live } = this;
    const worth = (own) => live.worth(own, shown, before);
    const [least, pieces] = await Promise.all([worth(state), live.open(state, shown, before)]);
    checkWorth(least);
    let best = null;
    const known = live.candidatesOf(camera);
    const drawn = (known ?? (await this.#poses(state.cameras[camera], pieces, numbers(seed + 1)))).map((pose) => placeRule(state, camera, pose));
    const tried = known ? drawn : await this.#clear(state, drawn);
    if (drawn.length && !tried.length && seed === 0) refuse(`none of ${drawn.length} places tried is free for a camera; change the lens`);
    job.total = tried.length;
    for (const more of tried) {
      this.#check(job, revision);
      const stations = [...state.stations, ...more.map((each, at) => ({ ...each, id: -1 - at, name: "tried", is_on: true }))];
      const gain = (await worth({ ...state, stations })) - least;
      if (gain > Math.max(best?.gain ?? 0, LEAST_GAIN * this.size ** 2)) best = { more, gain };
      job.done += 1;
    }
    return best;
  }

  /** Poses of a camera that look at open pieces from places that are allowed. */
  async #poses(camera, pieces, random) {
    const { live } = this;
    const spots = [...spotsBefore(live, camera, Array.isArray(pieces) ? pieces : openParts(pieces), random)];
    const eyes = live.server && spots.length ? (await live.ask("allowed", { eyes: spots.map(({ eye }) => eye) })).eyes : null;
    const { up } = live.data.scene;
    return spots.map(({ eye, middle }, row) => lookingAt(eyes ? eyes[row] : eye, middle, up));
  }

  /** Ends work that was cancelled, or whose rig was edited. */
  #check(job, revision) {
    if (job.isCancelled) throw CANCELLED;
    if (this.live.history.revision !== revision) throw EDITED;
  }

  /** Size of the scene. */
  get size() {
    return distance(...this.live.data.scene.bounds);
  }

  /** Those of some cameras, {camera, pose} of a rig each, at allowed places; or that are outside of bodies and as far from surfaces as their size; or at a place. */
  async #clear(state, tried, { 3: x, 7: y, 11: z } = {}) {
    const each = tried.flat();
    const eyes = each.map(({ pose }) => column(pose, 3));
    if (this.live.server) {
      const { eyes: moved, is_allowed: isAllowed } = await this.live.ask("allowed", { eyes });
      const at = (row) => ({ ...each[row], pose: each[row].pose.map((value, k) => (k % 4 === 3 && k < 12 ? moved[row][(k - 3) / 4] : value)) });
      return tried.flatMap((own, row) => (own.every((_, k) => isAllowed[own.length * row + k]) ? [own.map((_, k) => at(own.length * row + k))] : []));
    }
    const limits = each.map(({ camera }) => focusOf(state.cameras[camera].plain)[1] / 2);
    const isClear = await this.live.asking.ask("clear", this.live.rigOf(state), eyes.flat(), Math.min(this.live.data.cameraSize, ...limits));
    const isFree = each.map((_, at) => isClear[at] || String(eyes[at]) === String([x, y, z]));
    return tried.filter((own, at) => own.every((_, k) => isFree[own.length * at + k]));
  }
}

const ADD = "add the best next camera";
const CANCELLED = new Error("cancelled");
const EDITED = new Error("the rig was edited meanwhile; start again");

/** {camera, pose} of a camera at a pose, or of all those of its rig with a rule, of which the first is there. */
function placeRule({ gates = [] }, camera, pose) {
  const gate = gates.find(({ names }) => names.includes(camera));
  if (!gate) return [{ camera, pose }];
  if (!gate.places) refuse("expected a rig whose cameras have fixed relative poses, got one without; place its cameras by hand");
  return gate.names.map((name, at) => ({ camera: name, pose: multiply(pose, gate.places[at]) }));
}

/** Poses one step aside along each axis of a camera, and turned about it. */
function neighbours(pose, step, angle) {
  const axes = [0, 1, 2].flatMap((at) => [1, -1].map((sign) => scale(column(pose, at), sign)));
  return [...axes.map((axis) => movePose(pose, scale(axis, step))), ...axes.map((axis) => rotatePose(pose, axis, angle))];
}

/** The area of a rig, see `Live.worth`, that keeps the limits of goals. */
const checkWorth = (m2) => (m2 >= 0 ? m2 : refuse("expected a rig within the limits of the goals, got one beyond; move or delete a camera"));

/** Words on a gain of `worthOf`. */
const gainText = (m2, { task, needed }, more = "more ") =>
  `${squareMetres(m2)} ${more}covered${Math.max(...(needed ? Object.values(needed) : [task.views])) < 2 ? "" : ", summed over views"}`;

/** Middle, normal and area of each piece that is not covered; what is never seen is none. */
function openParts(parts) {
  return polygonsOf(parts).flatMap(({ corners: own, area, reason }) => {
    const normal = normalOf(own);
    const middle = scale(own.reduce(add), 1 / own.length);
    return reason === "unseeable" || !(length(normal) > 0) ? [] : [{ middle, normal: unit(normal), area }];
  });
}

/** Places before open parts, {eye, middle}, drawn by their area. */
function* spotsBefore(live, camera, parts, random) {
  const { bounds, is_room: isRoom, placement } = live.data.scene;
  const size = distance(...bounds);
  const { plain, origins, depth_of_field: sharp } = camera;
  const focus = sharp ? [sharp[0], sharp[1] ?? Infinity] : [0, Infinity];
  const whole = origins ? size : (size * Math.max(plain.fx, plain.fy)) / Math.min(plain.width, plain.height);
  const kept = Math.min(live.data.cameraSize ?? 0, focus[1] / 2);
  const [near, far] = distances_to_try(size, whole, focus, plain.near ?? 0, kept);
  const reach = isRoom ? -MARGIN_REL * size : Math.max(2 * size, far);
  const [low, high] = [bounds[0].map((x) => x - reach), bounds[1].map((x) => x + reach)];
  const total = parts.reduce((sum, { area }) => sum + area, 0);
  for (let k = 0; k < placement.tries && total > 0; k++) {
    let left = random() * total;
    const { middle, normal } = parts.find(({ area }) => (left -= area) <= 0) ?? parts.at(-1);
    const slope = [0, 0, 0].map(() => placement.spread * (2 * random() - 1));
    const direction = unit(add(normal, subtract(slope, scale(normal, dot(slope, normal)))));
    const away = near * (far / near) ** random();
    const eye = add(middle, scale(direction, away)).map((x, axis) => clamp(x, low[axis], high[axis]));
    if (distance(middle, eye) > 1e-9) yield { eye, middle };
  }
}
