/** COLMAP models: cameras and images, as text or binary; without rigs and frames, as each image has its own pose. */

import { expected, refuse } from "rastercov/api.js";
import { driftOf, orthonormal, rigidInverse, turnOf } from "rastercov/maths.js";
import { shown } from "rastercov/plain.js";
import { OURS, parameters_of, read_cameras, read_images } from "rastercov/texts.js";

const [RIGID, OF_FILES] = [1e-6, 1e-3]; // drift of rotations that stay, and of those that are made orthonormal

/** Cameras and poses of files by their names, "cameras.txt": text or bytes; `models` has names of coefficients. */
export function readColmap(files, { models }) {
  const [ofCameras, ofImages] = ["cameras", "images"].map((part) => files.find(({ name }) => name.startsWith(part)));
  if (!ofCameras) expected("cameras.txt or cameras.bin with the images", ofImages.name, "open both together");
  const known = contentOf(ofCameras, "a camera", (records) => read_cameras(records, lensOf));
  const ids = Object.keys(known).sort((a, b) => a - b);
  if (!ids.length) expected("a COLMAP model", "one without cameras");
  const images = ofImages ? contentOf(ofImages, "an image", read_images) : [];
  const rowOf = ({ camera_id: id, name }) => (id in known ? ids.indexOf(String(id)) : expected(`a camera of ${ofCameras.name} for image ${shown(name)}`, id, "export the model again"));
  return {
    cameras: ids.map((id) => ({ name: `camera ${id}`, ...known[id] })),
    world_from_camera: images.map(poseOf),
    camera: images.map(rowOf),
    images: images.map(({ name }) => name),
    has_unit: false,
  };

  function lensOf(name, width, height, values) {
    const [p, model] = [parameters_of(name, values), OURS[name]];
    const { fx = p.f, fy = p.f, cx, cy } = p;
    return { width, height, fx, fy, cx, cy, model, distortion: models[model].map((each) => p[each] ?? 0) };
  }
}

/** Pose of camera_from_world, bit for bit as `from_quaternions` of rastercov/core/camera/conventions.py. */
function poseOf({ quaternion, translation }) {
  const largest = Math.max(...quaternion.map(Math.abs));
  const parts = quaternion.map((each) => each / largest);
  const size = Math.sqrt(parts.reduce((sum, each) => sum + each * each, 0));
  const [w, ...axis] = parts.map((each) => each / size);
  const factor = Math.abs(size * largest - 1) > RIGID ? Math.sqrt(size * largest) : 1;
  const motion = turnOf([...axis, w]).flatMap((row, k) => [...row.map((each) => each * factor), translation[k]]);
  const pose = rigidInverse([...motion, 0, 0, 0, 1]);
  return driftOf(pose) > RIGID && driftOf(pose) <= OF_FILES ? orthonormal(pose) : pose;
}

/** What is read of the records of a file, each of which gives its values one after another. */
function contentOf({ name, bytes }, what, read) {
  try {
    return read(name.endsWith(".bin") ? recordsOfBytes(new DataView(bytes.buffer, bytes.byteOffset, bytes.length)) : recordsOfText(new TextDecoder().decode(bytes)));
  } catch (error) {
    if (error instanceof RangeError) expected(what, "the end of the file", "it is truncated, export it again", `${name}: `);
    return refuse(`${name}: ${error.message}`);
  }
}

function* recordsOfText(text) {
  const lines = text.split("\n").map((line, row) => [row + 1, line.trim()]).filter(([, line]) => !line.startsWith("#"));
  const wordsOf = (line = "") => line.match(/\S+/g) ?? [];
  const isWhole = (each) => /^-?\d{1,20}$/.test(each);
  const isReal = (each) => Number(each) === Number.parseFloat(each);
  for (let at = 0; at < lines.length; at++) {
    const [row, line] = lines[at];
    const words = wordsOf(line);
    if (!words.length) continue;
    const word = (what) => words.shift() ?? expected(what, "the end of the line", "the file is truncated", `line ${row}: `);
    const number = (what, is, kind) => {
      const own = word(what);
      return is(own) ? Number(own) : expected(`${what} to be ${kind}`, shown(own), undefined, `line ${row}: `);
    };
    yield {
      word,
      whole: (what) => number(what, isWhole, "a whole number"),
      reals: (what, count, isLast) => Array.from({ length: isLast ? words.length : count }, () => number(what, isReal, "a number")),
      name: () => words.join(" "),
      pass_points(name) {
        at += 1;
        const [after, points] = lines[at] ?? [row + 1];
        const split = wordsOf(points);
        if (split.length % 3 || !split.every((each, k) => k % 3 < 2 || isWhole(each))) expected(`the points of image ${shown(name)}`, shown(points), "leave an empty line where an image has none", `line ${after}: `);
      },
    };
  }
}

function* recordsOfBytes(view) {
  let at = 0;
  const whole = (_, form) => {
    at += form === "Q" ? 8 : 4;
    return form === "Q" ? Number(view.getBigUint64(at - 8, true)) : view.getUint32(at - 4, true);
  };
  const values = {
    whole,
    reals: (_, count) => Array.from({ length: count }, () => view.getFloat64((at += 8) - 8, true)),
    word(what, words) {
      const number = whole(what);
      return words[number] ?? `number ${number}`;
    },
    name() {
      const start = at;
      while (view.getUint8(at)) at++;
      return new TextDecoder().decode(new Uint8Array(view.buffer, view.byteOffset + start, at++ - start));
    },
    pass_points() {
      const n = whole("", "Q");
      at += 24 * n;
      if (at > view.byteLength) throw new RangeError();
    },
  };
  for (let left = whole("", "Q"); left > 0; left--) yield values;
}
