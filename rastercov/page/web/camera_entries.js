/** Cameras by the entries of a file, as `Camera.from_dict` takes them; parallel rays are left to rastercov. */

import { expected } from "rastercov/api.js";
import { radians } from "rastercov/maths.js";

const POSITIVE = ["width", "height", "fx", "fy", "focal_length", "aperture", "f_number", "focus_distance", "max_blur", "ir_range", "hfov_deg", "vfov_deg"];
const FINITE = ["cx", "cy", "skew", "near", "max_angle_deg"];
const LISTS = { pixel_size: [2, 2], principal_point: [2, 2], focus_range: [2, 2], distortion: [0, 99] }; // least and most numbers
const OF_PRESETS = ["near", "max_blur"]; // that change nothing else
const MOST_DIFFERENCE_REL = 0.05;

const wrong = (name, value, wanted = "another value") => expected("a camera with width, height and fx", `${name} = ${JSON.stringify(value)}`, "give " + wanted);

/** All values of a camera: {width, height, fx, fy, cx, cy, ...}; `models` has names of coefficients, `sold` the catalogue. */
export function plainOf(given, models, sold = {}) {
  const { preset, ...own } = given;
  const entries = Object.fromEntries(Object.entries(preset === undefined ? own : ofPreset(preset, own, sold)).filter(([, value]) => value !== null));
  if (typeof entries.pixel_size === "number") entries.pixel_size = [entries.pixel_size, entries.pixel_size];
  for (const [name, value] of Object.entries(entries)) check(name, value, models);
  focus(withFocalLengths(entries));
  const { fx, fy, width, height } = entries;
  const plain = { ...entries, fx: fx ?? fy, fy: fy ?? fx, cx: entries.cx ?? width / 2, cy: entries.cy ?? height / 2 };
  for (const name of ["width", "height", "fx"]) if (!(plain[name] > 0)) wrong(name, plain[name]);
  if (plain.model === "opencv" && !plain.distortion?.some(Boolean)) plain.model = "pinhole";
  if ((plain.model ?? "pinhole") !== "pinhole") return plain;
  const { model: _, distortion, ...pinhole } = plain;
  return distortion?.some(Boolean) ? wrong("distortion", distortion, "its model as well") : pinhole;
}

function check(name, value, models) {
  const isNumber = (each) => Number.isFinite(each) || (name === "focus_range" && (each === Infinity || each === null));
  if (name === "model" ? value !== "pinhole" && !Object.hasOwn(models, value) : name === "product" && typeof value !== "string") wrong(name, value, "a lens model of rastercov");
  if (name === "model" || name === "product") return;
  const isWhole = !["width", "height"].includes(name) || Number.isInteger(value);
  if (POSITIVE.includes(name) && !(Number.isFinite(value) && value > 0 && isWhole)) wrong(name, value, "a positive number");
  if (FINITE.includes(name) && !(Number.isFinite(value) && (value >= 0 || name !== "near"))) wrong(name, value, "a number");
  const [least, most] = LISTS[name] ?? [];
  if (most && !(Array.isArray(value) && value.length >= least && value.length <= most && value.every(isNumber))) wrong(name, value, "its numbers");
  if (!most && ![...POSITIVE, ...FINITE].includes(name)) expected("entries of a camera that this page has", name, "use rastercov view");
}

/** A camera of the catalogue, with entries that change nothing else. */
function ofPreset(name, changes, sold) {
  const plain = Object.hasOwn(sold, name) ? sold[name] : wrong("preset", name, "one of the catalogue of this page");
  const other = Object.keys(changes).find((key) => !OF_PRESETS.includes(key));
  return other ? expected(`a preset with ${OF_PRESETS} alone`, other, "use rastercov view") : { ...plain, ...changes };
}

/** Sets fx and fy by angles, or by the focal length. */
function withFocalLengths(entries) {
  const { width, height, cx = width / 2, cy = height / 2, fx, fy, focal_length: f, pixel_size: size, principal_point: middle } = entries;
  const { hfov_deg: across, vfov_deg: down } = entries;
  const others = Object.entries({ fx, fy, focal_length: f, principal_point: middle }).find(([, value]) => value !== undefined);
  if (across ?? down) {
    if (others) wrong(...others, "this or an angle");
    if ((entries.model ?? "pinhole") !== "pinhole") wrong("model", entries.model, "fx");
    if (across) entries.fx = focalLength(across, width, cx);
    if (down) entries.fy = focalLength(down, height, cy);
    delete entries.hfov_deg;
    delete entries.vfov_deg;
  } else if ((fx ?? fy) && middle) wrong("principal_point", middle, "cx and cy");
  else if (!(fx ?? fy) && f && size) {
    [entries.fx, entries.fy] = size.map((each) => f / each);
    if (middle) [entries.cx, entries.cy] = middle.map((each, axis) => each / size[axis]);
    delete entries.principal_point;
  }
  return entries;
}

/** Focal length in pixels by which a side spans an angle, degrees: see rastercov/core/camera/camera.py. */
function focalLength(angle, side, centre) {
  if (!(angle < 180 && centre > 0 && centre < side)) wrong("hfov_deg or vfov_deg", angle, "one below 180, and the principal point inside");
  const [sine, cosine] = [Math.sin(radians(angle)), Math.cos(radians(angle))];
  return (side * cosine + Math.sqrt((side * cosine) ** 2 + 4 * sine * sine * centre * (side - centre))) / (2 * sine);
}

/** Sets the aperture of an f-number, and checks what is in focus. */
function focus(entries) {
  const { f_number: n, aperture, fx, fy = fx, pixel_size: size, focus_range: range, focus_distance: at } = entries;
  if (n && aperture) wrong("f_number", n, "f_number or aperture");
  if ((n || aperture) && !entries.focal_length) {
    const [across, down] = size ? [(fx ?? fy) * size[0], fy * size[1]] : wrong("f_number or aperture", n ?? aperture, "pixel_size or focal_length");
    if (!(Math.abs(across - down) <= MOST_DIFFERENCE_REL * Math.max(across, down))) wrong("pixel_size", size, "square pixels");
    entries.focal_length = (across + down) / 2;
  }
  if (n) entries.aperture = entries.focal_length / n;
  delete entries.f_number;
  if (Boolean(entries.aperture) !== Boolean(at) || (entries.aperture && (range || !size || !(at > entries.focal_length)))) wrong("focus_distance", at, "aperture, pixel_size and a distance beyond the focal length, or focus_range");
  if (range && !(range[0] >= 0 && range[0] < (range[1] ?? Infinity))) wrong("focus_range", range, "the nearer depth first");
}
