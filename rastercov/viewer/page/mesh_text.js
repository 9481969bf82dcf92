/** Lines, words and numbers of mesh files in text, and faces as readers gather them. */

import { Refused } from "rastercov/api.js";

const NUMBER = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i;
const NOT_FINITE = /^[+-]?(nan|inf|infinity)$/i;

/** Ends the reading of a file with one line. */
export function refuse(words) {
  throw new Refused(words, 400);
}

/** Lines of a file as words, one by one; blank ones are left out. */
export class Lines {
  #at = 0;

  constructor(bytes, { comment = "", joins = false, number = 0 } = {}) {
    let text = new TextDecoder().decode(bytes).replace(/\r\n?/g, "\n");
    this.number = number;
    this.isCut = !text.endsWith("\n");
    if (joins && text.includes("\\")) {
      if (comment) text = text.replace(/#[^\n]*/g, "");
      text = text.replace(/\\[ \t\f]*\n/g, " ");
    }
    this.text = text;
    this.comment = comment;
  }

  /** Words of the next line, or null at the end. */
  next() {
    while (this.#at < this.text.length) {
      const end = this.text.indexOf("\n", this.#at);
      let line = this.text.slice(this.#at, end < 0 ? undefined : end);
      this.#at = end < 0 ? this.text.length : end + 1;
      this.number += 1;
      if (this.comment) line = line.split(this.comment, 1)[0];
      const words = line.split(/[ \t\v\f]+/).filter(Boolean);
      if (words.length) return words;
    }
    return null;
  }

  refuse(wanted, words) {
    refuse(`line ${this.number}: expected ${wanted}, got '${words.join(" ").slice(0, 60).replace(/[^ -~]/g, "?")}'; correct the line`);
  }

  refuseEnd(wanted) {
    refuse(`expected ${wanted} after line ${this.number}, got the end of the file; it is truncated`);
  }
}

/** Numbers of words; those that are not finite are read, and refused as coordinates. */
export const asNumbers = (lines, words, wanted) =>
  words.map((word) => {
    if (NUMBER.test(word)) return Number(word);
    return NOT_FINITE.test(word) ? NaN : lines.refuse(wanted, words);
  });

/** A whole number that a double holds. */
export function asWhole(lines, word, words, wanted) {
  const value = /^[+-]?\d+$/.test(word) ? Number(word) : NaN;
  return Number.isSafeInteger(value) ? value : lines.refuse(wanted, words);
}

/** Triangles of a file: points, corners, and the polygon and group of each. */
export class Faces {
  points = [];
  corners = [];
  groupOf = [];
  polygonOf = [];
  names = [""];
  notes = [];
  #vertexOf = new Map(); // by bits
  #polygons = 0;

  constructor(most) {
    this.most = most;
  }

  /** Refuses more faces than the page takes, before they are made. */
  checkCount(n) {
    if (n > this.most) refuse(`expected up to ${this.most.toLocaleString("en")} faces, got ${n.toLocaleString("en")}; simplify the mesh, or use rastercov view`);
  }

  /** A polygon as a fan about its first corner. */
  polygon(own, group = 0) {
    this.checkCount(this.groupOf.length + own.length - 2);
    for (let k = 2; k < own.length; k++) this.#triangle([own[0], own[k - 1], own[k]], this.#polygons, group);
    this.#polygons += 1;
  }

  /** A triangle of nine coordinates, whose corners are one where all their bits are. */
  soup(coordinates, polygon, group = 0) {
    this.checkCount(this.groupOf.length + 1);
    const corners = [0, 3, 6].map((at) => {
      const own = coordinates.slice(at, at + 3);
      const key = own.map((x) => (Object.is(x, -0) ? "-0" : x)).join();
      if (!this.#vertexOf.has(key)) {
        this.#vertexOf.set(key, this.points.length / 3);
        this.points.push(...own);
      }
      return this.#vertexOf.get(key);
    });
    this.#triangle(corners, polygon, group);
  }

  #triangle(corners, polygon, group) {
    this.corners.push(...corners);
    this.polygonOf.push(polygon);
    this.groupOf.push(group);
  }
}
