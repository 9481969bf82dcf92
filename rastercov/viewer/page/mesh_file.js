/**
 * Readers of mesh files in the page: STL, OBJ, PLY and GLB, as rastercov/mesh/formats/ has them.
 *
 * What these refuse in Python is refused here, with its line or place. Beyond that the page takes no concave
 * polygons, strips of PLY, and scenes of GLB with morph targets, sparse data or instances: each is a line.
 */

import { Refused } from "rastercov/api.js";
import { readGlb } from "rastercov/mesh_glb.js";
import { readPly } from "rastercov/mesh_ply.js";
import { Faces, Lines, asNumbers, asWhole, refuse } from "rastercov/mesh_text.js";

export const MOST_FACES = 300_000;
export const MOST_BYTES = 200_000_000;
const LARGEST_COORDINATE = 1e30;
const MOST_GROUPS = 65_535;
const FOLD_REL = 1e-9; // of the area of a triangle that may be wound against its polygon
/** Metres in units; those of a file that does not say. */
export const UNITS = { m: 1, mm: 1e-3, cm: 1e-2, um: 1e-6, in: 0.0254, ft: 0.3048 };

const READERS = { stl: readStl, obj: readObj, ply: readPly, glb: readGlb };

/**
 * The surface of a file: {vertices, faces, groupOf, groups: [{name}], notes}, in its own unit; a `Refused` with
 * one line for anything that is none.
 */
export function readMesh(name, bytes) {
  const [, stem, kind = ""] = /^(.*?)(?:\.([^.]*))?$/s.exec(name);
  const read = READERS[kind.toLowerCase()];
  const shown = [...name].slice(0, 60).join("").replace(/\p{Cc}/gu, " ");
  try {
    if (!read) refuse(`expected an .stl, .obj, .ply or .glb file, got ${kind ? `.${kind.slice(0, 20)}` : "no extension"}; convert it, or use rastercov view`);
    checkSize(bytes.length);
    if (!bytes.length) refuse("expected triangles, got an empty file; export it again");
    const faces = read(bytes, new Faces(MOST_FACES));
    return checked(faces, stem || "mesh");
  } catch (error) {
    throw new Refused(`${shown}: ${error instanceof Refused ? error.message : `expected a file that follows its format, got inconsistent data (${error.message}); export it again`}`.slice(0, 300), 400);
  }
}

/** Refuses a file before it is read. */
export function checkSize(size) {
  if (size > MOST_BYTES) refuse(`expected up to ${MOST_BYTES / 1e6} MB, got ${Math.round(size / 1e6)} MB; simplify the mesh, or use rastercov view`);
}

function checked({ points, corners, groupOf, polygonOf, names, notes }, stem) {
  const nFaces = groupOf.length;
  if (!nFaces) refuse("expected triangles, got no faces; export the surface, not points");
  const vertices = Float64Array.from(points);
  const faces = Int32Array.from(corners);
  const n = vertices.length / 3;
  const beyond = corners.findIndex((corner) => !(corner >= 0 && corner < n));
  if (beyond >= 0) refuse(`face ${polygonOf[Math.floor(beyond / 3)]}: expected vertex indices in 0 ... ${n - 1}, got ${corners[beyond]}; export it again`);
  const bad = vertices.findIndex((x) => !(Math.abs(x) <= LARGEST_COORDINATE));
  if (bad >= 0) refuse(`vertex ${Math.floor(bad / 3)}: expected finite coordinates within ±1e30, got ${vertices[bad]}; repair the mesh`);
  checkConvex(vertices, faces, polygonOf);
  const used = [...new Set(groupOf)].sort((a, b) => a - b);
  if (used.length > MOST_GROUPS) refuse(`expected up to ${MOST_GROUPS} groups, got ${used.length}; merge some`);
  const taken = new Set();
  const groups = used.map((row) => ({ name: free(taken, printable(names[row] ?? "") || printable(stem)) }));
  const rowOf = new Map(used.map((row, at) => [row, at]));
  return { vertices, faces, groupOf: Uint16Array.from(groupOf, (row) => rowOf.get(row)), groups, notes };
}

const printable = (text) => text.replace(/[\p{Cc}\p{Cf}\p{Co}\p{Cn}]/gu, " ").trim().slice(0, 200);

/** A name that no group before it has. */
function free(taken, name) {
  let found = name;
  for (let number = 2; taken.has(found); number++) found = `${name} #${number}`;
  taken.add(found);
  return found;
}

/** Refuses polygons whose fans fold over: rastercov cuts these, this page does not. */
function checkConvex(vertices, faces, polygonOf) {
  for (let f = 0; f < polygonOf.length; ) {
    let end = f + 1;
    while (end < polygonOf.length && polygonOf[end] === polygonOf[f]) end += 1;
    if (end - f > 1) {
      const crosses = crossesOf(vertices, faces, f, end);
      const normal = [0, 1, 2].map((axis) => crosses.reduce((sum, each) => sum + each[axis], 0));
      const size = Math.hypot(...normal);
      const isFolded = crosses.some((each) => {
        const area = Math.hypot(...each);
        const height = each[0] * normal[0] + each[1] * normal[1] + each[2] * normal[2];
        return area > 0 && !(height >= -FOLD_REL * area * size);
      });
      const isFlat = size > FOLD_REL * crosses.reduce((sum, each) => sum + Math.hypot(...each), 0);
      if (isFolded || !(isFlat || crosses.every((each) => Math.hypot(...each) === 0))) {
        refuse(`face ${polygonOf[f]}: expected a triangle or a convex polygon, got another polygon; triangulate the mesh, or use rastercov view`);
      }
    }
    f = end;
  }
}

/** Normals of the triangles of a fan, whose largest side is 1. */
function crossesOf(vertices, faces, first, end) {
  const sides = [];
  for (let f = first; f < end; f++) {
    const [a, b, c] = [0, 1, 2].map((k) => vertices.subarray(3 * faces[3 * f + k], 3 * faces[3 * f + k] + 3));
    sides.push([0, 1, 2].map((axis) => b[axis] - a[axis]), [0, 1, 2].map((axis) => c[axis] - a[axis]));
  }
  const most = Math.max(...sides.flat().map(Math.abs)) || 1;
  return Array.from({ length: end - first }, (_, k) => {
    const [u, v] = [sides[2 * k].map((x) => x / most), sides[2 * k + 1].map((x) => x / most)];
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
  });
}

function readStl(bytes, made) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const n = bytes.length;
  const declared = n >= 84 ? view.getUint32(80, true) : -1;
  const head = new TextDecoder("latin1").decode(bytes.subarray(0, 1024)).replace(/^\xef\xbb\xbf/, "").trimStart().toLowerCase();
  if (head.startsWith("solid") && !head.includes("\0") && n !== 84 + 50 * declared) return textStl(bytes, made);
  if (n < 84) refuse(`expected 84 bytes before the triangles of a binary STL, got ${n}; export it again`);
  const extra = n - 84 - 50 * declared;
  if (extra < 0) refuse(`expected ${declared} triangles, as declared (${84 + 50 * declared} bytes), got ${n} bytes, truncated in triangle ${Math.floor((n - 84) / 50)}; export it again`);
  made.checkCount(declared);
  for (let f = 0; f < declared; f++) {
    const at = 84 + 50 * f + 12;
    made.soup(Array.from({ length: 9 }, (_, k) => view.getFloat32(at + 4 * k, true)), f);
  }
  if (extra) made.notes.push(`ignored ${extra} bytes after the last triangle`);
  return made;
}

const FACET = [["outer", 2], ["vertex", 4], ["vertex", 4], ["vertex", 4], ["endloop", 1], ["endfacet", 1]];

function textStl(bytes, made) {
  const lines = new Lines(bytes);
  let isOpen = false;
  const names = [];
  for (let words = lines.next(); words; words = lines.next()) {
    const word = words[0].toLowerCase();
    if (isOpen && word === "facet") {
      const corners = [];
      for (const [wanted, n] of FACET) {
        const row = lines.next() ?? lines.refuseEnd(`'${wanted}'`);
        if (row[0].toLowerCase() !== wanted || row.length !== n) lines.refuse(`'${wanted}' in a facet of 3 vertices`, row);
        if (wanted === "vertex") corners.push(...asNumbers(lines, row.slice(1), "three coordinates"));
      }
      made.soup(corners, made.groupOf.length, names.length - 1);
    } else if (isOpen && ["endsolid", "end"].includes(word)) isOpen = false;
    else if (!isOpen && word === "solid") {
      isOpen = true;
      names.push(words.slice(1).join(" "));
    } else lines.refuse(isOpen ? "'facet' or 'endsolid'" : "'solid'", words);
  }
  if (isOpen) lines.refuseEnd("'endsolid'");
  if (names.length > 1) made.names = names;
  else made.groupOf.fill(0);
  return made;
}

const IGNORED = new Set("vt vn vp s mg bevel c_interp d_interp lod usemtl mtllib usemap maplib shadow_obj trace_obj".split(" "));

function readObj(bytes, made) {
  const lines = new Lines(bytes, { comment: "#", joins: true });
  const numbers = new Map([["", 0]]);
  const { points } = made;
  let current = 0;
  let ignored = 0;
  for (let words = lines.next(); words; words = lines.next()) {
    const [keyword] = words;
    if (keyword === "v") {
      if (![3, 4, 6, 7].includes(words.length - 1)) lines.refuse("three coordinates", words);
      points.push(...asNumbers(lines, words.slice(1), "three coordinates and other numbers").slice(0, 3));
    } else if (keyword === "f" || keyword === "fo") made.polygon(cornersOf(lines, words, points.length / 3), current);
    else if (keyword === "g" || keyword === "o") {
      const name = words.slice(1).join(" ");
      if (!numbers.has(name)) numbers.set(name, numbers.size);
      current = numbers.get(name);
    } else if (keyword === "l" || keyword === "p") ignored += 1;
    else if (!IGNORED.has(keyword)) lines.refuse("a keyword of polygonal OBJ files", words);
  }
  if (ignored) made.notes.push(`ignored polylines and points (${ignored}), which have no surface`);
  if (lines.isCut) made.notes.push("the file ends within a line: its last number may be cut");
  made.names = [...numbers.keys()];
  return made;
}

/** Corners of "f 1/2/3 ...", from 0; negative ones count back from the latest vertex. */
function cornersOf(lines, words, n) {
  const hasSlash = words.some((word) => word.includes("/"));
  const own = words.slice(1).map((word) => {
    if (hasSlash && !/^[+-]?\d+(\/([+-]?\d+)?){0,2}$/.test(word)) lines.refuse("corners of whole numbers, such as 1, 1/2, 1//3 or 1/2/3", words);
    return asWhole(lines, word.split("/")[0], words, "whole numbers as vertex indices");
  });
  if (own.length < 3) lines.refuse("a face of 3 or more vertices", words);
  if (own.some((corner) => corner === 0 || corner < -n)) lines.refuse(`vertex indices from 1, or from -1 to -${n}`, words);
  return own.map((corner) => (corner > 0 ? corner - 1 : corner + n));
}
