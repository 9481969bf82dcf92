/** COLMAP models: cameras and images, as text or binary; without rigs and frames, as each image has its own pose. */

import { expected, refuse } from "rastercov/api.js";
import { driftOf, orthonormal, rigidInverse } from "rastercov/maths.js";

const [RIGID, OF_FILES] = [1e-6, 1e-3]; // drift of rotations that stay, and of those that are made orthonormal

/** Cameras and poses of files by their names, "cameras.txt": text or bytes; `models` are those of COLMAP by their ids. */
export function readColmap(files, { colmap: models, models: ours }) {
  const [ofCameras, ofImages] = ["cameras", "images"].map((part) => files.find(({ name }) => name.startsWith(part)));
  if (!ofCameras) expected("cameras.txt or cameras.bin with the images", ofImages.name, "open both together");
  const known = new Map();
  each(ofCameras, ({ whole, reals, word }) => {
    const [id, model, width, height] = [whole(), word(models.map(([name]) => name)), whole(8), whole(8)];
    const [, base, ...names] = models.find(([name]) => name === model) ?? expected("a model of COLMAP", model);
    const values = reals(names.length, true);
    if (values.length !== names.length) expected(`${names.length} parameters for ${model}`, values.length);
    known.set(id, lensOf(base, width, height, Object.fromEntries(names.map((name, k) => [name, values[k]])), ours));
  });
  if (!known.size) expected("a COLMAP model", "one without cameras");
  const ids = [...known.keys()].sort((a, b) => a - b);
  const made = { cameras: ids.map((id) => ({ name: `camera ${id}`, ...known.get(id) })), world_from_camera: [], camera: [], images: [], has_unit: false };
  if (ofImages) each(ofImages, (record) => {
    record.whole();
    const [quaternion, place, id] = [record.reals(4), record.reals(3), record.whole()];
    made.images.push(record.name());
    made.camera.push(ids.includes(id) ? ids.indexOf(id) : expected("a camera of " + ofCameras.name, id));
    made.world_from_camera.push(poseOf(quaternion, place));
  });
  return made;
}

/** A camera, by parameters with our names. */
function lensOf(base, width, height, given, models) {
  const { w, h } = given;
  const p = w ? { fx: w / (2 * Math.PI), fy: h / Math.PI, cx: w / 2, cy: h / 2 } : given;
  const { fx = p.f, fy = p.f, cx, cy } = p;
  return { width, height, fx, fy, cx, cy, model: base, distortion: models[base].map((name) => p[name] ?? 0) };
}

/** Pose of camera_from_world, bit for bit as `from_quaternions` of rastercov/core/camera/conventions.py. */
function poseOf(given, place) {
  const largest = Math.max(...given.map(Math.abs));
  const parts = given.map((each) => each / largest);
  const size = Math.sqrt(parts.reduce((sum, each) => sum + each * each, 0));
  const [w, x, y, z] = parts.map((each) => each / size);
  const turn = [
    ...[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
    ...[2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
    ...[2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
  ];
  const factor = Math.abs(size * largest - 1) > RIGID ? Math.sqrt(size * largest) : 1;
  const motion = [0, 1, 2].flatMap((row) => [...turn.slice(3 * row, 3 * row + 3).map((each) => each * factor), place[row]]);
  const pose = rigidInverse([...motion, 0, 0, 0, 1]);
  return driftOf(pose) > RIGID && driftOf(pose) <= OF_FILES ? orthonormal(pose) : pose;
}

/** Hands each record of a file to a function, with what takes its values one after another. */
function each({ name, bytes }, take) {
  try {
    if (name.endsWith(".bin")) eachOfBytes(new DataView(bytes.buffer, bytes.byteOffset, bytes.length), take);
    else eachLine(new TextDecoder().decode(bytes).split("\n").map((line) => line.trim()), take);
  } catch (error) {
    if (error instanceof RangeError) expected("a record", "the end of the file", undefined, name + ": ");
    refuse(`${name}: ${error.message}`);
  }
}

function eachLine(lines, take) {
  for (let at = 0; at < lines.length; at++) {
    if (!lines[at] || lines[at].startsWith("#")) continue;
    const wrong = (wanted, got) => expected(wanted, got, undefined, `line ${at + 1}: `);
    const words = lines[at].split(/\s+/);
    const word = () => words.shift() ?? wrong("a value", "the end of the line");
    const number = (text) => (Number.isFinite(Number(text)) ? Number(text) : wrong("a number", text));
    const reals = (count, isLast = false) => Array.from({ length: isLast ? words.length : count }, () => number(word()));
    const rest = () => {
      at += 1;
      const points = lines[at] ? lines[at].split(/\s+/) : [];
      if (points.length % 3 || points.some((each, k) => k % 3 === 2 && !Number.isInteger(Number(each)))) wrong("points of the image, or an empty line", lines[at]);
      return words.join(" ");
    };
    take({ whole: () => number(word()), reals, word, name: rest });
  }
}

function eachOfBytes(view, take) {
  let at = 0;
  const whole = (size = 4) => {
    at += size;
    return size === 8 ? Number(view.getBigUint64(at - 8, true)) : view.getInt32(at - 4, true);
  };
  const reals = (count) => Array.from({ length: count }, () => view.getFloat64((at += 8) - 8, true));
  const name = () => {
    const start = at;
    while (view.getUint8(at)) at++;
    const text = new TextDecoder().decode(new Uint8Array(view.buffer, view.byteOffset + start, at++ - start));
    const points = whole(8);
    at += 24 * points;
    if (at > view.byteLength) throw new RangeError();
    return text;
  };
  for (let left = whole(8); left > 0; left--) take({ whole, reals, word: (words) => words[whole()] ?? expected("a model of COLMAP", "another number"), name });
}
