/** Cameras by the entries of a file, as `Camera.from_dict` takes them; parallel rays are left to rastercov. */

import { expected } from "rastercov/api.js";
import { CHECKS, central_arguments, check_fields, check_focus } from "rastercov/texts.js";

const OTHERS = ["hfov_deg", "vfov_deg", "principal_point", "model", "distortion"];
const OF_PRESETS = ["near", "max_blur"]; // that change nothing else

const wrong = (name, value, wanted) => expected(wanted, `${name} = ${JSON.stringify(value)}`, "use rastercov view");

/** All values of a camera: {width, height, fx, fy, cx, cy, ...}; `sold` has the catalogue. */
export function plainOf(given, sold = {}) {
  const { preset, ...own } = given;
  const entries = Object.fromEntries(Object.entries(preset === undefined ? own : ofPreset(preset, own, sold)).filter(([, value]) => value !== null));
  const { model = "pinhole", distortion = [] } = entries;
  const unknown = Object.keys(entries).find((name) => !Object.hasOwn(CHECKS, name) && !OTHERS.includes(name));
  if (unknown) expected("entries of a camera that this page has", unknown, "use rastercov view");
  const plain = check_fields(central_arguments(entries), {});
  if (!(Array.isArray(distortion) && distortion.every(Number.isFinite))) wrong("distortion", distortion, "numbers");
  check_focus(plain);
  const isBent = distortion.some(Boolean);
  if (model !== "pinhole" && (model !== "opencv" || isBent)) return plain;
  const { model: _, distortion: __, ...pinhole } = plain;
  return isBent ? wrong("distortion", distortion, "its model as well") : pinhole;
}

/** A camera of the catalogue, with entries that change nothing else. */
function ofPreset(name, changes, sold) {
  const plain = Object.hasOwn(sold, name) ? sold[name] : wrong("preset", name, "one of the catalogue of this page");
  const other = Object.keys(changes).find((key) => !OF_PRESETS.includes(key));
  return other ? expected(`a preset with ${OF_PRESETS} alone`, other, "use rastercov view") : { ...plain, ...changes };
}
