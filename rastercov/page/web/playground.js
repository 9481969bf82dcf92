/**
 * The empty page of the documentation: a mesh file of the reader's, or a built-in scene, becomes the scene of a
 * page that computes. Nothing is uploaded: the file is read here.
 */

import { expected } from "rastercov/api.js";
import { FILES, contentsOf, mayHaveCameras } from "rastercov/camera_files.js";
import { button, choice, count, element, figure, fill } from "rastercov/dom.js";
import { inflate } from "rastercov/live.js";
import { cornersOf, cross, distance, dot, subtract } from "rastercov/maths.js";
import { UNITS, checkSize, readMesh } from "rastercov/mesh_file.js";
import { Refused } from "rastercov/plain.js";
import { goalsOf, rolesOf, sceneOf } from "rastercov/plan_files.js";

const CUT_AT = 0.6; // height of the floor plan, as a part of that of the scene
const LARGEST = { stl: 20 }; // units beyond which they are more likely millimetres; 200 of other files
const ROLES = [["task", "cover"], ["occluder", "only hides others"], ["unseen", "no camera may see"]];
const UNIT_OF = { glb: "m" };

/** The data of a page with the scene that its reader chooses; other pages have theirs. */
export async function withScene(data) {
  return data.mesh ? data : withSurface(data, await chooseData(data));
}

/** Shows the ways to begin; ends with {title, vertices, faces, groupOf, groups}, in metres. */
function chooseData(data) {
  return new Promise((resolve) => {
    const fault = element("p.fault", { role: "alert" });
    const more = element("div");
    const input = element("input", { type: "file", multiple: true, accept: `.stl,.obj,.ply,.off,.glb,${FILES}`, id: "mesh-file", class: "file" });
    const take = async (given) => {
      const all = [...given];
      if (!all.length) return;
      const [file, ...meshes] = all.filter(({ name }) => !mayHaveCameras(name));
      const files = all.filter(({ name }) => mayHaveCameras(name));
      fault.textContent = "";
      fill(more, element("p.soft", { role: "status" }, "Loading the file…"));
      await new Promise((drawn) => setTimeout(drawn, 30));
      try {
        const readers = () => inflate(data.readers);
        const plan = (await contentsOf(files, data)).find(({ content }) => content.meshes);
        if (plan) {
          const scene = await sceneOf(plan.content, all, readers, data);
          return resolve({ ...scene, title: plan.name, planOfScene: plan.name, files });
        }
        if (!file || meshes.length) expected("one mesh, or a plan with its meshes", all.map(({ name }) => name), "open them together");
        checkSize(file.size);
        const mesh = await readMesh(file.name, new Uint8Array(await file.arrayBuffer()), readers);
        const begun = new Promise((begin) => fill(more, unitForm(file.name, mesh, begin)));
        more.querySelector("select").focus();
        const { roles, ...scene } = await begun;
        resolve({ ...scene, ...withRoles(mesh.groups, roles.map(({ value }) => value), data), files });
      } catch (error) {
        fill(more);
        fault.textContent = error instanceof Refused ? error.message : `${all[0].name}: the file could not be read (${error.message})`;
      }
    };
    input.addEventListener("change", () => take(input.files));
    const open = async (sample) => {
      const [vertices, faces, groups] = await Promise.all([sample.vertices, sample.faces, sample.groups].map(inflate));
      resolve({ ...sample, vertices: new Float64Array(vertices), faces: new Int32Array(faces), groupOf: new Uint16Array(groups), groups: sample.names });
    };
    const drop = (event) => {
      event.preventDefault();
      if (event.type === "drop") take(event.dataTransfer.files);
    };
    for (const name of ["dragover", "drop"]) document.addEventListener(name, drop);
    document.title = "Playground – rastercov";
    document.body.replaceChildren(
      element(
        "main.begin",
        element("h1", "rastercov ", element("span.soft", "playground")),
        element("p", "Place cameras around a part or in a room, and see how much of the surface they cover, and why the rest is not covered."),
        element("label.drop", { htmlFor: "mesh-file" }, element("strong", "Open a mesh, or drop it here"), element("span.soft", "STL, OBJ, PLY, OFF or GLB, up to 300,000 faces; with it a rig, cameras, or a plan. Files stay on this device."), input),
        fault,
        more,
        element("p", "Or start from"),
        element("div.buttons", data.samples.map((sample) => button(sample.title, () => open(sample), { title: sample.words }))),
      ),
    );
  });
}

/** Asks for the unit of a file, with the size that each gives; metres are those of GLB. */
function unitForm(name, mesh, resolve) {
  const [low, high] = boundsOf(mesh.vertices);
  const sides = [0, 1, 2].map((axis) => high[axis] - low[axis]);
  const kind = name.split(".").pop().toLowerCase();
  const hint = UNIT_OF[kind] ?? (Math.max(...sides) > (LARGEST[kind] ?? 200) ? "mm" : "m");
  const size = element("output");
  const show = (unit) => {
    size.textContent = `${sides.map((side) => figure(side * UNITS[unit])).join(" × ")} m`;
  };
  const menu = choice("unit of the file", Object.keys(UNITS).map((unit) => [unit, unit]), hint, show);
  show(hint);
  const roles = mesh.groups.map((group) => choice(group.name, ROLES, "task"));
  const start = () => {
    const metres = UNITS[menu.value];
    resolve({ ...mesh, roles, title: name, vertices: mesh.vertices.map((value) => value * metres) });
  };
  return element(
    "div.unit-form",
    element("p", `${[`${name}: ${count(mesh.groupOf.length)} faces`, ...new Set(mesh.notes)].join("; ")}.`),
    element("p", element("label", "The unit of the file is ", menu), ", so the object measures ", size, kind === "glb" ? "." : ". The file does not state its unit: check the size."),
    roles.length > 1 ? element("details", element("summary", "Choose which groups to cover, or to keep private"), element("ul.plain", roles.map((role, row) => element("li", element("label", role, " ", mesh.groups[row].name))))) : null,
    button("Start", start, { kind: "primary" }),
  );
}

/** Groups with roles, and the goal of those that no camera may see. */
function withRoles(groups, roles, data) {
  const own = groups.map((group, row) => ({ ...group, role: roles[row] === "occluder" ? "occluder" : "task" }));
  const unseen = groups.filter((_, row) => roles[row] === "unseen").map(({ name }) => name);
  return { groups: own, ...goalsOf({ goals: unseen.length ? { private: { groups: unseen, at_most: 0 } } : {} }, own, data) };
}

const boundsOf = (vertices) =>
  [Math.min, Math.max].map((most) => [0, 1, 2].map((axis) => vertices.reduce((found, value, k) => (k % 3 === axis ? most(found, value) : found), vertices[axis])));

/** Six times the volume that faces enclose: negative for a room, whose faces look inward. */
function volumeOf(vertices, faces, origin) {
  let sum = 0;
  for (let face = 0; face < faces.length / 3; face++) {
    const [a, b, c] = cornersOf({ vertices, faces }, face).map((corner) => subtract(corner, origin));
    sum += dot(a, cross(b, c));
  }
  return sum;
}

/** The data with a surface, as rastercov/report/live.py has it. */
function withSurface(data, { title, vertices, faces, groupOf, groups, rest, goals, required = [], cameras, files = [], planOfScene }) {
  const bounds = boundsOf(vertices);
  const [low, high] = bounds;
  const counts = new Map();
  const firsts = new Map();
  groupOf.forEach((group, face) => {
    counts.set(group, (counts.get(group) ?? 0) + 1);
    if (!firsts.has(group)) firsts.set(group, face);
  });
  const entries = groups.map(({ name, role = "task", is_two_sided: isTwoSided = false }, row) => {
    return { name, role, is_two_sided: isTwoSided, faces: counts.get(row) ?? 0, first: firsts.get(row) ?? -1 };
  });
  const size = distance(low, high);
  const isSite = size >= data.leastSite;
  const scene = {
    ...data.scene,
    title,
    n_faces: groupOf.length,
    n_vertices: vertices.length / 3,
    bounds,
    frame: bounds,
    up: [0, 0, 1],
    cut: (1 - CUT_AT) * low[2] + CUT_AT * high[2],
    towards: null,
    is_room: volumeOf(vertices, faces, low) < 0,
    groups: entries,
    required,
    placement: { ...data.scene.placement, ...(cameras ? { cameras } : {}) },
    levels: isSite ? data.scene.levels : {},
    modes: data.scene.modes.filter(({ id }) => isSite || id !== "level"),
  };
  const mesh = { vertices, faces, groups: groupOf, roles: rolesOf(entries, rest ?? [...entries.keys()].filter((row) => entries[row].role !== "occluder")), unseeable: [] };
  return { ...data, goals, scene, mesh, origin: low.map((value, axis) => (value + high[axis]) / 2), isPlayground: true, files, planOfScene };
}
