/**
 * Edges of the mesh that a draughtsman would draw: creases, borders, and those between two groups.
 *
 * Corners are equal where their coordinates are, to the bit.
 */

import { dot, normalOf, radians, soupCorners, unit } from "rastercov/maths.js";

/** Angle between two normals from which their edge is a crease. */
const COSINE_OF_CREASE = Math.cos(radians(30));

/**
 * Bits 1, 2, 4 of each face: the edge opposite its corner 0, 1, 2 is drawn.
 *
 * @param {Float32Array} corners 9 a face
 * @param {Uint16Array} faceGroups
 * @returns {Uint8Array}
 */
export function creasesOf(corners, faceGroups) {
  const nFaces = corners.length / 9;
  const ids = firstOfEqual(corners.map((value) => value + 0), 3); // so that -0 is 0
  const next = (at, by) => ids[at - (at % 3) + ((at + by) % 3)];
  const ends = new Int32Array(6 * nFaces);
  for (let at = 0; at < 3 * nFaces; at++) {
    ends[2 * at] = Math.min(next(at, 1), next(at, 2));
    ends[2 * at + 1] = Math.max(next(at, 1), next(at, 2));
  }
  const first = firstOfEqual(ends, 2);
  const met = new Int32Array(3 * nFaces).fill(-1); // the edge that is there, too; -2 for several
  for (let at = 0; at < 3 * nFaces; at++) {
    const of = first[at];
    if (of !== at) met[of] = met[of] === -1 ? at : -2;
  }
  const normals = Array.from({ length: nFaces }, (_, face) => directionOf(corners, face));
  const isCrease = (at) => {
    if (met[at] < 0) return true;
    const [f, g] = [(at - (at % 3)) / 3, (met[at] - (met[at] % 3)) / 3];
    // Neighbours of the same winding pass their edge in opposite directions.
    const sign = next(at, 1) === next(met[at], 1) ? -1 : 1;
    return faceGroups[f] !== faceGroups[g] || sign * dot(normals[f], normals[g]) < COSINE_OF_CREASE;
  };
  const isDrawn = new Uint8Array(3 * nFaces);
  for (let at = 0; at < 3 * nFaces; at++) isDrawn[at] = first[at] === at ? isCrease(at) : isDrawn[first[at]];
  return Uint8Array.from({ length: nFaces }, (_, face) =>
    [0, 1, 2].reduce((flags, side) => flags | (isDrawn[3 * face + side] << side), 0),
  );
}

const directionOf = (corners, face) => unit(normalOf(soupCorners(corners, face)));

/** First row with the same bits, for each row of `width` values of 4 bytes. */
function firstOfEqual(values, width) {
  const words = new Uint32Array(values.buffer);
  const first = new Int32Array(words.length / width);
  const mask = 2 ** Math.ceil(Math.log2(2 * first.length + 1)) - 1;
  const table = new Int32Array(mask + 1).fill(-1);
  for (let row = 0; row < first.length; row++) {
    let place = 0;
    for (let at = width * row; at < width * (row + 1); at++) {
      place = Math.imul(place ^ words[at], 0x9e3779b1);
      place ^= place >>> 15;
    }
    for (place &= mask; ; place = (place + 1) & mask) {
      const known = table[place];
      if (known < 0) table[place] = row;
      first[row] = known < 0 ? row : known;
      if (known < 0 || isSame(words, width, row, known)) break;
    }
  }
  return first;
}

function isSame(words, width, row, other) {
  for (let at = 0; at < width; at++) if (words[width * row + at] !== words[width * other + at]) return false;
  return true;
}
