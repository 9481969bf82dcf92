/**
 * Mesh files in the page: STL, OBJ, PLY and OFF are read by the engine, as for Python; GLB by mesh_glb.js.
 *
 * The page takes no morph targets, sparse data or instances of GLB: each is a line.
 */

import { expected, refuse } from "rastercov/api.js";
import { Engine } from "rastercov/live_engine.js";
import { readGlb } from "rastercov/mesh_glb.js";

export const MOST_FACES = 300_000;
export const MOST_BYTES = 200_000_000;
const MOST_GROUPS = 65_535;
const LONGEST_NAME = 200;
const MEMORY = 2 ** 32;
/** Metres in units; those of a file that does not say. */
export const UNITS = { m: 1, mm: 1e-3, cm: 1e-2, um: 1e-6, in: 0.0254, ft: 0.3048 };

/**
 * The surface of a file: {vertices, faces, groupOf, groups: [{name}], notes}, in its own unit; a `Refused` with
 * one line for anything that is none. `module` gives the bytes of readers.wasm.
 */
export async function readMesh(name, bytes, module) {
  const [, stem, kind = ""] = /^(.*?)(?:\.([^.]*))?$/s.exec(name);
  const extension = kind.toLowerCase();
  try {
    checkSize(bytes.length);
    if (extension === "glb") return finish(readGlb(bytes, MOST_FACES), stem);
    if (!["stl", "obj", "ply", "off"].includes(extension)) {
      refuse(`expected an .stl, .obj, .ply, .off or .glb file, got ${kind ? `.${kind.slice(0, 20)}` : "no extension"}; convert it, or use rastercov view`);
    }
    return finish(await readPlain(extension, bytes, await Engine.of(await module())), stem);
  } catch (error) {
    const words = error.status ? error.message.replace("split it, or raise memory_budget", "or use rastercov view") : `expected a file that follows its format, got inconsistent data (${error.message}); export it again`;
    refuse(printable(`${printable(name).slice(0, 60)}: ${words}`, 500));
  }
}

/** Refuses a file before it is read. */
export function checkSize(size) {
  if (size > MOST_BYTES) expected(`up to ${MOST_BYTES / 1e6} MB`, `${Math.round(size / 1e6)} MB`, "simplify the mesh, or use rastercov view");
}

function readPlain(extension, bytes, engine) {
  const format = engine.constants[`RC_${extension.toUpperCase()}`];
  const mesh = engine.call("rc_read_mesh", bytes, bytes.length, format, 1, MOST_FACES, MEMORY);
  const [nVertices, nFaces, nGroups, nText] = engine.call("rc_mesh_size", mesh);
  const [vertices, text] = [new Float64Array(3 * nVertices), new Uint8Array(nText)];
  const [faces, polygons, groupOf] = [3, 1, 1].map((n) => new Int32Array(n * nFaces));
  engine.call("rc_mesh_read", mesh, nVertices, nFaces, vertices, faces, polygons, groupOf);
  engine.call("rc_mesh_text", mesh, nText, text);
  const lines = new TextDecoder().decode(text).split("\n").slice(0, -1);
  return { vertices, faces, groupOf, names: lines.slice(0, nGroups), notes: lines.slice(nGroups) };
}

/** Without empty groups, and with names of the others. */
function finish({ vertices, faces, groupOf, names, notes }, stem) {
  const used = [...new Set(groupOf)].sort((a, b) => a - b);
  if (used.length > MOST_GROUPS) expected(`up to ${MOST_GROUPS} groups`, used.length, "merge some");
  const taken = new Set();
  const groups = used.map((row) => ({ name: free(taken, printable(names[row]) || printable(stem) || "mesh") }));
  const rowOf = new Map(used.map((row, at) => [row, at]));
  return { vertices, faces, groupOf: Uint16Array.from(groupOf, (row) => rowOf.get(row)), groups, notes };
}

const printable = (text, most = LONGEST_NAME) => [...text.replace(/(?! )[\p{C}\p{Z}]/gu, "").trim()].slice(0, most).join("");

/** A name that no group before it has. */
export function free(taken, name) {
  let found = name;
  for (let number = 2; taken.has(found); number++) {
    const end = ` #${number}`;
    found = name.slice(0, LONGEST_NAME - end.length) + end;
  }
  taken.add(found);
  return found;
}
