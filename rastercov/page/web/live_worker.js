/**
 * Answers of the engine beside the page: in a worker, so that drawing never waits, or in the page itself
 * where a browser gives it none.
 *
 * A question is {id, name, args} of a method of `Figures`; its answer {id, result} or {id, fault, status}.
 */

import { Engine, EngineError } from "rastercov/live_engine.js";
import { Solver } from "rastercov/live_solver.js";
import { OF_RULES, facesOf, leastIncidence } from "rastercov/live_paint.js";
import { joinRows, measureFaces } from "rastercov/live_rules.js";

const RAYS_OF_SIDE = 8;
const NO_MEMORY = "expected enough memory for this rig, got too little; close other pages, delete cameras, or use rastercov view";

/** Figures of rigs by solvers of one engine, one for the task and each goal, and by another where it failed. */
export class Figures {
  #engine = null;
  #solvers = new Map(); // by the part of the plan that rigs are for
  #judged = new Map(); // whole faces through a station, by all that they depend on

  constructor(bytes, mesh) {
    this.bytes = bytes;
    this.mesh = mesh;
  }

  /** Runs a method, or one of the solver of a rig; what the engine refused leaves no engine. */
  async answer(name, args) {
    try {
      this.#engine ??= await Engine.of(this.bytes);
      return await (name in this ? this[name](...args) : this.#solverOf(args[0].part)[name](...args));
    } catch (error) {
      const isFull = error instanceof RangeError; // of an array that has no place
      if (isFull || error instanceof EngineError) {
        this.#engine = null;
        this.#solvers.clear();
        this.#judged.clear();
      }
      throw isFull ? new EngineError(NO_MEMORY, 500) : error;
    }
  }

  #solverOf(part = "") {
    const found = this.#solvers.get(part) ?? new Solver(this.#engine, { ...this.mesh, ...this.mesh.parts[part] });
    this.#solvers.set(part, found);
    return found;
  }

  /** Covered area, see `Solver.cover`, and figures of faces for a mode; of each station alone where asked. */
  frame(rig, mode, isAlone, isPartial = false) {
    const solver = this.#solverOf(rig.part);
    const { share, ...found } = solver.cover(rig, isPartial);
    const alone = isAlone ? solver.alone(rig) : null;
    if (mode === "area") return { ...found, alone, faces: { share } };
    const own = { n: solver.n, reasons: rig.reasons, nearness: solver.nearness };
    const judged = rig.stations.map((station) => this.#judgedOf(rig, station));
    const rows = joinRows(this.mesh, rig, judged, solver);
    const faces = facesOf(own, rows, rig.need);
    if (mode === "incidence") faces.incidence = leastIncidence(this.mesh, rig, rows);
    if (OF_RULES.includes(mode)) faces.measured = measureFaces(this.mesh, rig, rows, faces, solver);
    return { ...found, alone, faces };
  }

  /** 1 for each of some places, x y z each, that is outside of bodies and keeps a distance from every surface. */
  clear(rig, places, distance) {
    return this.#solverOf(rig.part).clear(places, distance);
  }

  #judgedOf(rig, station) {
    const camera = rig.cameras[station.camera];
    const { lens, ...numbers } = camera;
    const solver = this.#solverOf(rig.part);
    const key = JSON.stringify([rig.part, station.camera, station.pose, numbers, solver.taskOf(rig, camera)]);
    const found = this.#judged.get(key) ?? solver.judge(rig, station);
    this.#judged.delete(key);
    this.#judged.set(key, found);
    while (this.#judged.size > Math.max(64, rig.stations.length)) this.#judged.delete(this.#judged.keys().next().value);
    return found;
  }

  /** Numbers of a lens and rays of its border, by the bytes of the module that proves lenses. */
  async prove(bytes, { model, distortion, ...numbers }) {
    const { prover, lens } = await proved(bytes, model, distortion, numbers);
    const row = new Float64Array(prover.call("rc_lens_size", lens));
    const border = new Float64Array(12 * RAYS_OF_SIDE);
    prover.call("rc_lens_read", lens, row.length, row);
    prover.call("rc_lens_border", lens, RAYS_OF_SIDE, border);
    return { row, border };
  }

  /** Areas of the faces, m². */
  areas = () => this.#solverOf().areas;

  /** Figures of a face in each station, with what hides some points of it; what fails of it in each row, at its centroid. */
  why(rig, face, points, { point, normal }) {
    const solver = this.#solverOf(rig.part);
    const judged = rig.stations.map((station) => this.#judgedOf(rig, station));
    const said = solver.why(rig, points, face).map((each, row) => {
      const { densities, facing, reasons } = judged[row];
      return { ...each, density: densities[face], facing: facing[face], reason: reasons[face], nearness: solver.nearness[reasons[face]] };
    });
    const on = { points: point, normals: normal, reasons: said.map(({ reason }) => [reason]) };
    return { said, failed: solver.failed(rig, on).map((of) => of(0)) };
  }
}

/** A lens and its module, which goes with it; a lens that is refused leaves the solver as it is. */
async function proved(bytes, model, distortion, numbers) {
  const prover = await Engine.of(bytes);
  try {
    const code = prover.constants[`RC_MODEL_${model}`.toUpperCase()];
    if (code === undefined) throw new Error(`expected a lens model that this page supports, got ${model}; use rastercov view`);
    const optics = { ...numbers, model: code };
    return { prover, lens: prover.call("rc_lens_prove", optics, distortion, distortion.length) };
  } catch (error) {
    throw Object.assign(new Error(error.message), { status: 400 });
  }
}

/** Listens to questions in a worker; the first message has the module and the mesh. */
export function listen(scope) {
  let figures = null;
  scope.onmessage = async ({ data }) => {
    if (data.mesh) {
      figures = new Figures(data.bytes, data.mesh);
      return;
    }
    try {
      scope.postMessage({ id: data.id, result: await figures.answer(data.name, data.args) });
    } catch (error) {
      scope.postMessage({ id: data.id, fault: error.message, status: error.status ?? 500 });
    }
  };
}

/** Asks a worker of a script's text, or `Figures` here where there can be none. */
export class Asking {
  #waiting = new Map();
  #next = 0;

  constructor(script, bytes, mesh) {
    try {
      const address = URL.createObjectURL(new Blob([script], { type: "text/javascript" }));
      this.worker = new Worker(address);
      this.worker.onmessage = ({ data }) => this.#take(data);
      this.worker.onerror = (event) => this.#lose(event.message || "a worker could not start");
      this.worker.postMessage({ bytes, mesh });
    } catch {
      this.worker = null;
    }
    this.here = () => new Figures(bytes, mesh);
  }

  ask(name, ...args) {
    if (!this.worker) {
      this.figures ??= this.here();
      return this.figures.answer(name, args);
    }
    const id = ++this.#next;
    return new Promise((resolve, reject) => {
      this.#waiting.set(id, { resolve, reject, name, args });
      this.worker.postMessage({ id, name, args });
    });
  }

  #take({ id, result, fault, status }) {
    const { resolve, reject } = this.#waiting.get(id);
    this.#waiting.delete(id);
    if (fault) reject(new EngineError(fault, status));
    else resolve(result);
  }

  /** Without its worker the page answers itself. */
  #lose() {
    this.worker = null;
    for (const { resolve, reject, name, args } of this.#waiting.values()) this.ask(name, ...args).then(resolve, reject);
    this.#waiting.clear();
  }
}
