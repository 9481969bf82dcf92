/**
 * Files of cameras that a page opens: rigs and plans of rastercov (JSON, TOML), calibrations of OpenCV and ROS
 * (YAML), and models of COLMAP.
 */

import { expected, refuse } from "rastercov/api.js";
import { readColmap } from "rastercov/colmap.js";
import { readPlan } from "rastercov/plan_files.js";
import { readToml } from "rastercov/toml.js";

export const FILES = ".json,.toml,.yaml,.yml,.txt,.bin";
const OF_COLMAP = /^(cameras|images|points3D|rigs|frames)\.(txt|bin)$/;
const OF_RIGS = ["cameras", "rig_from_camera", "world_from_camera", "camera", "has_unit", "frame", "images", "fixed"];

/** Whether a file may hold cameras, by its name. */
export const mayHaveCameras = (name) => FILES.split(",").some((end) => name.toLowerCase().endsWith(end));

/** Opens files together: their cameras join those of the rig, and their poses replace those that are there. */
export async function openCameras(session, files) {
  try {
    const { data } = session.server;
    const contents = await contentsOf(files, data);
    const plans = contents.filter(({ content }) => content.meshes);
    const others = contents.filter(({ content }) => !content.meshes);
    const notes = [];
    if (plans.length > 1) expected("one plan", plans.length, "open one after the other");
    const plan = plans.map(({ name, content }) => naming(name, () => readPlan(name, content, others, session, data)))[0] ?? { cameras: [], notes };
    const [cameras, stations] = [plan.cameras, []];
    const types = cameras.length ? cameras.map(([own]) => own) : [session.typeOfNext ?? Object.keys(session.state.cameras)[0]];
    for (const { name, content } of others) {
      const found = naming(name, () => rigOf(name, content, data, types));
      cameras.push(...found.cameras);
      for (const each of found.stations) stations.push({ ...each, id: stations.length });
      notes.push(...found.notes);
    }
    const type = session.typeOfNext;
    [[session.typeOfNext] = [type]] = cameras;
    const done = await session.act({ do: "open", cameras: Object.fromEntries(cameras), stations, task: plan.task, needed: plan.needed });
    if (!done) session.typeOfNext = type;
    else for (const words of [...plan.notes, ...notes]) session.emit("notice", words);
  } catch (error) {
    session.emit("fault", error.message);
  }
}

/** Does what is on a file, which errors name. */
function naming(name, act) {
  try {
    return act();
  } catch (error) {
    return refuse(`${name}: ${error instanceof SyntaxError ? "expected JSON, got other text; correct the file" : error.message}`);
  }
}

/** {name, content} of files; those of a COLMAP model are one. */
export async function contentsOf(files, data) {
  const read = await Promise.all([...files].map(async (file) => ({ name: file.name, bytes: new Uint8Array(await file.arrayBuffer()) })));
  const ofModel = read.filter(({ name }) => OF_COLMAP.test(name));
  const contents = read.filter((each) => !ofModel.includes(each)).map(({ name, bytes }) => ({ name, content: naming(name, () => contentOf(name, new TextDecoder().decode(bytes))) }));
  return ofModel.length ? [...contents, { name: "COLMAP", content: readColmap(ofModel, data) }] : contents;
}

function contentOf(name, text) {
  const kind = name.toLowerCase().split(".").pop();
  if (kind === "toml") return readToml(text);
  const content = kind === "json" || text.trim().startsWith("{") ? ofJson(text) : ofYaml(text.toLowerCase());
  return Array.isArray(content) ? { world_from_camera: content } : Object(content);
}

/** JSON, in which Python writes infinity. */
const ofJson = (text) => JSON.parse(text.replace(/("(?:\\.|[^"\\])*")|\bInfinity\b/g, (_, own) => own ?? "1e999"));

/** {cameras, stations, notes} of a rig; poses without cameras are of one of `types`. */
function rigOf(name, content, { unused }, types) {
  const isRig = "cameras" in content || "world_from_camera" in content;
  const other = isRig && Object.keys(content).find((each) => ![...OF_RIGS, ...unused].includes(each));
  if (other) expected("cameras and poses", other, "use rastercov view");
  const { cameras = isRig ? [] : [{ name, ...content }], world_from_camera: given = [] } = content;
  const poses = given[0]?.length === 4 && Number.isFinite(given[0][0]) ? [given] : given; // one alone, 4 x 4
  const lists = [cameras, poses, content.camera ?? [], content.images ?? []];
  for (const each of lists) if (!Array.isArray(each) || each.includes(null)) expected("lists of cameras and poses", each, "correct the file");
  const named = cameras.map(({ name: own, ...plain }, row) => [String(own ?? `camera ${row + 1}`), plain]);
  const names = named.map(([own]) => own);
  if (new Set(names).size < names.length) expected("different names of cameras", "one twice", "rename one");
  const known = names.length ? names : types;
  const of = content.camera ?? (known.length > 1 ? [] : poses.map(() => known[0]));
  const images = content.images ?? poses.map((_, row) => `camera ${row + 1}`);
  for (const [words, { length }] of [["camera", of], ["image", images]]) if (length !== poses.length) expected(`the ${words} of each of ${poses.length} poses`, length, `correct "${words}"`);
  const stations = poses.map((pose, row) => ({
    name: String(images[row]),
    camera: String(typeof of[row] === "number" ? (names[of[row]] ?? of[row]) : of[row]),
    pose: matrixOf(pose),
    is_on: true,
  }));
  const left = ["rig_from_camera", "fixed"].filter((each) => each in content);
  const notes = left.length ? [`${name}: left out ${left.join(", ")}`] : [];
  if (poses.length && content.has_unit === false) notes.push(`${name}: has no unit of length; taken as metres`);
  return { cameras: named, stations, notes };
}

function matrixOf(rows) {
  const numbers = [rows].flat(2);
  return numbers.length === 16 && numbers.every(Number.isFinite) ? numbers : expected("poses of 4 x 4 numbers", rows, "correct the file");
}

/** Camera of a calibration, whose pixels are counted from their centres. */
function ofYaml(text) {
  const after = (name) => text.split(`${name}:`)[1] ?? "";
  const list = (name) => after(name).split("]")[0].split("[")[1]?.split(",").map(Number) ?? [];
  const [fx, skew, cx, , fy, cy] = list("camera_matrix");
  const distortion = list("distortion_coefficients");
  const [law] = after("distortion_model").trim().split(/\s/);
  if (distortion.length === 4 && !law) expected("distortion_model", "none", "add plumb_bob or equidistant");
  const part = after("roi").split(/\n\S/)[0].split("width:")[1];
  if ([after("binning_x"), after("binning_y")].some((each) => parseInt(each, 10) > 1) || parseInt(part, 10) > 0) expected("a calibration of all pixels", "binning or roi", "use rastercov view");
  const model = /equidistant|fisheye/.test(law) ? "opencv_fisheye" : "opencv";
  const [width, height] = ["image_width", "image_height"].map((name) => parseInt(after(name), 10));
  if (![width, height, fx, fy, cx, cy].every(Number.isFinite) || text.split("camera_matrix").length > 2) expected("one camera as of OpenCV or ROS: image_width, image_height, camera_matrix", "another calibration", "save each alone");
  return { model, width, height, fx, fy, cx: cx + 0.5, cy: cy + 0.5, skew, distortion };
}
