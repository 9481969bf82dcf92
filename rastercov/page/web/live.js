/**
 * The page's own program: the rig, its edits and their history, and figures by the engine inside.
 *
 * An exported page has everything in its element #live, bytes as base64 of zlib and the rest as JSON, and
 * nothing leaves it. A served page opens the same from a `Server`, which keeps what it stores, saves files, and
 * answers what the engine cannot, by questions with the whole rig: see rastercov/page/live.py and session.py.
 */

import { base64Of, bytesOf, expected, refuse } from "rastercov/api.js";
import { metres, squareMetres } from "rastercov/dom.js";
import { fragmentOf, rigOfFragment, through } from "rastercov/live_link.js";
import { pageOf, planFile, rigFile, surfaceFiles, taskFile } from "rastercov/live_files.js";
import { Work } from "rastercov/live_jobs.js";
import { History, described, editState, focusOf, opticsOf } from "rastercov/live_rig.js";
import { LIVE_MODES, paintFaces } from "rastercov/live_paint.js";
import { headsOf, isWithin, labelOf, nearest, rowsOf } from "rastercov/live_rules.js";
import { centreOf, centroid, clamp, column, cornersOf, degrees, distance, dot, length, multiply, normalOf, rigidInverse, subtract } from "rastercov/maths.js";
import { advice_of, area, density_text, ends_in_words, hidden_by, number, outcome_line, percent, share_of, short_by, status_of, verdict_of, verdict_of_rigs } from "rastercov/texts.js";
import { Refused } from "rastercov/plain.js";
import { polygonsOf, spotsOf, zonesOf } from "rastercov/live_zones.js";
import { Asking } from "rastercov/live_worker.js";
import { offerFile } from "rastercov/status.js";

const TWO_SIDED = 4; // of roles, as in rastercov.h
/** Lenses that were changed and are kept. */
const MOST_LENSES = 32;
const CHANGED = "the rig has changed since; the page now shows the new rig";
const NO_ANSWER = "not available in an exported page: use rastercov view";

/** Bytes of base64 of zlib; those of an array. */
export async function inflate(text) {
  if (ArrayBuffer.isView(text)) return text.buffer.slice(text.byteOffset, text.byteOffset + text.byteLength);
  try {
    return (await through(bytesOf(text), new DecompressionStream("deflate"))).buffer;
  } catch {
    refuse("expected the data of this file, got damaged bytes; get the file again");
  }
}

export class Live {
  isRecorded = false;
  #variants = new Map(); // name -> [state, figures]
  lenses = {}; // numbers of each, by its name
  borders = {}; // of the lenses that were proved here
  #frame = null; // the last one
  goal = ""; // that is shown, "" for the task
  #phase = { at: [], bodies: {} }; // that is shown, with the pose of the body of each camera that is on one
  #places = null; // {places, cost} of the stations, where a plan has them
  #stored = { revision: 0, steps: [], rest: "" }; // by the program
  #isDrawingSaved = true;

  constructor(data, server = null) {
    this.data = data;
    this.server = server;
    this.isLive = !server;
    this.name = "live";
    this.work = new Work(this);
    this.isKept = data.scene?.constraints?.is_kept ?? false; // whether cameras keep the constraints of the plan
    if (server || data.isPlayground || location.protocol === "about:") this.link = null; // no address has the scene
    if (server) this.#serve(server);
  }

  /** What a program does in place of this page. */
  #serve(server) {
    const asked = (what) => ({ ...this.asked(), ...what });
    this.canSave = () => true;
    this.drawing = server.drawing;
    this.keepDrawing = (changes) => {
      this.#isDrawingSaved = false;
      return server.keepDrawing(changes);
    };
    this.save = async (what) => {
      const texts = what === "rig" && this.history.state.stations.length ? this.texts() : {};
      const done = await server.save(asked({ what, texts }));
      if (what === "rig") {
        this.history.saved();
        this.#isDrawingSaved = true;
      }
      return done;
    };
    this.image = (station, side) => this.ask("image", { station, side });
    this.ping = async () => {
      const { revision, measured } = await server.ping();
      const isOurs = revision === this.#stored.revision;
      return { revision: isOurs ? this.history.revision : -1, at: this.#phase.at, goal: this.goal, measured };
    };
  }

  /** The data of this page, or null where its file does not compute. */
  static dataOfPage() {
    const holder = document.getElementById("live");
    return holder && typeof WebAssembly === "object" ? JSON.parse(holder.textContent) : null;
  }

  async #open() {
    const { engine, mesh, worker, scene, state } = this.data;
    const [vertices, faces, groups] = await Promise.all([mesh.vertices, mesh.faces, mesh.groups].map(inflate));
    this.groupOf = new Uint16Array(groups);
    this.vertices = new Float64Array(vertices);
    this.faces = new Int32Array(faces);
    this.n = this.groupOf.length;
    if (engine) await this.#start(engine, mesh, worker, scene);
    const sold = this.server ? {} : JSON.parse(new TextDecoder().decode(await inflate(this.data.catalogue)));
    this.catalogue = Object.entries(sold).map(([name, plain]) => [name, wordsOf(plain)]);
    const [own] = editState({ ...state, sold, models: this.data.models }, { do: "restore", rig: state }); // refuses what is no rig
    this.first = this.#named(own);
    this.history = new History(await this.#linked(this.first));
    await this.load();
  }

  /** The engine, with the surfaces of the task and of each goal. */
  async #start(engine, mesh, worker, scene) {
    const bytes = await inflate(engine);
    const goals = (this.data.goals ?? []).map((each) => ({ ...each, limits: [{ ...each, goal: each.name, name: `goal ${each.name}` }] }));
    const parts = [{ ...mesh, name: "", limits: scene.required ?? [] }, ...goals];
    this.parts = new Map(parts.map((each) => [each.name, partOf(each, this.groupOf)]));
    const asked = Object.fromEntries([...this.parts].map(([name, { roles, isTask, unseeable }]) => [name, { roles, isTask, unseeable }]));
    const surface = { vertices: this.vertices, faces: this.faces, group: this.groupOf, parts: asked };
    this.asking = new Asking(worker, new Uint8Array(bytes), surface);
    this.lenses = Object.fromEntries(
      await Promise.all(Object.entries(this.data.lenses).map(async ([name, text]) => [name, new Float64Array(await inflate(text))])),
    );
    const areas = await this.asking.ask("areas");
    const { colours } = this.data;
    // The data stays as it was: a page that is exported has it, too.
    const scales = Object.entries(colours.scales).map(([name, each]) => [name, { ...each, palette: bytesOf(each.palette) }]);
    this.painting = { n: this.n, areas, ...colours, scales: Object.fromEntries(scales) };
    this.areas = areas;
  }

  /** Takes what pages of this program have stored, if any. */
  async load() {
    if (!this.server) return;
    const { session, revision, steps, rest } = await this.server.load();
    const states = new Map(); // equal ones are one, as `is_shown` of a variant wants it
    const { sold, models } = this.first;
    const stateOf = (plain) => {
      const text = JSON.stringify(plain);
      if (!states.has(text)) states.set(text, { ...plain, sold, models });
      return states.get(text);
    };
    this.name = session;
    const all = steps.map(([state, words]) => [stateOf(state), words]);
    this.history = steps.length ? new History(null, { steps: all, at: rest.at, saved: rest.saved }) : new History(this.first);
    this.#variants = new Map((rest.variants ?? []).map(([name, state, figures]) => [name, [stateOf(state), figures]]));
    this.#isDrawingSaved = rest.isDrawingSaved ?? true;
    this.isKept = rest.isKept ?? this.data.scene.constraints.is_kept;
    this.goal = rest.goal ?? "";
    await this.#show(rest.phase ?? []);
    this.#stored = { revision, steps: steps.length ? all : [], rest: JSON.stringify(rest) };
  }

  /** Stores what has changed since the last time; refused where another page was first. */
  async #store() {
    const { steps, at, saved } = this.history.all;
    const known = this.#stored;
    const plain = ({ sold, models, ...state }) => state;
    const variants = [...this.#variants].map(([name, [state, figures]]) => [name, plain(state), figures]);
    const rest = { at, saved, variants, isKept: this.isKept, isDrawingSaved: this.#isDrawingSaved, goal: this.goal, phase: this.#phase.at };
    const text = JSON.stringify(rest);
    let keep = 0;
    while (keep < Math.min(steps.length, known.steps.length) && steps[keep] === known.steps[keep]) keep++;
    if (keep === steps.length && keep === known.steps.length && text === known.rest) return;
    const added = steps.slice(keep).map(([state, words]) => [plain(state), words]);
    const { revision } = await this.server.store({ revision: known.revision, keep, steps: added, rest });
    this.#stored = { revision, steps: steps.slice(), rest: text };
  }

  /** What a question is of: the rig as rastercov reads it, where bodies are at rest. */
  asked({ stations, cameras, task, needed, devices } = this.history.state) {
    return { rig: { stations, cameras, task, needed, devices }, at: this.#phase.at, goal: this.goal };
  }

  ask = (question, more = {}, state = this.history.state) => this.server.ask({ question, ...this.asked(state), ...more });

  /** Shows a phase by its numbers, the first for none. */
  async #show(at) {
    if (!this.server || this.#phase.key === JSON.stringify(at)) return;
    this.#phase = { ...(await this.ask("phase", { at })), key: JSON.stringify(at) };
  }

  /** A state with cameras where bodies carry them. */
  shown(state) {
    const { bodies } = this.#phase;
    const stations = state.stations.map((each) => (each.camera in bodies ? { ...each, pose: multiply(bodies[each.camera], each.pose) } : each));
    return { ...state, stations };
  }

  /** A state that was made of `shown`, which is of `state`, with cameras where bodies carry them from. */
  atRest(made, shown, state) {
    const { bodies } = this.#phase;
    const same = new Map(shown.stations.map((each, row) => [each, state.stations[row]]));
    const back = (each) => (each.camera in bodies ? { ...each, pose: multiply(rigidInverse(bodies[each.camera]), each.pose) } : each);
    return { ...made, stations: made.stations.map((each) => same.get(each) ?? back(each)) };
  }

  /** The action with its pose at an allowed place, and a line where that is another one. */
  async #settled(action, shown) {
    if (!this.isKept || !["pose", "add"].includes(action.do)) return { action, notice: "" };
    const own = shown.stations.find(({ id }) => id === action.station);
    const { pose, notice } = await this.ask("settled", { pose: action.pose, before: own?.pose ?? action.pose });
    return { action: { ...action, pose }, notice };
  }

  /** Values of a camera of the catalogue that an action names. */
  async #sold({ do: what, camera, source }, { cameras, sold }) {
    const name = { use: camera, add: camera, new_camera: source }[what];
    if (!this.server || !name || name in cameras) return sold;
    return { [name]: (await this.ask("camera", { name })).plain };
  }

  /** A state with new cameras as rastercov describes them, which refuses what is none. */
  async #described(state, before) {
    const cameras = { ...state.cameras };
    for (const [name, camera] of Object.entries(this.server ? cameras : {})) {
      if (Object.values(before.cameras).includes(camera)) continue;
      const said = await this.ask("camera", { plain: camera.plain });
      cameras[name] = { ...camera, ...said, lens: said.origins ? null : camera.lens };
    }
    return { ...state, cameras, sold: before.sold };
  }

  /** A state with the lenses of this file by what they are proved of. */
  #named(state) {
    const cameras = { ...state.cameras };
    for (const [name, camera] of Object.entries(cameras)) {
      if (!camera.lens) continue;
      cameras[name] = described(camera, state.models);
      this.lenses[cameras[name].lens] = this.lenses[camera.lens];
    }
    return { ...state, cameras };
  }

  /** A state whose lenses are proved, with their borders; those of this page first. */
  async #proved(state) {
    if (!this.asking) return state;
    const cameras = { ...state.cameras };
    for (const camera of Object.values(cameras)) {
      if (!camera.lens || camera.lens in this.lenses) continue;
      const { prover } = this.data;
      if (!prover && this.server) continue;
      if (!prover) expected("a lens model that this page supports", camera.model, "use rastercov view");
      const { row, border } = await this.asking.ask("prove", new Uint8Array(await inflate(prover)), opticsOf(camera));
      this.lenses[camera.lens] = row;
      this.borders[camera.lens] = Array.from({ length: border.length / 3 }, (_, k) => [...border.subarray(3 * k, 3 * k + 3)]);
      for (const old of Object.keys(this.borders).slice(0, -MOST_LENSES)) {
        delete this.lenses[old];
        delete this.borders[old];
      }
    }
    for (const [name, camera] of Object.entries(cameras)) {
      const border = this.borders[camera.lens];
      if (border) cameras[name] = { ...camera, border };
    }
    return { ...state, cameras };
  }

  /** The rig of the address, where it has one; else that of the file. */
  async #linked(state) {
    try {
      const rig = await rigOfFragment(location.hash, state);
      return rig ? await this.#proved(editState(state, { do: "restore", rig })[0]) : state;
    } catch {
      return state; // an address that was cut short
    }
  }

  /** Address of this page with the present rig. */
  async link() {
    const address = location.href.split("#")[0] + (await fragmentOf(this.history.state, this.first));
    history.replaceState(null, "", address);
    return address;
  }

  /** What is shown: the task, or a goal of the plan. */
  get part() {
    return this.parts.get(this.goal);
  }

  /** What paints its faces, with its area. */
  get own() {
    const { isTask } = this.part;
    this.part.total ??= Math.max(this.areas.reduce((sum, area, f) => sum + (isTask[f] ? area : 0), 0), 1e-300);
    return { ...this.painting, isTask, total: this.part.total };
  }

  canSave = (what) => what !== "report";

  async scene() {
    this.opening ??= this.#open();
    await this.opening;
    const { scene, candidates } = this.data;
    if (this.server) return scene;
    const [known] = Object.values(candidates ?? {});
    const placement = known ? { ...scene.placement, tries: known.length } : scene.placement;
    return { ...scene, placement, can_edit: true, catalogue: this.catalogue };
  }

  async soup() {
    await (this.opening ??= this.#open());
    const { origin } = this.data;
    const corners = new Float32Array(9 * this.n);
    for (let k = 0; k < 3 * this.n; k++) {
      for (let axis = 0; axis < 3; axis++) corners[3 * k + axis] = this.vertices[3 * this.faces[k] + axis] - origin[axis];
    }
    return { corners, origin };
  }

  async groups() {
    await (this.opening ??= this.#open());
    return this.groupOf;
  }

  async state() {
    await (this.opening ??= this.#open());
    return this.#state();
  }

  hasMode = (mode) => Boolean(this.server) || LIVE_MODES.includes(mode);

  #state() {
    const { cameras, task, needed, devices = [] } = this.history.state;
    const stations = this.shown(this.history.state).stations.map((each, row) => ({ ...each, place: this.#places?.places[row] ?? "allowed" }));
    const variants = [...this.#variants].map(([name, [state, figures]]) => ({
      ...figures,
      name,
      is_shown: state === this.history.state,
      is_of_task: state.task === task,
    }));
    const heads = headsOf(this.history.state).map(({ name, ids, counts }) => ({ name, ids, counts }));
    const rest = { session: this.name, heads, is_kept: this.isKept, variants, at: this.#phase.at, goal: this.goal, devices };
    const own = this.history.described();
    return { ...own, ...rest, is_saved: own.is_saved && this.#isDrawingSaved, stations, cameras, task, needed };
  }

  #rig = () => this.rigOf(this.history.state);

  /** A state as the solver takes it, for the task or a goal: stations that are on. */
  rigOf(state, part = this.part) {
    const { stations, cameras } = state;
    const { task, needed: views = null } = part.task ? part : state;
    const { groups, reasons } = this.data.scene;
    const wanted = groups.map(({ name }) => (views ? (views[name] ?? 1) : task.views));
    const used = {};
    const { is_most: isMost } = part; // all that a camera sees counts, blurred or without the others of its rule
    for (const [name, camera] of Object.entries(cameras)) {
      const { width, height, fx, fy, cx, cy, near = 0 } = camera.plain;
      const lens = camera.lens ? this.lenses[camera.lens] : null;
      const own = isMost ? undefined : camera.task;
      const focus = isMost ? [0, Infinity] : focusOf(camera.plain, (own ?? task).max_blur);
      used[name] = { width, height, fx, fy, cx, cy, near, lens, lensName: camera.lens, focus, task: own };
    }
    const on = stations.filter((each) => each.is_on);
    return {
      part: part.name,
      stations: on.map(({ id, camera, pose }) => ({ id, camera, pose })),
      cameras: used,
      task,
      need: new Int32Array(this.groupOf).map((group) => wanted[group]),
      needed: views,
      views: wanted,
      groups: part.rows,
      required: part.limits.map(({ rows = part.rows }) => rows),
      reasons,
      rows: isMost ? on.map((_, row) => ({ stations: [row] })) : rowsOf(state),
    };
  }

  /** Does an action; what is refused leaves everything as it was. */
  async act(request) {
    const [back, goal, phase, places, isKept, variants] = [this.history.kept(), this.goal, this.#phase, this.#places, this.isKept, this.#variants];
    try {
      return await this.#acted(request);
    } catch (error) {
      back();
      this.goal = goal;
      [this.#phase, this.#places, this.isKept, this.#variants] = [phase, places, isKept, variants];
      throw error;
    }
  }

  async #acted({ revision, mode, options, station, is_drag: isDrag, at = [], action, goal = "" }) {
    if (!this.server && !this.parts.has(goal)) refuse(`there is no goal ${goal}; choose one from the list`);
    this.goal = goal;
    await this.#show(at);
    const notice = await this.#edit(action, isDrag, revision);
    if (this.data.served?.has_places) this.#places = await this.ask("places");
    const isPartial = isDrag && action.do === "pose" && this.n >= this.data.unionAtRest;
    let found = null;
    try {
      if (this.isOwn(mode)) found = await this.#figures(mode, isDrag, isPartial);
    } catch (error) {
      if (!this.server) throw error;
    }
    found ??= await this.ask("frame", { mode, options, station, is_drag: isDrag });
    if (this.#places) found.json.summary.cost = this.#places.cost;
    this.#frame = { summary: found.json.summary };
    await this.#vary(action);
    if (this.server && !isDrag) await this.#store();
    return { json: { ...found.json, state: this.#state(), notice }, payload: found.payload };
  }

  /** Whether the engine of this page answers; without a program it is asked for everything. */
  isOwn(mode = "reason") {
    if (!this.asking || !this.server) return Boolean(this.asking);
    const { stations, cameras, task } = this.history.state;
    const on = stations.filter((each) => each.is_on);
    const isPlain = ({ camera: name }) => {
      const { origins, lens } = cameras[name];
      return !(origins || (lens && (!(lens in this.lenses) || task.min_pixels_per_m2 > 0)));
    };
    const { ofFaces, defaults } = this.data;
    const isOfPoints = ofFaces.every((name) => task[name] === defaults[name]);
    return LIVE_MODES.includes(mode) && isOfPoints && on.every(isPlain) && on.length * this.n <= this.data.mostPairs;
  }

  /** Figures by the engine, as the answer to "frame" has them. */
  async #figures(mode, isDrag, isPartial) {
    const rig = this.#rig();
    const others = [...this.parts.values()].filter((part) => part !== this.part && part.limits.length);
    const [found, ...rest] = await Promise.all([
      this.asking.ask("frame", rig, mode, !isDrag, isPartial),
      ...others.map((part) => this.asking.ask("cover", this.rigOf(this.history.state, part), isPartial)),
    ]);
    const areas = new Map([[this.goal, found.required], ...others.map(({ name }, at) => [name, rest[at].required])]);
    const heads = headsOf(this.history.state).flatMap(({ name, counts }, row) => (counts ? [{ name, row }] : []));
    const figures = { ...found.faces, heads, levels: this.data.scene.levels };
    const { levels, palette, ...shown } = paintFaces(this.own, mode, figures);
    // The engine has no figures of what is lost where groups need other numbers of views.
    const lost = this.server && rig.needed && !isDrag ? await this.ask("by_camera") : [];
    const { of_m2: total } = found.covered;
    const share = (m2) => (m2 === null || !(total > 0) ? null : 100 * (m2 / total));
    const summary = {
      covered: { area_percent: found.covered.percent },
      covered_area: found.covered,
      by_face_because: "",
      cost: null,
      required: [...this.parts.values()].flatMap(({ name, limits }) => limits.map((each, at) => requirementOf(each, areas.get(name)[at]))),
      by_camera: found.cameras.map(({ station, m2, row }) => ({
        station,
        faces: 0,
        area_percent: share(m2),
        alone_percent: lost.find((each) => each.station === station)?.alone_percent ?? (found.alone ? share(found.alone[row]) : null),
      })),
    };
    const json = { mode, ...shown, palette: base64Of(palette), summary, is_partial: found.isPartial };
    return { json, payload: Uint8Array.from(levels) };
  }

  /** Changes the rig; a line for the user, or "". */
  async #edit(action, isDrag, revision) {
    const { history } = this;
    if (action.do !== "none" && revision !== history.revision) {
      throw new Refused(CHANGED, 409);
    }
    let line = "";
    if (action.do === "undo") history.go(-1);
    else if (action.do === "redo") history.go(1);
    else if (action.do === "show_variant") this.#showVariant(action.name);
    else if (action.do === "constraints") this.#keep(action.is_kept);
    else if (!/_variant$/.test(action.do)) {
      if (action.do === "task" && this.goal) refuse("expected the task to be shown for new thresholds, got a goal; choose the task under Goals");
      const [before, shown] = [history.state, this.shown(history.state)];
      const { action: settled, notice } = await this.#settled(action, shown);
      const [made, words] = editState({ ...shown, sold: await this.#sold(action, shown) }, settled);
      const state = await this.#proved(await this.#described(this.atRest(made, shown, before), before));
      if (words && revision !== history.revision) throw new Refused(CHANGED, 409);
      if (words) history.take(state, words, isDrag);
      line = isDrag ? "" : notice;
    }
    // An older state may have a lens that is not kept any more.
    await this.#proved(history.state);
    return line;
  }

  #keep(isKept) {
    if (isKept && !this.data.scene.constraints.is_kept) refuse("expected constraints, got a scene without any; open a plan with some");
    this.isKept = isKept;
  }

  #showVariant(name) {
    const [state] = this.#variants.get(name) ?? expected("a saved variant", `'${name}'`, "pick another");
    if (state !== this.history.state) this.history.take(state, `show ${name}`);
  }

  /** Keeps the rig that is shown as a variant, or drops one. */
  #vary({ do: what, name }) {
    const known = this.#variants;
    if (what === "keep_variant") {
      const { covered, covered_area, cost } = this.#frame.summary;
      const cameras = headsOf(this.history.state).filter(({ counts }) => counts).length;
      this.#variants = new Map([...known, [name, [this.history.state, { covered, covered_area, cost, cameras }]]]);
    } else if (what === "drop_variant") {
      if (!known.has(name)) expected("a saved variant", `'${name}'`, "pick another");
      this.#variants = new Map([...known].filter(([each]) => each !== name));
    }
  }

  /** Pieces that too few cameras cover, from the origin of the page, with levels for reasons. */
  async pieces() {
    if (!this.isOwn()) return piecesOf(await this.ask("pieces"));
    const { origin, scene } = this.data;
    const names = Object.keys(scene.reasons);
    const pieces = await this.#pieces();
    const reasons = pieces.reasons.map((name) => names.indexOf(names.includes(name) ? name : name.split("+")[0]));
    return polygonsOf({ ...pieces, reasons, corners: pieces.corners.map((value, k) => value - origin[k % 3]) });
  }

  /** The pieces of the present rig, kept until it changes. */
  #pieces() {
    const { found, goal, history: { state } } = this; // revisions begin anew where a program has other steps
    if (found?.state !== state || found.goal !== goal) this.found = { state, goal, pieces: this.asking.ask("pieces", this.#rig()) };
    return this.found.pieces;
  }

  async zones() {
    return this.isOwn() ? zonesOf(await this.#pieces(), this) : this.ask("zones");
  }

  /** What fails at each spot {point, face, normal} in each row, see `Solver.failures`. */
  failures = (spots) => this.asking.ask("failures", this.#rig(), spots);

  /** Reason of a face in each camera, with its figures. */
  async why(face) {
    if (!this.isOwn()) return this.ask("why", { face });
    const { scene, advice, pointsOfFace } = this.data;
    const corners = cornersOf(this, face);
    const point = centroid(corners);
    const normal = normalOf(corners);
    const group = scene.groups[this.groupOf[face]];
    const size = area(this.areas[face], scene.unit);
    const found = { face, group: group.name, area: this.areas[face], cameras: [], words: "" };
    if (!this.part.isTask[face]) return { ...found, words: `Occluder of ${size}: not evaluated.` };
    const rig = this.#rig();
    const names = Object.keys(scene.reasons);
    const points = spotsOf([{ corners, face }], pointsOfFace, 0, this).flatMap((each) => each.point);
    const { said, failed } = await this.asking.ask("why", rig, face, points, { point, normal });
    found.cameras = said.map((each, row) => {
      const station = rig.stations[row];
      const name = names[each.reason];
      const ray = subtract(centreOf(station.pose), point);
      const signed = dot(ray, normal) / (length(ray) * length(normal) || 1);
      const cosine = this.part.roles[face] & TWO_SIDED ? Math.abs(signed) : signed;
      const own = { share: each.share, incidence: Math.acos(clamp(cosine, -1, 1)), distance: distance(centreOf(station.pose), point) };
      const occluder = isWithin("occluded", name) ? occluderOf(each.hiders, this.groupOf, scene.groups) : null;
      const { focus, task } = rig.cameras[station.camera];
      const depths = corners.map((corner) => dot(subtract(corner, centreOf(station.pose)), column(station.pose, 2)));
      const seen = { ...own, pixel_density: each.density, facing_density: each.facing };
      return {
        station: station.id,
        name: this.history.state.stations.find(({ id }) => id === station.id).name,
        reason: name,
        nearness: each.nearness,
        words: hidden_by(labelOf(scene.reasons, name), occluder?.group === this.groupOf[face] ? "its own group" : (occluder?.name ?? null), occluder?.share),
        help: advice_of(advice[name], seen, depths, { ...rig.task, ...task }, focus, occluder?.name, scene.unit),
        figures: figuresOf(seen, scene.unit),
        occluder,
      };
    });
    return { ...found, words: verdict(rig, failed, found.cameras, rig.need[face], size) };
  }

  /** Texts of a rig and its thresholds. */
  texts(state = this.history.state) {
    const { scene } = this.data;
    return { rig: rigFile(state, scene.unit === "m"), task: taskFile(state, scene) };
  }

  /** Texts of the files that `rastercov check` takes, by name. */
  #files() {
    const { data, history } = this;
    const surfaces = surfaceFiles(data.scene, this);
    return {
      "rig.json": this.texts().rig,
      "plan.toml": planFile(history.state, surfaces, data),
      ...Object.fromEntries(surfaces.map(({ name, text }) => [name, text])),
    };
  }

  async download(what) {
    const { data, history, server } = this;
    if (what === "page") return server ? server.download({ ...this.asked(), what }) : pageOf(data, this, history.state);
    const text = what === "task" && !server ? this.#files()["plan.toml"] : (this.texts()[what] ?? refuse(NO_ANSWER));
    return new Blob([text], { type: "text/plain" });
  }

  /** Saves all files of the rig, as downloads. */
  async save(what) {
    if (what !== "rig") refuse(NO_ANSWER);
    const files = this.#files();
    for (const [name, text] of Object.entries(files)) offerFile(name, text, "text/plain");
    this.history.saved();
    const isAsked = [...this.parts.values()].some(({ limits }) => limits.some(({ limit }) => limit > 0));
    const command = `rastercov check plan.toml --poses rig.json${isAsked ? "" : " --min-coverage 0.9"}`;
    const nOff = this.history.state.stations.filter((each) => !each.is_on).length;
    const off = nOff ? `; this command also counts the cameras that are switched off here (${nOff})` : "";
    return { path: "rig.json", words: `downloaded ${Object.keys(files).join(", ")}; to check: ${command}${off}` };
  }

  ping = async () => ({ revision: this.history.revision, at: [], goal: this.goal, measured: [] });
  drawing = async () => ({});
  keepDrawing = async () => ({});
  job = async () => this.work.described();
  cancelJob = async () => this.work.cancel();
  resume = () => this.work.resume();
  image = async () => refuse(NO_ANSWER);

  async startJob(what) {
    if (!["add", "place", "refine"].includes(what.kind)) refuse(NO_ANSWER);
    this.work.start(what);
  }

  /** Area that the cameras of a state cover, summed over the views that are needed, or -1 beyond the limit of a goal; of one that is shown, see `atRest`. */
  async worth(made, shown, state) {
    const rest = this.atRest(made, shown, state);
    if (!this.isOwn()) return (await this.ask("worth", {}, rest)).m2;
    const most = [...this.parts.values()].filter((part) => part.is_most);
    const [{ covered }, ...seen] = await Promise.all([
      this.asking.ask("frame", this.rigOf(rest), "area", false),
      ...most.map((part) => this.asking.ask("cover", this.rigOf(rest, part), false)),
    ]);
    if (most.some(({ limits: [own] }, at) => requirementOf(own, seen[at].required[0]).status !== "holds")) return -1;
    return covered.by_views.reduce((sum, { m2 }) => sum + m2, 0);
  }

  /** Pieces that the cameras of a state leave open, as of `Figures.pieces`. */
  open(made, shown, state) {
    const rest = this.atRest(made, shown, state);
    return this.isOwn() ? this.asking.ask("pieces", this.rigOf(rest)) : this.ask("open", {}, rest);
  }

  /** Poses that a plan allows a further camera, or null. */
  candidatesOf(camera) {
    const body = this.#phase.bodies[camera];
    const own = this.data.candidates?.[camera];
    return (body && own?.map((pose) => multiply(body, pose))) ?? own ?? null;
  }
}

/** Pieces of the answer to "pieces". */
function piecesOf({ json, payload }) {
  if (json.fault) throw new Error(json.fault);
  const data = payload.slice().buffer;
  const [n] = new Uint32Array(data, 0, 1);
  const [faces, reasons, counts] = [0, 1, 2].map((row) => new Uint32Array(data, 4 + 4 * row * n, n));
  return polygonsOf({ faces, reasons, counts, corners: new Float32Array(data, 4 + 12 * n) });
}

/** {goal, status, words, asked} of a share {name, limit, ...} that is required or, where `is_most`, permitted,
 * by the covered area of its groups, with its bound. */
function requirementOf(
  { name, limit, goal = "", is_most: isMost = false, asked = "" },
  { m2, bound_m2: bound, doubtful_m2: doubtful, of_m2: whole },
) {
  const [low, share, high] = [m2 - bound, m2, m2 + bound + doubtful].map((part) => share_of(part, whole));
  const status = status_of(low, high, limit, isMost);
  const texts = [short_by(share, limit, status, isMost), squareMetres(whole - m2), ends_in_words(low, high)];
  const words = outcome_line(`${name}: ${percent(share)} of the area covered, `, status, [limit, null], ...texts, isMost);
  return { goal, status, words, asked };
}

/** The task or a goal of the plan, of what the file says on it: roles of faces, and rows of its groups. */
function partOf({ roles: ofGroups, unseeable, ...rest }, groupOf) {
  const roles = new Uint8Array(groupOf).map((group) => ofGroups[group]);
  const rows = [...ofGroups.keys()].filter((row) => !(ofGroups[row] & 1));
  return { ...rest, roles, isTask: roles.map((role) => (role & 1 ? 0 : 1)), unseeable: new Map(unseeable), rows };
}

/** Words on a face of a size by what fails in each row with a rule, or else in each camera. */
function verdict(rig, failed, said, need, size) {
  const ofRules = nearest(rig, failed);
  const cameras = rig.rows.map(({ stations: [at] }) => said[at]); // that count
  const first = { reason: "covered", nearness: -1 };
  const { reason, device } = ofRules ?? cameras.reduce((most, each) => (most.nearness >= each.nearness ? most : each), first);
  const why = labelOf(rig.reasons, reason);
  const views = cameras.filter((each) => each.reason === "covered").length;
  return ofRules ? verdict_of_rigs(size, device, reason === "covered" ? "" : why) : verdict_of(size, views, need, cameras.length, why, views >= need);
}

/** Group that hides most of some points of a face, by the faces that hide each or -1; null for none. */
function occluderOf(hiders, groupOf, groups) {
  const hidden = groups.map(() => 0);
  for (const hider of hiders) if (hider >= 0) hidden[groupOf[hider]] += 1;
  const most = Math.max(...hidden);
  const group = hidden.indexOf(most);
  return most > 0 ? { group, name: groups[group].name, share: most / hiders.length } : null;
}

function figuresOf({ share, incidence, distance: away, pixel_density: density, facing_density: facing }, unit) {
  const rows = {
    "covered part of the face": percent(share),
    "angle of incidence": `${number(degrees(incidence))}°`,
    "pixel density": density > 0 ? density_text(density, `px/${unit}`, facing) : "–",
    "facing density": facing > 0 ? density_text(facing, `px/${unit}`) : "–",
    distance: metres(away),
  };
  return Object.entries(rows).map(([label, value]) => ({ label, value }));
}

/** What a camera of the catalogue is. */
const wordsOf = ({ product, width, height, focal_length: f }) =>
  [product, `${width} × ${height} px`, f ? `${number(1e3 * f, 4)} mm` : ""].filter(Boolean).join(", ");
