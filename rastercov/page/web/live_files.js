/**
 * Files of a page: the rig and its thresholds; and of one without a program the plan and its surfaces, which
 * `rastercov check` takes, with the figures of the page.
 */

import { base64Of, refuse } from "rastercov/api.js";
import { through } from "rastercov/live_link.js";
import { headsOf } from "rastercov/live_rules.js";
import { distance } from "rastercov/maths.js";

const AT_RIG = [0, 1, 2, 3].map((row) => [0, 1, 2, 3].map((column) => Number(row === column)));

const OPENING =
  '\n<body>\n<p class="failed">Loading the scene…</p>\n<noscript><p class="failed">This page needs JavaScript: it draws the scene.</p></noscript>\n</body>\n</html>\n';

/** The rig, as JSON, without cameras that it does not use, which equipment may be on. */
export function rigFile({ stations, cameras, devices = [], gates = [], rigs = [], fixed = [], rig_from_camera: places = {} }, hasUnit) {
  if (!stations.length) refuse("expected a camera to save, got none; add one");
  if (headsOf({ stations, gates }).some(({ isWhole }) => !isWhole)) {
    refuse("expected all cameras of each rig with a rule, in its order, got others; complete the rig, or delete it");
  }
  const used = new Set(devices.length ? Object.keys(cameras) : stations.map((each) => each.camera));
  const ofRigs = Object.keys(cameras).filter((name) => used.has(name)).map((name) => rigs.find((each) => each.cameras.includes(name)) ?? name);
  const names = [...new Set(ofRigs.flatMap((each) => each.cameras ?? each))];
  const [whole, held] = [[...new Set(ofRigs)].filter((each) => each.cameras), fixed.filter((name) => used.has(name))];
  const tasks = Object.fromEntries(names.filter((name) => cameras[name].task).map((name) => [name, cameras[name].task]));
  const [{ cameras: together = [], ...rule } = {}] = whole;
  const content = {
    ...(hasUnit ? {} : { has_unit: false }),
    cameras: names.map((name) => ({ name, ...cameras[name].plain })),
    ...(names.some((name) => name in places) ? { rig_from_camera: names.map((name) => places[name] ?? AT_RIG) } : {}),
    ...(together.length === names.length ? rule : whole.length ? { rigs: whole } : {}),
    ...(Object.keys(tasks).length ? { tasks } : {}),
    ...(held.length && held.length < names.length ? { fixed: held } : {}),
    world_from_camera: stations.map(({ pose }) => [0, 4, 8, 12].map((row) => pose.slice(row, row + 4))),
    camera: stations.map((each) => names.indexOf(each.camera)),
    images: stations.map((each) => each.name),
  };
  return `${JSON.stringify(content)}\n`;
}

/** Surfaces as OBJ, [{name, text, role, groups, twoSided}]: the task with what hides, and targets. */
export function surfaceFiles({ groups }, { vertices, faces, groupOf }) {
  const isTarget = groups.map(({ role }) => role === "target");
  const parts = [
    ["scene.obj", "occluder", (group) => !isTarget[group]],
    ["targets.obj", "target", (group) => isTarget[group]],
  ];
  return parts.flatMap(([name, role, isIn]) => {
    const own = groups.map((each, row) => ({ ...each, row })).filter(({ row }) => isIn(row) && groupOf.includes(row));
    if (!own.length) return [];
    const hiding = role === "target" ? own : own.filter((each) => each.role === "occluder");
    const text = objOf(vertices, faces, groupOf, groups, isIn);
    return { name, text, role: hiding.length ? role : "task", groups: hiding.map(nameOf), twoSided: own.filter((each) => each.is_two_sided).map(nameOf) };
  });
}

const nameOf = ({ name }) => name.replace(/\p{Cc}/gu, " ");

/** Vertices with all their digits, and faces by group, in their order. */
function objOf(vertices, faces, groupOf, groups, isIn) {
  const lines = [];
  for (let v = 0; v < vertices.length; v += 3) lines.push(`v ${vertices[v]} ${vertices[v + 1]} ${vertices[v + 2]}`);
  let last = -1;
  groupOf.forEach((group, face) => {
    if (!isIn(group)) return;
    if (group !== last) lines.push(`g ${nameOf(groups[group])}`);
    last = group;
    lines.push(`f ${faces[3 * face] + 1} ${faces[3 * face + 1] + 1} ${faces[3 * face + 2] + 1}`);
  });
  return `${lines.join("\n")}\n`;
}

/**
 * Plan of the surfaces with the thresholds of a state, as TOML; `defaults` are those of a task. `rastercov place`
 * can run it: it has the cameras of the rig, candidates around the part or on the walls of the room, and their
 * number.
 */
export function planFile(state, surfaces, { defaults, scene, goals = [] }) {
  const meshes = surfaces.map(({ name: path, role, groups, twoSided }) => ["[meshes]", { path, role, groups, two_sided: twoSided }]);
  return tomlOf([...meshes, ...placementOf(state, scene), ...goals.map((goal) => goalOf(goal, state, defaults)), taskOf(state, scene)]);
}

/** Table `[task]` of a plan: thresholds of a state that are not the usual ones, as TOML. */
export const taskFile = (state, scene) => tomlOf([taskOf(state, scene)]);

function taskOf({ task, needed }, { task_fields: fields }) {
  const own = fields.filter(({ name, default: usual }) => task[name] !== null && task[name] !== usual && !(needed && name === "views"));
  return ["task", { ...Object.fromEntries(own.map(({ name }) => [name, task[name]])), ...(needed && { views: needed }) }];
}

/** A goal of a plan: thresholds that are not those of the task or, of an upper limit, the usual ones. */
function goalOf({ name, groups, limit, is_most: isMost, task, needed }, state, defaults) {
  const base = isMost ? defaults : { ...state.task, ...(state.needed && { views: needed }) };
  const own = Object.entries({ ...task, ...(needed && { views: state.needed ? needed : Math.max(...Object.values(needed)) }) }).filter(([key, value]) => key in state.task && value !== base[key]);
  return [`goals.${toml(name)}`, { groups, [isMost ? "at_most" : "coverage"]: limit, ...Object.fromEntries(own) }];
}

/** Shares that are required, as the goal of a plan; null without any. */
function requirementOf(required) {
  const shares = required.filter(({ limit }) => limit > 0);
  const whole = shares.find(({ place }) => place === null);
  const groups = shares.filter((each) => each !== whole).map(({ place, limit }) => [place, limit]);
  return shares.length ? { goal: "fewest_cameras", coverage: whole?.limit ?? 0, ...(groups.length && { groups: Object.fromEntries(groups) }) } : null;
}

/** Cameras, candidates and goal of a plan, for lengths in metres; of cameras without thresholds of their own. */
function placementOf({ stations, cameras, gates = [] }, { unit, bounds, is_room: isRoom, required = [] }) {
  const used = [...new Set(stations.map((each) => each.camera))];
  const goal = requirementOf(required);
  if (unit !== "m" || gates.length || !used.length || used.some((name) => cameras[name].task || cameras[name].lens)) {
    return goal ? [["selection", goal]] : [];
  }
  const size = distance(...bounds);
  return [
    ...used.map((name) => [`cameras.${toml(name)}`, cameras[name].plain]),
    ["[candidates]", isRoom ? { generator: "on_walls", spacing: size / 8, inset: size / 100 } : { generator: "on_sphere", count: 200 }],
    ["selection", goal ?? { goal: "best_coverage", cameras: stations.length }],
  ];
}

/** This page as a file, with a state in place of the one that it was opened with. */
export async function pageOf(data, { vertices, faces, groupOf, lenses }, state) {
  const own = { ...data, samples: [], readers: "", files: [], isPlayground: false };
  const [points, corners, groups] = await Promise.all([vertices, faces, groupOf].map(deflate));
  own.mesh = { ...data.mesh, vertices: points, faces: corners, groups };
  const { stations, cameras, task, needed = null } = state;
  own.state = { ...data.state, stations, cameras, task, needed };
  const names = [...new Set(Object.values(cameras).flatMap(({ lens }) => lens ?? []))];
  const rows = await Promise.all(names.map(async (name) => [name, await deflate(lenses[name])]));
  own.lenses = Object.fromEntries(rows);
  const head = document.head.cloneNode(true);
  head.querySelector("#live").textContent = JSON.stringify(own).replaceAll("<", "\\u003c");
  head.querySelector("title").textContent = "rastercov";
  return new Blob(['<!DOCTYPE html>\n<html lang="en">\n', head.outerHTML, OPENING], { type: "text/html" });
}

/** Bytes of an array as base64 of zlib. */
const deflate = async (array) => base64Of(await through(array, new CompressionStream("deflate")));

/** TOML of tables, [header, entries] each; empty lists are left out. */
function tomlOf(tables) {
  const isFull = ([, value]) => !Array.isArray(value) || value.length > 0;
  return tables.map(([head, own]) => [`[${head}]`, ...Object.entries(own).filter(isFull).map(entryOf), ""].join("\n")).join("");
}

const entryOf = ([key, value]) => `${key} = ${toml(value)}`;

/** A value as TOML, which has it as JSON does, DEL, infinity and tables apart. */
function toml(value) {
  if (Array.isArray(value)) return `[${value.map(toml).join(", ")}]`;
  if (value === null || value === Infinity) return "inf";
  if (typeof value === "object") return `{ ${Object.entries(value).map(([key, own]) => entryOf([toml(key), own])).join(", ")} }`;
  return JSON.stringify(value).replaceAll("\x7f", "\\u007f");
}
