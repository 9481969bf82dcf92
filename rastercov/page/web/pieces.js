/**
 * Exact pieces at rest: where no gesture goes on, the parts of faces that are not covered have the
 * colour of their reason, and the rest of each face that of what is covered. Whole faces meanwhile.
 */

import { count, later } from "rastercov/dom.js";
import { cross, dot, fanOf, length, normalOf, soupCorners, subtract } from "rastercov/maths.js";
import { keyOf } from "rastercov/session.js";

const REST = 500; // ms without an act
/** Faces, and pairs of a face and a camera, up to which pieces come by themselves; beyond, by a button. */
const MOST_FACES = 300_000;
const MOST_PAIRS = 20_000_000;
/** Part of a face from which a piece is all of it. */
const WHOLE = 0.99999;

/** Keeps `session.pieces` for the present rig, and emits "pieces" when they come or go. */
export function followPieces(session, view) {
  let refused = -1;
  const isWanted = () =>
    session.canEdit &&
    view.options.hasPieces &&
    session.mode === "reason" &&
    session.isIdle &&
    !session.localPoses.size &&
    session.pieces?.key !== keyOf(session.state) &&
    refused !== keyOf(session.state);
  const ask = async (isAsked = false) => {
    const { stations } = session.state;
    const key = keyOf(session.state);
    if (!stations.length || !(isAsked || isWanted())) return;
    if (!isAsked && areMany(session)) return;
    try {
      const pieces = await session.server.pieces();
      if (key !== keyOf(session.state)) return;
      session.pieces = { key, ...trianglesOf(session, pieces) };
      session.emit("frame", session.figures);
    } catch (error) {
      refused = key; // by a threshold of whole faces, or the rig has moved on
      if (isAsked) session.emit("fault", error.message);
    }
  };
  session.follow("idle mode view", later(ask, REST));
  session.drawPieces = () => ask(true);
}

const areMany = ({ scene, state }) =>
  scene.n_faces > MOST_FACES || state.stations.length * scene.n_faces > MOST_PAIRS;

/** Why faces have one colour each in the picture by reason, and whether their pieces are offered. */
export function whyNoPieces(session, view) {
  const { scene, state, mode, figures } = session;
  const hasShares = figures.summary.covered_area && figures.legend?.some(({ percent }) => percent > 0);
  const isAtRest = scene.motion && !session.canEdit && ["coverage", "camera", "views"].includes(mode);
  const ofFaces = { words: hasShares ? `Percentages refer to whole faces${isAtRest ? " in the rest pose" : ""}.` : "" };
  if (!state.stations.length) return { words: "" };
  if (mode !== "reason") return ofFaces;
  if (!session.canEdit) return { words: figures.summary.covered_area ? "Colours and percentages refer to whole faces." : "" };
  if (figures.summary.by_face_because) return { words: `Colours and percentages refer to whole faces: ${figures.summary.by_face_because}.` };
  if (!view.options.hasPieces) return { words: "Colours and percentages refer to whole faces." };
  if (!areMany(session)) return ofFaces; // pieces come
  const size = `${count(scene.n_faces)} faces and ${count(state.stations.length)} cameras`;
  return { words: `Colours and percentages refer to whole faces; with ${size}, exact outlines are drawn on request. The covered area is exact.`, isOffered: true };
}

/** Pieces that are shown now, or null: those of this rig, in the colours of reasons. */
export function piecesToShow(session, view) {
  const { pieces, state, mode } = session;
  const isShown = pieces && view.options.hasPieces && mode === "reason" && pieces.key === keyOf(state);
  return isShown ? pieces : null;
}

/** Legend by the area of pieces; `figures` as the server gave them. */
export function legendOfPieces(session, figures, pieces) {
  if (!pieces) return figures.legend ?? [];
  const dead = [...pieces.areas.values()].reduce((sum, area) => sum + area, 0);
  const whole = figures.summary.covered_area.percent;
  const share = (level) => ((pieces.areas.get(level) ?? 0) / dead) * (100 - whole) || 0;
  const legend = figures.legend ?? [];
  const others = legend.filter((each) => each.level !== pieces.covered);
  const labels = Object.values(session.scene.reasons);
  const known = [...pieces.areas.keys()].map((level) => ({
    ...(legend.find((each) => each.level === level) ?? {
      level,
      label: labels[level],
      colour: session.colourOf(level),
    }),
    percent: share(level),
  }));
  const covered = { level: pieces.covered, label: "covered", percent: whole };
  const rows = [{ ...covered, colour: session.colourOf(pieces.covered) }, ...known];
  const some = rows.filter((each) => each.percent > 0).sort((a, b) => b.percent - a.percent);
  return [...some, ...others.filter(({ percent: by }) => by === null)];
}

/** Triangles of the pieces with their levels, those of each face beside them, and area by level. */
function trianglesOf(session, pieces) {
  const names = Object.keys(session.scene.reasons);
  const covered = names.indexOf("covered");
  const base = session.levels.slice();
  base.forEach((each, face) => (base[face] = each < names.length ? covered : each));
  const areas = new Map();
  const made = { positions: [], weights: [], parents: [], levels: [] };
  for (const { face, reason: level, corners } of pieces) {
    const frame = frameOf(session.corners, face);
    const triangles = fanOf(corners);
    const twice = triangles.reduce((sum, each) => sum + length(normalOf(each)), 0);
    areas.set(level, (areas.get(level) ?? 0) + twice / 2);
    if (twice > WHOLE * Math.sqrt(frame.size)) {
      base[face] = level;
      continue;
    }
    for (const point of triangles.flat()) {
      made.positions.push(...point);
      made.weights.push(...weightsOf(frame, point));
      made.parents.push(face);
      made.levels.push(level);
    }
  }
  return { ...made, base, areas, covered };
}

/** Corner, sides and normal of a face, for `weightsOf`. */
function frameOf(soup, face) {
  const [a, b, c] = soupCorners(soup, face);
  const [u, v] = [subtract(b, a), subtract(c, a)];
  const normal = cross(u, v);
  return { a, u, v, normal, size: dot(normal, normal) || 1 };
}

/** Barycentric coordinates of a point of a face. */
function weightsOf({ a, u, v, normal, size }, point) {
  const away = subtract(point, a);
  const second = dot(cross(away, v), normal) / size;
  const third = dot(cross(u, away), normal) / size;
  return [1 - second - third, second, third];
}
