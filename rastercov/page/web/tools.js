/**
 * What a click in the picture does: pick a face or a camera, aim the chosen camera, or measure.
 *
 * Also the section that cuts the scene open, and the marks of the picked face and of a dead zone.
 */

import { centroid, distance, dot, length, mix, normalOf, subtract, unit } from "rastercov/maths.js";
import { element, metres } from "rastercov/dom.js";
import { keyOf } from "rastercov/session.js";

const PICKED = [0.95, 0.25, 0.85, 1];
const MEASURE = [0.95, 0.6, 0.05, 1];

export class Tools {
  constructor(view, session, navigation, frusta, overlay) {
    Object.assign(this, { view, session, frusta });
    this.tool = "pick";
    this.clicks = {
      pick: (x, y) => this.#pick(x, y),
      aim: (x, y) => this.#aim(x, y),
      measure: (x, y) => this.#measure(x, y),
    };
    this.points = []; // of the measure
    this.zone = null; // the chosen dead zone: its faces, and the revision that it is of
    this.figure = element("div.measure", { hidden: true, "aria-live": "polite" });
    overlay.append(this.figure);
    navigation.onClick((x, y) => this.clicks[this.tool](x, y));
    session.on("state", (state) => {
      if (keyOf(state) !== this.zone?.key) this.zone = null; // of another rig
    });
    view.onSketch((sketch, look) => this.#draw(sketch, look));
    view.onDrawn((look) => this.#label(look));
  }

  /** Adds a tool by what a click does while it is chosen. */
  add(tool, onClick) {
    this.clicks[tool] = onClick;
  }

  /** Chooses "pick", "aim", "measure", or a tool that was added. */
  set(tool) {
    this.tool = tool;
    if (tool !== "measure") this.points = [];
    this.view.canvas.dataset.tool = tool;
    this.session.emit("tool", tool);
    this.view.request();
  }

  /** What a click in the middle of the picture does; of faces alone where one is picked. */
  clickMiddle() {
    const { clientWidth: width, clientHeight: height } = this.view.canvas;
    if (this.tool === "pick") this.pickFace(this.view.pick(width / 2, height / 2));
    else this.clicks[this.tool](width / 2, height / 2);
  }

  #pick(x, y) {
    const station = this.frusta.at(x, y);
    if (station !== null) {
      this.session.choose(station);
      return true;
    }
    this.pickFace(this.view.pick(x, y));
    return true;
  }

  /** Takes a picked face, {face, point} or null, as the one that is asked about. */
  pickFace(found) {
    this.session.face = found?.face ?? null;
    this.session.facePoint = found?.point ?? null;
    this.zone = null;
    this.session.emit("face", found);
  }

  /** Shows the faces of a dead zone and flies there. */
  showZone(zone) {
    this.zone = { faces: zone.faces, key: keyOf(this.session.state) };
    const { camera } = this.view;
    const reach = 3.2 * Math.sqrt(Math.max(zone.area, 1e-12)) + 0.02 * camera.range;
    const away = (face) => distance(centroid(this.view.corners(face)), zone.centre);
    const nearest = zone.faces.reduce((best, face) => (away(face) < away(best) ? face : best));
    this.view.flyTo(camera.placeBefore(zone.centre, zone.normal, reach), nearest);
  }

  #aim(x, y) {
    const found = this.view.pick(x, y);
    const station = this.session.station();
    if (found && station) this.session.act({ do: "aim", station: station.id, point: found.point });
    else if (!found) this.session.emit("notice", "Click on a face to aim at, or press Esc.");
    if (found) this.set("pick");
    return true;
  }

  #measure(x, y) {
    const found = this.view.pick(x, y);
    if (!found) return true;
    if (this.points.length === 2) this.points = [];
    this.points.push(found.point);
    this.view.request();
    return true;
  }

  #draw(sketch, look) {
    const { face } = this.session;
    for (const each of this.zone?.faces ?? []) this.#mark(sketch, each, 0.45, null);
    if (face !== null) this.#mark(sketch, face, 0.35, look);
    for (const point of this.points) sketch.cross(point, look, MEASURE);
    if (this.points.length === 2) sketch.line(...this.points, MEASURE, 2.5);
  }

  /** Face in the colour of what is picked; with a frame where it is one face. */
  #mark(sketch, face, opacity, look) {
    const corners = this.view.corners(face);
    sketch.triangle(...corners, [...PICKED.slice(0, 3), opacity]);
    if (look) sketch.path(corners, PICKED, 2.5, true);
  }

  #label(look) {
    const [a, b] = this.points;
    const at = b && look.toScreen(mix(a, b, 0.5));
    this.figure.hidden = !at;
    if (!at) return;
    const { up } = this.session.scene;
    const rise = Math.abs(dot(subtract(b, a), up));
    const level = Math.sqrt(Math.max(0, distance(a, b) ** 2 - rise ** 2));
    this.figure.textContent = `${metres(distance(a, b))} (horizontal ${metres(level)}, vertical ${metres(rise)})`;
    const left = Math.min(at[0] + 10, this.view.canvas.clientWidth - this.figure.offsetWidth - 6);
    this.figure.style.transform = `translate(${Math.round(left)}px, ${Math.round(at[1] - 10)}px)`;
  }
}

/** Normal and area of a face by its corners, metres and square metres. */
export function planeOf(corners) {
  const twice = normalOf(corners);
  return { normal: unit(twice), area: length(twice) / 2, centre: centroid(corners) };
}

/** Coordinate of a section along its axis; see `sectionOf`. */
export const heightOf = ({ axis, at }, [low, high]) => low[axis] + at * (high[axis] - low[axis]);

/**
 * Section: what is cut away, as (a, b, c, d) with a x + b y + c z + d > 0.
 *
 * @param {{axis: number, at: number, isFlipped: boolean}} cut axis 0, 1 or 2; `at` is a part of
 *   the scene's extent along it, from 0 to 1
 */
export function sectionOf(cut, bounds) {
  const sign = cut.isFlipped ? -1 : 1;
  const plane = [0, 0, 0, -sign * heightOf(cut, bounds)];
  plane[cut.axis] = sign;
  return plane;
}
