/**
 * The rig of a page: its edits, and undo.
 *
 * A state is {stations, cameras, task, needed, devices}; edits give another one, or throw a `Refused` with one line.
 * `models` has the coefficients of each model of a lens, and `lens` of a camera names what is to be proved of it.
 */

import { expected, refuse } from "rastercov/api.js";
import { plainOf } from "rastercov/camera_entries.js";
import { column, cross, degrees, distance, dot, driftOf, lookingAt, orthonormal, scale } from "rastercov/maths.js";
import { depths_in_focus, focal_length_across, positive, shown_of, with_pixels } from "rastercov/texts.js";

const LONGEST_NAME = 120;
const MOST_STATIONS = 5000;
const TOO_MANY = "expected up to 5000 cameras; delete some";
const [RIGID, ROUNDING] = [1e-6, 1e-14]; // of axes that are orthonormal: more is refused, and more is taken out, as in Python
const RAYS_OF_BORDER = 32;

export function stationOf(state, id) {
  return state.stations.find((each) => each.id === id) ?? refuse(`there is no camera ${id}; it may have been deleted`);
}

const withStation = (state, station) => ({
  ...state,
  stations: state.stations.map((each) => (each.id === station.id ? station : each)),
});

/** The pose, or a refusal of what is no rigid motion. */
function checkPose(pose) {
  const [right, down, forward] = [0, 1, 2].map((at) => column(pose, at));
  const isRigid = pose.length === 16 && pose.every(Number.isFinite) && driftOf(pose) <= RIGID && dot(cross(right, down), forward) > 0;
  if (!isRigid || String(pose.slice(12)) !== "0,0,0,1") refuse("expected a rigid transform, 4 x 4, got another matrix; correct the pose");
  return driftOf(pose) > ROUNDING ? orthonormal(pose) : pose.slice();
}

function freeName(state, name) {
  const taken = new Set(state.stations.map((each) => each.name));
  let free = name;
  for (let number = 2; taken.has(free); number++) free = `${name} ${number}`;
  return free;
}

/** A state that has a camera of the rig or of the catalogue, `sold`. */
function withCamera(state, name) {
  if (name in state.cameras) return state;
  const plain = state.sold?.[name] ?? refuse(`there is no camera ${name}; choose one from the list`);
  return { ...state, cameras: { ...state.cameras, [name]: cameraOf(plain, state) } };
}

/** A camera by the entries of a file. */
function cameraOf(given, { models, sold }) {
  const plain = plainOf(given, sold);
  const { model = "pinhole" } = plain;
  const canFocus = Boolean(plain.focal_length && plain.pixel_size);
  return described({ model, plain, lens: null, task: null, can_focus: canFocus, border: Array(RAYS_OF_BORDER) }, models);
}

function withNew(before, camera, pose, name = "") {
  const state = withCamera(before, camera);
  if (state.stations.length >= MOST_STATIONS) refuse(TOO_MANY);
  const id = Math.max(-1, ...state.stations.map((each) => each.id)) + 1;
  const station = { id, name: freeName(state, name || `camera ${id + 1}`), camera, pose: checkPose(pose), is_on: true };
  return { ...state, stations: [...state.stations, { ...station, place: "allowed" }] };
}

/** The pose with a point in the middle of the image; its up stays as near as it can. */
function aim(pose, point) {
  const eye = column(pose, 3);
  if (!(distance(point, eye) > 1e-9)) refuse("expected a point away from the camera; choose another one");
  return lookingAt(eye, point, scale(column(pose, 1), -1), column(pose, 2));
}

/** An edit that takes the station of its action, too. */
const ofStation = (edit) => (state, action) => edit(state, stationOf(state, action.station), action);

const EDITS = {
  none: (state) => [state, ""],
  pose: ofStation((state, own, { pose }) => [withStation(state, { ...own, pose: checkPose(pose) }), `move ${own.name}`]),
  device: (state, { device, pose }) => {
    const own = state.devices?.find((each) => each.id === device && each.pose) ?? expected("equipment of the scene", `'${device}'`, "choose another");
    const moved = { ...own, pose: checkPose(pose) };
    return [{ ...state, devices: state.devices.map((each) => (each === own ? moved : each)) }, `move ${own.name}`];
  },
  aim: ofStation((state, own, { point }) => [withStation(state, { ...own, pose: checkPose(aim(own.pose, point)) }), `aim ${own.name}`]),
  add: (state, { camera, pose }) => [withNew(state, camera, pose), "add a camera"],
  duplicate: ofStation((state, own) => [withNew(state, own.camera, own.pose, own.name), `duplicate ${own.name}`]),
  delete: ofStation((state, own) => [{ ...state, stations: state.stations.filter((each) => each !== own) }, `delete ${own.name}`]),
  rename: ofStation((state, own, { name }) => {
    const words = name.trim();
    if (!words || words.length > LONGEST_NAME || /\p{C}/u.test(words)) refuse(`expected a name of 1 to ${LONGEST_NAME} printable characters`);
    if (words !== own.name && state.stations.some((each) => each.name === words)) {
      refuse(`there is a camera “${words}” already; choose another name`);
    }
    return [withStation(state, { ...own, name: words }), `rename ${own.name}`];
  }),
  switch: ofStation((state, own, { is_on: isOn }) => [withStation(state, { ...own, is_on: isOn }), `switch ${own.name} ${isOn ? "on" : "off"}`]),
  use: ofStation((state, own, { camera }) => [withStation(withCamera(state, camera), { ...own, camera }), `use ${camera} at ${own.name}`]),
  camera: (state, { camera, changes }) => {
    if (!(camera in state.cameras)) refuse(`there is no camera ${camera}; choose one from the list`);
    const cameras = { ...state.cameras, [camera]: changeCamera(state.cameras[camera], changes, state.models) };
    return [{ ...state, cameras }, `change the lens of ${camera}`];
  },
  new_camera: (state, { name, source }) => {
    if (name in state.cameras) refuse(`there is a camera ${name} already; choose another name`);
    const { cameras } = withCamera(state, source);
    return [{ ...state, cameras: { ...state.cameras, [name]: cameras[source] } }, `add camera type ${name}`];
  },
  task: (state, { changes }) => {
    const unknown = Object.keys(changes).find((name) => !(name in state.task));
    if (unknown) refuse(`expected ${Object.keys(state.task).join(", ")}, got ${unknown}`);
    const needed = changes.views === undefined || changes.views === state.task.views ? state.needed : null;
    return [{ ...state, task: { ...state.task, ...changes }, needed }, `change ${Object.keys(changes).join(", ")}`];
  },
  open: (state, { cameras, stations, task = {}, needed = state.needed }) => {
    const made = Object.entries(cameras).map(([name, plain]) => [name, cameraOf(plain, state)]);
    const [{ task: own }] = EDITS.task(state, { changes: task });
    return EDITS.restore(state, {
      rig: { cameras: Object.fromEntries(made), stations: stations.length ? stations : state.stations, task: own, needed },
    });
  },
  restore: (state, { rig }) => {
    const unknown = rig.stations.find((each) => !Object.hasOwn({ ...state.cameras, ...rig.cameras }, each.camera));
    if (unknown) refuse(`there is no camera ${unknown.camera}; choose one from the list`);
    if (rig.stations.length > MOST_STATIONS) refuse(TOO_MANY);
    const stations = rig.stations.map((each) => ({ place: "allowed", ...each, pose: checkPose(each.pose) }));
    return [{ ...state, ...rig, cameras: { ...state.cameras, ...rig.cameras }, stations }, "restore the rig"];
  },
};

/** [the state after an edit, words for the history]; no words where nothing is to be undone. */
export function editState(state, action) {
  const edit = EDITS[action.do] ?? refuse(`this page cannot do that (${action.do}); use rastercov view`);
  return edit(state, action);
}

/** A camera with other values. */
function changeCamera(camera, changes, models) {
  let made = { ...camera, plain: { ...camera.plain } };
  for (const [name, value] of Object.entries(changes)) {
    const at = models[camera.model]?.indexOf(name) ?? -1;
    if (at >= 0) made = withCoefficient(made, at, value, models[camera.model].length);
    else made = CHANGES[name]?.(made, value) ?? refuse(`no ${name} to change`);
  }
  return described(made, models);
}

function withCoefficient(camera, at, value, count) {
  const distortion = Array.from({ length: count }, (_, k) => camera.plain.distortion?.[k] ?? 0);
  distortion[at] = value;
  return { ...camera, plain: { ...camera.plain, distortion } };
}

/** What the proofs of a lens depend on, rc_optics; as a text the name of its lens, null for a pinhole. */
export function opticsOf({ model, plain }) {
  const { width, height, fx, fy, cx, cy, skew = 0, max_angle_deg: angle, distortion = [] } = plain;
  return { model, distortion, width, height, fx, fy, cx, cy, skew, max_angle_deg: angle ?? 0 };
}

function lensOf(camera) {
  const { skew, max_angle_deg: angle, distortion = [] } = camera.plain;
  const isPinhole = camera.model === "pinhole" || (camera.model === "opencv" && !distortion.some(Boolean));
  return isPinhole && !skew && !angle ? null : JSON.stringify(opticsOf(camera));
}

function scaleCamera(camera, factor) {
  const { plain } = camera;
  const { fx, fy, focal_length: f } = plain;
  const made = { ...plain, fx: fx * factor, fy: fy * factor };
  if (plain.skew) made.skew = plain.skew * factor;
  if (f) made.focal_length = f * factor;
  delete made.product;
  return { ...camera, plain: made };
}

function withRange(camera, low, high) {
  const [near, far] = camera.plain.focus_range ?? [0, Infinity];
  const plain = { ...camera.plain, focus_range: [low ?? near, high ?? far ?? Infinity] };
  for (const name of ["aperture", "focus_distance", "f_number"]) delete plain[name];
  return { ...camera, plain };
}

function focalLength({ plain }) {
  if (!plain.focal_length || !plain.pixel_size) refuse("focus needs focal_length and pixel_size; change focus_near and focus_far");
  return plain.focal_length;
}

const withFocus = (camera, aperture, distance) => {
  const plain = { ...camera.plain, aperture, focus_distance: distance };
  delete plain.focus_range;
  return { ...camera, plain };
};

const CHANGES = {
  hfov_deg: (camera, value) => {
    if (camera.model !== "pinhole") expected("a pinhole for hfov_deg", `lens model ${camera.model}`, "change fx");
    const { width, cx, fx } = camera.plain;
    return scaleCamera(camera, focal_length_across("hfov_deg", value, width, cx) / fx);
  },
  fx: (camera, value) => scaleCamera(camera, positive("fx", value) / camera.plain.fx),
  px_per_m: (camera, value) => scaleCamera(camera, positive("px_per_m", value) / camera.plain.fx),
  magnification: (camera, value) => {
    if (!camera.magnification) expected("a telecentric lens for magnification", `model ${camera.model}`, "change fx");
    return scaleCamera(camera, positive("magnification", value) / camera.magnification);
  },
  cx: (camera, value) => ({ ...camera, plain: { ...camera.plain, cx: value } }),
  cy: (camera, value) => ({ ...camera, plain: { ...camera.plain, cy: value } }),
  width: (camera, value) => {
    const { plain } = camera;
    if (!(Number.isInteger(value) && value > 0)) refuse(`expected width to be a whole number of pixels, got ${value}`);
    return { ...camera, plain: { ...plain, ...with_pixels(plain, value / plain.width) } };
  },
  focus_distance: (camera, value) => {
    const { plain, origins } = camera;
    positive("focus_distance", value);
    if (!origins) return withFocus(camera, plain.aperture ?? focalLength(camera) / 2.8, value);
    const shift = plain.focus_distance ? value - plain.focus_distance : 0;
    const around = plain.focus_range?.map((depth) => depth === null ? null : Math.max(0, depth + shift));
    return { ...camera, plain: { ...plain, focus_distance: value, ...(around && { focus_range: around }) } };
  },
  f_number: (camera, value) => {
    positive("f_number", value);
    if (camera.origins) {
      const { focus_range: _, ...plain } = camera.plain;
      return { ...camera, plain: { ...plain, f_number: value } };
    }
    const distance = camera.plain.focus_distance || Math.max(1, 2 * focalLength(camera));
    return withFocus(camera, focalLength(camera) / value, distance);
  },
  focus_near: (camera, value) => withRange(camera, value, null),
  focus_far: (camera, value) => withRange(camera, null, value),
  near: (camera, value) => ({ ...camera, plain: { ...camera.plain, near: value } }),
};

/** Depths in focus, [z_n, z_f]: (3.10) and (3.11). */
export function focusOf(plain, maxBlur = null) {
  if (plain.focus_range) return [plain.focus_range[0], plain.focus_range[1] ?? Infinity];
  if (!plain.aperture || !plain.focus_distance) return [0, Infinity];
  const circle = (maxBlur ?? plain.max_blur ?? 1) * Math.min(...plain.pixel_size);
  return depths_in_focus(plain.focus_distance, plain.focal_length, plain.aperture, circle);
}

/** What the page shows of a camera, by its `plain` values; the border of a lens is that of its proofs. */
export function described(camera, models) {
  const { plain } = camera;
  const made = { ...camera, ...shown_of(plain, ...focusOf(plain)) };
  if (camera.origins) return { ...made, lens: null }; // of parallel rays, as rastercov describes it
  made.lens = lensOf(camera);
  const coefficients = (models[camera.model] ?? []).map((name, k) => [name, plain.distortion?.[k] ?? 0]);
  if (made.lens || coefficients.length) Object.assign(made, { cx: plain.cx, cy: plain.cy }, Object.fromEntries(coefficients));
  if (made.lens) return made;
  const { width, height, fx, fy, cx, cy } = plain;
  made.hfov_deg = degrees(Math.atan(cx / fx) + Math.atan((width - cx) / fx));
  const parts = camera.border.length / 4;
  const corners = [[0, 0], [width, 0], [width, height], [0, height], [0, 0]];
  made.border = corners.slice(0, 4).flatMap(([u, v], side) => {
    const [toU, toV] = corners[side + 1];
    return Array.from({ length: parts }, (_, k) => {
      const at = k / parts;
      return [(u + at * (toU - u) - cx) / fx, (v + at * (toV - v) - cy) / fy, 1];
    });
  });
  return made;
}

/** States in the order of the edits; a gesture is one step. */
export class History {
  #own; // {steps, at, saved, gesture}

  constructor(state, { steps = [[state, ""]], at = 0, saved = 0 } = {}) {
    this.#own = { steps: steps.slice(), at, saved, gesture: "" };
    this.revision = 0;
  }

  get state() {
    const { steps, at } = this.#own;
    return steps[at][0];
  }

  /** What another page needs to go on: see the constructor. */
  get all() {
    return this.#own;
  }

  take(state, words, isDrag = false) {
    const own = this.#own;
    if (own.gesture === words && words) own.steps[own.at] = [state, words];
    else {
      own.steps.length = own.at + 1;
      if (own.saved > own.at) own.saved = -1;
      own.steps.push([state, words]);
      own.at += 1;
    }
    own.gesture = isDrag ? words : "";
    this.revision += 1;
  }

  /** A function that puts back what is kept now. */
  kept() {
    const [own, revision] = [{ ...this.#own, steps: this.#own.steps.slice() }, this.revision];
    return () => {
      [this.#own, this.revision] = [own, revision];
    };
  }

  go(by) {
    const own = this.#own;
    own.gesture = "";
    if (!own.steps[own.at + by]) return;
    own.at += by;
    this.revision += 1;
  }

  saved() {
    this.#own.saved = this.#own.at;
  }

  described() {
    const { steps, at, saved } = this.#own;
    const undo = steps[at][1];
    const redo = steps[at + 1]?.[1] ?? "";
    return {
      revision: this.revision,
      can_undo: Boolean(undo),
      can_redo: Boolean(redo),
      undo_label: undo,
      redo_label: redo,
      is_saved: at === saved,
    };
  }
}
