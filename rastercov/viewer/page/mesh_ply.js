/** PLY files, text and binary; see rastercov/mesh/formats/ply.py. */

import { Lines, asNumbers, asWhole, refuse } from "rastercov/mesh_text.js";

/** Bytes and reader of each type. */
const TYPES = {
  char: [1, "getInt8"],
  uchar: [1, "getUint8"],
  short: [2, "getInt16"],
  ushort: [2, "getUint16"],
  int: [4, "getInt32"],
  uint: [4, "getUint32"],
  float: [4, "getFloat32"],
  double: [8, "getFloat64"],
};
const OTHER_NAMES = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"];
OTHER_NAMES.forEach((name, row) => (TYPES[name] = Object.values(TYPES)[row]));
const isReal = ([, get]) => get.startsWith("getFloat");
const LIST_NAMES = ["vertex_indices", "vertex_index"];

export function readPly(bytes, made) {
  const head = new TextDecoder("latin1").decode(bytes.subarray(0, 1 << 20));
  const skipped = head.startsWith("\xef\xbb\xbf") ? 3 : 0;
  const end = /[\r\n][ \t]*end_header[ \t]*(\r\n|\r|\n)/.exec(head);
  if (!head.startsWith("ply", skipped) || !end) refuse("expected 'ply' ... 'end_header' at the start, got none; choose a PLY file");
  const start = end.index + end[0].length;
  const { order, elements, number } = headerOf(bytes.subarray(skipped, start));
  const left = bytes.length - start;
  for (const { name, count, properties } of elements.values()) {
    const sizes = properties.map(({ counts, type }) => (counts ?? type)[0]);
    const least = Math.max(1, order === "ascii" ? 2 * sizes.length : sizes.reduce((sum, size) => sum + size, 0));
    if (!(count * least <= left + least)) {
      refuse(`expected ${count} elements '${name.slice(0, 40)}', as declared, of at least ${count * least} bytes, got ${left} bytes; the file is truncated or its header is wrong`);
    }
  }
  const [vertex, face] = [elements.get("vertex"), elements.get("face")];
  if (!vertex || !face) refuse(`expected elements vertex and face, got ${[...elements.keys()].join(", ").slice(0, 60)}; export it again`);
  if (elements.has("tristrips")) refuse("expected faces, got strips of triangles; triangulate the mesh, or use rastercov view");
  made.checkCount(face.count);
  const axes = ["x", "y", "z"].map((name) => indexOf(vertex, [name], (each) => !each.counts));
  const list = indexOf(face, LIST_NAMES, (each) => each.counts && !isReal(each.type));
  const take = { vertex: (row) => made.points.push(...axes.map((at) => row[at])), face: (row) => polygon(made, row[list]) };
  const body = bytes.subarray(start);
  if (order === "ascii") text(body, number, elements, take, made.notes);
  else binary(body, order === "binary_little_endian", elements, take, made.notes);
  return made;
}

function polygon(made, corners) {
  if (corners.length < 3) refuse(`face ${made.polygonOf.length}: expected 3 or more vertices, got ${corners.length}; export it again`);
  made.polygon(corners);
}

function indexOf({ name, properties }, names, isRight) {
  const found = properties.findIndex((each) => names.includes(each.name) && isRight(each));
  return found >= 0 ? found : refuse(`element '${name}': expected a property '${names[0]}', got ${properties.map((each) => each.name).join(", ").slice(0, 60)}; export it again`);
}

function headerOf(bytes) {
  const lines = new Lines(bytes);
  const elements = new Map();
  let order = null;
  let current = null;
  lines.next();
  for (let words = lines.next(); words; words = lines.next()) {
    const [first, ...rest] = words;
    if (first === "format" && rest.length === 2 && rest[1] === "1.0" && ["ascii", "binary_little_endian", "binary_big_endian"].includes(rest[0])) order = rest[0];
    else if (first === "element" && rest.length === 2 && /^\d{1,19}$/.test(rest[1])) {
      if (elements.has(rest[0])) lines.refuse("each element once", words);
      current = { name: rest[0], count: Number(rest[1]), properties: [] };
      elements.set(rest[0], current);
    } else if (first === "property" && current && rest.length === 4 && rest[0] === "list" && TYPES[rest[1]] && TYPES[rest[2]] && !isReal(TYPES[rest[1]])) {
      current.properties.push({ name: rest[3], type: TYPES[rest[2]], counts: TYPES[rest[1]] });
    } else if (first === "property" && current && rest.length === 2 && TYPES[rest[0]]) current.properties.push({ name: rest[1], type: TYPES[rest[0]], counts: null });
    else if (!["comment", "obj_info", "end_header"].includes(first)) lines.refuse("a format, element or property", words);
  }
  if (!order) refuse("expected a line 'format' with ascii, binary_little_endian or binary_big_endian, got none; export it again");
  return { order, elements, number: lines.number };
}

function text(body, number, elements, take, notes) {
  const lines = new Lines(body, { number });
  for (const { name, count, properties } of elements.values()) {
    if (!properties.length) continue;
    const wanted = `values for ${properties.map((each) => each.name).join(" ")}`.slice(0, 60);
    for (let k = 0; k < count; k++) {
      const words = lines.next() ?? lines.refuseEnd(`${name} ${k + 1} of ${count}`);
      asNumbers(lines, words, wanted);
      let at = 0;
      const row = properties.map(({ counts }) => {
        const n = counts ? asWhole(lines, words[at++] ?? "", words, wanted) : 1;
        if (!(n >= 0 && n <= words.length - at)) lines.refuse(wanted, words);
        const own = words.slice(at, at + n);
        at += n;
        if (!counts) return asNumbers(lines, own, wanted)[0];
        return name === "face" ? own.map((word) => asWhole(lines, word, words, wanted)) : own;
      });
      if (at < words.length) lines.refuse(wanted, words);
      take[name]?.(row);
    }
  }
  if (lines.next()) notes.push("ignored lines after the last element");
  else if (lines.isCut) notes.push("the file ends within a line: its last number may be cut");
}

function binary(body, isLittle, elements, take, notes) {
  const view = new DataView(body.buffer, body.byteOffset, body.byteLength);
  let at = 0;
  const value = ([size, get], property, element) => {
    if (at + size > body.length) refuse(`expected values of '${property}' of element '${element}' up to byte ${at + size}, got ${body.length} bytes; truncated; export it again`);
    const found = view[get](at, isLittle);
    at += size;
    return found;
  };
  for (const { name, count, properties } of elements.values()) {
    if (!properties.length) continue;
    for (let k = 0; k < count; k++) {
      const row = properties.map(({ name: property, type, counts }) => {
        if (!counts) return value(type, property, name);
        const n = value(counts, property, name);
        if (n < 0 || at + n * type[0] > body.length) refuse(`expected ${n} values of '${property}' of element '${name}', got ${body.length - at} bytes; truncated; export it again`);
        return Array.from({ length: n }, () => value(type, property, name));
      });
      take[name]?.(row);
    }
  }
  if (at < body.length) notes.push(`ignored ${body.length - at} bytes after the last element`);
}
