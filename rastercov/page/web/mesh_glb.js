/** Scenes of GLB files; see rastercov/formats/meshes/gltf.py. One group a node, in the order of the tree. */

import { expected, refuse } from "rastercov/api.js";
import { cross, dot, multiply, turnOf } from "rastercov/maths.js";
import { isTable, kindOf, shown } from "rastercov/plain.js";
import { COMPONENTS, check_version, component_of, json_count, json_list, json_object, window_of } from "rastercov/texts.js";

/** Methods of a `DataView` for kinds of numbers. */
const GETTERS = { i1: "getInt8", u1: "getUint8", i2: "getInt16", u2: "getUint16", u4: "getUint32", f4: "getFloat32" };
/** Largest whole number of a kind. */
const largestOf = ([sign, size]) => 2 ** (8 * size - Number(sign === "i")) - 1;
const HARMLESS = ["KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_"];
const READ = ["KHR_mesh_quantization"];
const INSTANCING = "EXT_mesh_gpu_instancing";
const LARGEST_COORDINATE = 1e30;
const QUATERNION_TOLERANCE = 1e-3;
const [TRIANGLES, STRIP, FAN] = [4, 5, 6];
const NAMES = {
  node: "camera children matrix mesh rotation scale translation weights skin name extras extensions",
  mesh: "primitives weights name extras extensions",
  primitive: "attributes indices material mode targets extras extensions",
  accessor: "bufferView byteOffset componentType count type normalized sparse max min name extras extensions",
  bufferView: "buffer byteOffset byteLength byteStride target name extras extensions",
  scene: "nodes name extras extensions",
  asset: "version minVersion generator copyright extras extensions",
  file: "accessors animations asset buffers bufferViews cameras extensions extensionsRequired extensionsUsed images materials meshes nodes samplers scene scenes skins textures extras",
};

/** {vertices, faces, groupOf, names, notes} of a file of up to some faces. */
export function readGlb(bytes, most) {
  const made = { points: [], corners: [], groupOf: [], notes: [], most };
  const { header, buffer } = chunksOf(bytes);
  checkNames("file", header);
  checkNames("asset", header.asset ?? {});
  const required = json_list(header, "extensionsRequired").map(String);
  const foreign = required.filter((name) => !READ.includes(name) && !HARMLESS.some((each) => name.startsWith(each)));
  if (foreign.length) expected("supported extensions", foreign[0], "export without them");
  const scene = new Scene(header, buffer, made);
  for (const { node, name, matrix } of scene.nodes()) if ("mesh" in node) scene.add(node, name, matrix);
  if (json_list(header, "animations").length) made.notes.push("ignored animations: the nodes are at rest");
  const { points, corners, groupOf, notes } = made;
  if (!groupOf.length) refuse("expected triangles, got no faces; export the surface, not points");
  const bad = points.findIndex((x) => !(Math.abs(x) <= LARGEST_COORDINATE));
  if (bad >= 0) expected("finite coordinates within ±1e30", points[bad], "repair the mesh", `vertex ${Math.floor(bad / 3)}: `);
  return { vertices: Float64Array.from(points), faces: Int32Array.from(corners), groupOf, names: scene.names, notes };
}

function chunksOf(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < 20 || view.getUint32(0, false) !== 0x676c5446) refuse("expected a GLB file, which begins with glTF, got another file; export a binary .glb");
  const [version, length] = [view.getUint32(4, true), view.getUint32(8, true)];
  if (version !== 2) expected("glTF version 2", version);
  const room = (what, size, at, end) => {
    if (at + size > end) expected(`${size} bytes of ${what} from byte offset ${at} on`, end - at, "truncated; export it again");
  };
  room("the header", length, 0, bytes.length);
  const found = new Map();
  for (let at = 12; at + 8 <= length; ) {
    const [size, kind] = [view.getUint32(at, true), view.getUint32(at + 4, true)];
    at += 8;
    room("a chunk", size, at, length);
    if (!found.has(kind)) found.set(kind, bytes.subarray(at, at + size));
    at += size;
  }
  if (!found.has(0x4e4f534a)) refuse("expected a JSON chunk, got none; export it again");
  let header;
  try {
    header = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(found.get(0x4e4f534a)));
  } catch {
    refuse("expected a readable JSON chunk, got damaged text; export it again");
  }
  if (!isTable(header)) expected("the JSON chunk to be an object", kindOf(header));
  check_version(header);
  return { header, buffer: found.get(0x004e4942) ?? new Uint8Array() };
}

function numbersOf(owner, key, otherwise) {
  const values = key in owner ? owner[key] : otherwise;
  const isRight = Array.isArray(values) && values.length === otherwise.length && values.every((each) => typeof each === "number" && Number.isFinite(each));
  return isRight ? values : expected(`'${key}' to be ${otherwise.length} finite numbers`, "something else");
}

function checkNames(kind, owner) {
  const known = NAMES[kind].split(" ");
  const other = Object.keys(owner).find((name) => !known.includes(name));
  if (other !== undefined) expected(`names of glTF 2.0 in '${kind}'`, other);
}

const EYE = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

class Scene {
  names = [];

  constructor(header, buffer, made) {
    Object.assign(this, { header, buffer, made });
    const [own] = json_list(header, "buffers");
    if (own && "uri" in own) this.buffer = null;
    else if (own) {
      const promised = json_count(own, "byteLength");
      if (buffer.length - promised < 0 || buffer.length - promised > 3) made.notes.push(`buffer 0 declares ${promised} bytes; the file has ${buffer.length}`);
    }
  }

  /** Nodes that the scene shows, depth first, {node, name, matrix}. */
  *nodes() {
    const { header } = this;
    const all = json_list(header, "nodes");
    const below = new Set(all.flatMap((node) => (isTable(node) ? json_list(node, "children") : [])));
    const scenes = json_list(header, "scenes");
    const scene = scenes.length ? json_object(header, "scenes", "scene" in header ? header.scene : 0) : null;
    if (scene) checkNames("scene", scene);
    const roots = scene ? json_list(scene, "nodes") : [...all.keys()].filter((row) => !below.has(row));
    const seen = new Set();
    const stack = [...roots].reverse().map((index) => ({ index, above: "", parent: EYE }));
    while (stack.length) {
      const { index, above, parent } = stack.pop();
      const node = json_object(header, "nodes", index);
      checkNames("node", node);
      if (seen.has(index)) expected("nodes that form a tree", `two parents of node ${index}`);
      seen.add(index);
      const name = nameOf(node) || above;
      const matrix = node.extras?.rastercov_world === true ? EYE : multiply(parent, matrixOf(index, node));
      for (const child of [...json_list(node, "children")].reverse()) stack.push({ index: child, above: name, parent: matrix });
      yield { node, name, matrix };
    }
  }

  /** Adds the triangles of the mesh of a node. */
  add(node, name, matrix) {
    const { header, made } = this;
    const mesh = json_object(header, "meshes", node.mesh);
    checkNames("mesh", mesh);
    const weights = [...json_list(mesh, "weights"), ...json_list(node, "weights")];
    if (weights.some((each) => each !== 0) || node.extensions?.[INSTANCING] || "skin" in node) {
      refuse("expected a scene at rest, got morph weights, instances or a skin; apply them, or use rastercov view");
    }
    const primitives = json_list(mesh, "primitives");
    const wrong = (wanted, got) => expected(wanted, got, undefined, `mesh ${node.mesh}: `);
    if (!primitives.length) wrong("primitives", "none");
    const group = this.names.length;
    this.names.push(name || nameOf(mesh) || `node${group}`);
    for (const primitive of primitives) {
      if (!isTable(primitive)) wrong("primitives", "something else");
      checkNames("primitive", primitive);
      const mode = "mode" in primitive ? primitive.mode : TRIANGLES;
      if (!Number.isInteger(mode) || mode < 0 || mode > FAN) wrong("a mode from 0 to 6", shown(mode));
      if (mode >= TRIANGLES) this.#triangles(primitive, mode, matrix, group, wrong);
      else made.notes.push("ignored points or lines");
    }
  }

  #triangles(primitive, mode, matrix, group, wrong) {
    const { made } = this;
    const attributes = primitive.attributes ?? {};
    if (!("POSITION" in attributes)) wrong("a primitive with POSITION", "one without");
    if (json_list(primitive, "targets").length) refuse("expected a scene at rest, got morph targets; apply them, or use rastercov view");
    const points = this.#read(attributes.POSITION, "VEC3");
    const n = points.length / 3;
    let corners = Array.from({ length: n }, (_, row) => row);
    if ("indices" in primitive) {
      corners = this.#read(primitive.indices, "SCALAR");
      const { componentType } = json_object(this.header, "accessors", primitive.indices);
      const last = Math.min(n, largestOf(COMPONENTS[componentType])) - 1;
      const high = corners.reduce((a, b) => Math.max(a, b), 0);
      if (high > last) wrong(`vertex indices in 0 ... ${last}`, `0 ... ${high}`);
    }
    if (mode === TRIANGLES && corners.length % 3) expected("triangles of 3 corners each", `${corners.length} corners`);
    if (mode !== TRIANGLES && [1, 2].includes(corners.length)) expected("a strip of 3 corners or more", corners.length);
    const first = made.points.length / 3;
    for (let k = 0; k < n; k++) {
      const p = points.slice(3 * k, 3 * k + 3);
      for (let row = 0; row < 3; row++) {
        made.points.push(matrix[4 * row] * p[0] + matrix[4 * row + 1] * p[1] + matrix[4 * row + 2] * p[2] + matrix[4 * row + 3]);
      }
    }
    const [x, y, z] = [0, 4, 8].map((at) => matrix.slice(at, at + 3));
    const isMirrored = dot(x, cross(y, z)) < 0;
    for (const [a, b, c] of trianglesOf(corners, mode)) {
      checkCount(made, made.groupOf.length + 1);
      made.corners.push(...(isMirrored ? [a, c, b] : [a, b, c]).map((corner) => first + corner));
      made.groupOf.push(group);
    }
  }

  /** Numbers of an accessor; normalised ones as fractions. */
  #read(index, wanted) {
    const accessor = json_object(this.header, "accessors", index);
    checkNames("accessor", accessor);
    const where = `accessor ${index}`;
    if ("sparse" in accessor || !("bufferView" in accessor)) expected("plain data", "sparse or none", "export it uncompressed", `${where}: `);
    const kind = component_of(accessor, where, wanted);
    const [size, most] = [Number(kind[1]), largestOf(kind)];
    const count = json_count(accessor, "count");
    const columns = wanted === "SCALAR" ? 1 : 3;
    checkCount(this.made, count / 3);
    const { at, stride, buffer } = this.#window(where, accessor, count, columns * size);
    const view = new DataView(buffer.buffer, buffer.byteOffset, buffer.byteLength);
    return Array.from({ length: count * columns }, (_, k) => {
      const value = view[GETTERS[kind]](at + stride * Math.floor(k / columns) + size * (k % columns), true);
      return accessor.normalized ? Math.max(value / most, -1) : value;
    });
  }

  #window(where, accessor, count, row) {
    const view = json_object(this.header, "bufferViews", accessor.bufferView);
    checkNames("bufferView", view);
    const index = "buffer" in view ? view.buffer : 0;
    json_object(this.header, "buffers", index);
    if (index !== 0 || !this.buffer) refuse("expected buffers in the file, got one outside (uri); export a .glb");
    const [at, stride] = window_of(view, accessor, where, count, row, this.buffer.length);
    return { at, stride, buffer: this.buffer };
  }
}

/** Refuses more faces than the page takes, before they are made. */
function checkCount({ most }, n) {
  if (n > most) expected(`up to ${most.toLocaleString("en")} faces`, n.toLocaleString("en"), "simplify the mesh, or use rastercov view");
}

function nameOf(owner) {
  const name = owner.name || "";
  return typeof name === "string" ? name.slice(0, 1000) : expected("a name to be a string", kindOf(name));
}

function matrixOf(index, node) {
  const hasParts = ["translation", "rotation", "scale"].some((key) => key in node);
  const rotation = numbersOf(node, "rotation", [0, 0, 0, 1]);
  const long = Math.hypot(...rotation);
  if (!(Math.abs(long - 1) <= QUATERNION_TOLERANCE)) expected(`a rotation of node ${index} to be a quaternion of length 1`, rotation.join(" "));
  if ("matrix" in node) {
    const m = numbersOf(node, "matrix", Array(16).fill(0));
    const rows = Array.from({ length: 16 }, (_, k) => m[4 * (k & 3) + (k >> 2)]);
    if ([0, 0, 0, 1].some((value, k) => Math.abs(rows[12 + k] - value) > 1e-6)) expected("a matrix whose last row is 0 0 0 1", "another row", "export it again", `node ${index}: `);
    if (hasParts) expected(`one transform of node ${index}`, "a matrix and another");
    return rows;
  }
  const turn = turnOf(rotation.map((value) => value / long));
  const size = numbersOf(node, "scale", [1, 1, 1]);
  const place = numbersOf(node, "translation", [0, 0, 0]);
  return turn.flatMap((row, k) => [...row.map((value, column) => value * size[column]), place[k]]).concat([0, 0, 0, 1]);
}

/** Triangles of corners; odd ones of a strip are reversed; the first corner of a fan is the last of each. */
function* trianglesOf(corners, mode) {
  if (mode === TRIANGLES) for (let k = 0; k < corners.length; k += 3) yield corners.slice(k, k + 3);
  for (let k = 0; mode === STRIP && k + 2 < corners.length; k++) yield [corners[k], corners[k + 1 + (k % 2)], corners[k + 2 - (k % 2)]];
  for (let k = 0; mode === FAN && k + 2 < corners.length; k++) yield [corners[k + 1], corners[k + 2], corners[0]];
}
