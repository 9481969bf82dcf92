/**
 * Plans that a page opens: surfaces where it has none yet, cameras, thresholds, required shares and existing cameras.
 * What a page leaves out of a plan is a line.
 */

import { expected } from "rastercov/api.js";
import { UNITS, checkSize, free, readMesh } from "rastercov/mesh_file.js";

const OF_MESHES = ["path", "unit", "role", "groups", "two_sided"];
const OF_THE_PAGE = { by: "area", weight_by: "area", method: "certified", supersample: 1 }; // values of a task
const OF_SELECTION = ["goal", "coverage", "groups", "cameras", "method", "seed"];

const [VIEW, TOGETHER] = ["use rastercov view", "open both together"];

const baseOf = (path) => String(path).split(/[\\/]/).pop();
const tableOf = (value) => (value && typeof value === "object" && !Array.isArray(value) ? value : {});

/** {cameras, task, needed, notes} of a plan; files beside it that it names lose their place among `others`. */
export function readPlan(name, plan, others, { scene }, data) {
  const isOfScene = data.planOfScene === name;
  const cameras = Object.entries({ ...(plan.camera ? { camera: plan.camera } : {}), ...tableOf(plan.cameras) });
  const named = cameras.map(([type, { cost: _, ...entries }]) => [type, entries.file ? ofFile(type, entries, others) : entries]);
  const { task, left, needed } = taskOfPlan(plan, scene.groups, data);
  const file = baseOf(plan.existing?.file ?? plan.existing ?? "");
  if (file && !others.some((each) => each.name === file)) left.push(`existing (open ${file} with it)`);
  const known = ["camera", "cameras", "task", "existing", "outputs", "sheet", ...(isOfScene ? ["meshes", "selection", "goals"] : [])];
  left.push(...Object.keys(plan).filter((key) => !known.includes(key)));
  if (isOfScene) {
    left.push(...Object.keys(tableOf(plan.selection)).filter((key) => !OF_SELECTION.includes(key)).map((key) => `selection.${key}`));
    for (const [goal, entries] of Object.entries(tableOf(plan.goals))) left.push(...ownOf(goal, entries, data).left);
  }
  return { cameras: named, task, needed, notes: left.length ? [`${name}: left out ${left.join(", ")}`] : [] };
}

/** Thresholds of a plan, and views by the names of groups; null where all need as many. */
function taskOfPlan(plan, groups, data) {
  const { views, ...given } = tableOf(plan.task);
  if (typeof views !== "object") return { ...taskOf({ views, ...given }, "task", data), needed: null };
  const counts = Object.entries(views).flatMap(([group, count]) => groupsOf(groups, group, "task.views: ").map((row) => [groups[row].name, count]));
  const wrong = counts.find(([, count]) => !(Number.isInteger(count) && count > 0));
  if (wrong) expected("whole numbers of views", wrong[1], "correct task.views");
  return { ...taskOf(given, "task", data), needed: Object.fromEntries(counts) };
}

/** Thresholds that this page has, of entries at a place; the others are left out. */
function taskOf(entries, where, { levels = {}, scene, defaults }) {
  const [task, left] = [{}, []];
  for (const [key, given] of Object.entries(entries)) {
    const value = typeof given === "string" ? (levels[given] ?? given) : given;
    const field = scene.task_fields.find((each) => each.name === key);
    if (field && isOf(field, value)) task[key] = value;
    else if (value !== undefined && value !== { ...defaults, ...OF_THE_PAGE }[key]) left.push(`${where}.${key}`);
  }
  return { task, left };
}

const ownOf = (name, { groups: _, coverage: __, at_most: ___, ...entries }, data) => taskOf(entries, `goals.${name}`, data);

/** Whether a value is one of a field of thresholds. */
function isOf({ kind, low, is_low_open: isOpen, high, choices }, value) {
  if (choices) return choices.includes(value);
  if (kind === "bool") return typeof value === "boolean";
  if (typeof value !== "number") return false; // tables cannot be compared
  const isHigh = isOpen ? value > low : value >= (low ?? -Infinity);
  return isHigh && value <= (high ?? Infinity) && (kind !== "int" || Number.isInteger(value));
}

/** A camera of a file beside the plan, with its own entries. */
function ofFile(type, { file, name, ...entries }, others) {
  const at = others.findIndex((each) => each.name === baseOf(file));
  if (at < 0) expected(`${baseOf(file)} with the plan, the camera ${type}`, "no such file", TOGETHER);
  const { cameras = [others[at].content] } = others[at].content;
  const own = name ? cameras.filter((each) => each.name === name) : cameras;
  if (own.length !== 1) expected("one camera in " + baseOf(file), own.length, "set its name");
  if (!others[at].content.world_from_camera) others.splice(at, 1);
  const { name: _, ...plain } = own[0];
  return { ...plain, ...entries };
}

/** Rows of groups by the name of one or of a part, with wildcards; levels above may be left out. */
function groupsOf(groups, name, where) {
  if (typeof name !== "string") expected("names of groups", name, "correct it", where);
  const own = name.replace(/[^\w\s*?/]/gu, "\\$&").replaceAll("*", ".*").replaceAll("?", ".");
  if (own.split(".*").length > 6) expected("up to 5 wildcards", name, VIEW, where);
  const rowsOf = (above) => [...groups.keys()].filter((row) => RegExp(`^${above}${own}(/.*)?$`, "s").test(groups[row].name));
  const rows = rowsOf("");
  if (!rows.length) rows.push(...rowsOf("(.*/)?"));
  return rows.length ? rows : expected("a group", name, VIEW, where);
}

/** Goals of a plan with groups and thresholds of their own, as data of a page has them, and rows that the task keeps. */
export function goalsOf(plan, groups, data) {
  const named = Object.entries(tableOf(plan.goals)).map(([name, goal]) => ({ name, goal, rows: goal.groups && [goal.groups].flat().flatMap((each) => groupsOf(groups, each, `goals.${name}: `)) }));
  const rest = [...groups.keys()].filter((row) => groups[row].role !== "occluder" && !named.some(({ rows }) => rows?.includes(row)));
  if (!rest.length) expected("a group without a goal", "none", "use selection.coverage");
  const { task, needed } = taskOfPlan(plan, groups, data);
  const goals = named.map(({ name, goal, rows }) => {
    const isMost = goal.coverage === undefined;
    const limit = goal.coverage ?? goal.at_most;
    if (!(limit >= 0 && limit <= 1)) expected("coverage or at_most of 0 to 1", limit, "correct it", `goals.${name}: `);
    const own = ownOf(name, goal, data).task;
    const byGroup = isMost || own.views ? null : needed;
    const asked = rows ? `For ${[goal.groups].flat().join(", ")}.` : "";
    return { name, limit, is_most: isMost, groups: [goal.groups ?? []].flat(), asked, task: { ...data.defaults, ...(isMost ? {} : task), ...own }, needed: byGroup, roles: rolesOf(groups, rows ?? rest, isMost), unseeable: [] };
  });
  return { goals, rest };
}

/** Roles of groups in a page, RC_OCCLUDER and so on, where some rows are evaluated: from either side if they are not to be seen. */
export function rolesOf(groups, rows, isMost = false) {
  return groups.map(({ role, is_two_sided: isTwoSided }, row) => {
    const isScored = rows.includes(row);
    return (isScored ? 0 : 1) + (role === "target" ? 2 : 0) + (isTwoSided || (isMost && isScored) ? 4 : 0);
  });
}

/** Surfaces of a plan, of files by their names, with its goals: {vertices, faces, groupOf, groups, rest, goals, required, cameras}, in metres. */
export async function sceneOf(plan, files, readers, data) {
  const [parts, groups, taken, levels] = [[], [], new Set(), new Set()];
  for (const [row, entry] of [plan.meshes].flat().entries()) {
    const { stem, ...part } = await partOf(tableOf(entry), `meshes[${row}]: `, files, readers);
    const names = part.groups.map(({ name }) => (levels.has(name.split("/")[0]) && name !== stem ? `${stem}/${name}` : name));
    parts.push({ ...part, from: groups.length });
    groups.push(...part.groups.map((group, at) => ({ ...group, name: free(taken, names[at]) })));
    for (const name of names) levels.add(name.split("/")[0]);
  }
  const { goals, rest } = goalsOf(plan, groups, data);
  let n = 0;
  const faces = parts.map((part) => {
    const from = n;
    n += part.vertices.length / 3;
    return part.faces.map((corner) => corner + from);
  });
  const { coverage, groups: shares, cameras } = tableOf(plan.selection);
  const limits = [[null, coverage], ...Object.entries(tableOf(shares))].filter(([, limit]) => limit > 0);
  const required = limits.map(([place, limit]) => {
    const every = place === null ? [...groups.keys()] : groupsOf(groups, place, "selection.groups: ");
    const name = place === null ? "whole task" : `${every.length > 1 ? "part" : "group"} ${place}`;
    return { name, place, limit, rows: every.filter((row) => rest.includes(row)) };
  });
  return {
    vertices: joined(Float64Array, parts.map(({ vertices }) => vertices)),
    faces: joined(Int32Array, faces),
    groupOf: joined(Uint16Array, parts.map(({ groupOf, from }) => groupOf.map((group) => group + from))),
    groups,
    rest,
    goals,
    required,
    cameras,
  };
}

function joined(Kind, parts) {
  const made = new Kind(parts.reduce((sum, part) => sum + part.length, 0));
  parts.reduce((at, part) => (made.set(part, at), at + part.length), 0);
  return made;
}

/** A mesh of a plan in metres, whose groups have roles. */
async function partOf(entry, where, files, readers) {
  const unknown = Object.keys(entry).find((key) => !OF_MESHES.includes(key));
  if (unknown) expected("a mesh file and its role", unknown, VIEW, where);
  const { path, unit = "m", role = "task", groups: chosen = [], two_sided: twoSided = false } = entry;
  const name = baseOf(path);
  const file = files.find((each) => each.name === name) ?? expected(name + " with the plan", "no such file", TOGETHER, where);
  const metres = typeof unit === "number" ? unit : UNITS[unit];
  if (!(metres > 0 && metres < Infinity)) expected("a unit", unit, "give m, mm or metres", where);
  if (!["task", "occluder", "target"].includes(role)) expected("role task, occluder or target", role, "correct it", where);
  checkSize(file.size);
  const mesh = await readMesh(name, new Uint8Array(await file.arrayBuffer()), readers);
  const [own, both] = [chosen, twoSided === true ? [] : twoSided || []].map((names) => new Set([names].flat().flatMap((each) => groupsOf(mesh.groups, each, where))));
  const other = role === "task" ? "occluder" : "task";
  const groups = mesh.groups.map((group, row) => ({ ...group, role: !chosen.length || own.has(row) ? role : other, is_two_sided: twoSided === true || both.has(row) }));
  return { ...mesh, stem: name.replace(/\.[^.]*$/, ""), groups, vertices: mesh.vertices.map((value) => value * metres) };
}
