/**
 * The devices in the scene: cameras as frusta by the border rays of their images, others as their points
 * and cones, names, planes of focus.
 *
 * Every frustum is drawn to the same depth, a part of the scene; the chosen one has its names and planes.
 */

import {
  add,
  centreOf,
  column,
  distance,
  ellipse,
  fromCamera,
  inCamera,
  length,
  mix,
  radians,
  scale,
  sphereAround,
  subtract,
} from "rastercov/maths.js";
import { element } from "rastercov/dom.js";

const COLOURS = {
  on: [0.25, 0.33, 0.45, 1],
  off: [0.55, 0.58, 0.62, 0.5],
  chosen: [0.0, 0.44, 0.95, 1],
  wrong: [0.85, 0.1, 0.2, 1],
  focus: [0.0, 0.6, 0.55, 1],
  device: [0.85, 0.55, 0.0, 1],
};
const HALO = [1, 1, 1, 0.45];
const DARK_HALO = [0, 0, 0, 0.6];
const DARK_ON = [0.72, 0.78, 0.86, 1];
/** Cameras from which on only the chosen one and that under the pointer have their names. */
const CROWD = 25;
const GRIP = 12; // pixels around a camera's centre that choose it

export class Frusta {
  constructor(view, session, overlay) {
    this.view = view;
    this.session = session;
    this.overlay = overlay;
    this.isShown = true;
    this.hasFocus = false;
    this.hovered = null;
    this.names = new Map();
    this.depth = 0.13 * sphereAround(session.scene.frame).radius;
    view.onSketch((sketch, look) => this.#draw(sketch, look));
    view.onDrawn((look) => this.#place(look));
    session.on("state chosen", () => this.#label());
    this.#label();
  }

  setShown(isShown) {
    this.isShown = isShown;
    this.view.request();
  }

  setFocus(hasFocus) {
    this.hasFocus = hasFocus;
    this.view.request();
  }

  /** Name of the camera under the pointer, which a crowd does not show. */
  hover(x, y) {
    const found = this.at(x, y);
    if (found === this.hovered) return;
    this.hovered = found;
    this.#label();
    this.view.request();
  }

  /** Station whose centre is near a place of the canvas, or null. */
  at(x, y) {
    if (!this.isShown) return null;
    const look = this.view.look();
    let best = null;
    for (const station of this.#devices()) {
      const at = look.toScreen(centreOf(this.session.poseOf(station)));
      const away = at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
      if (away < GRIP && (!best || away < best.away)) best = { id: station.id, away };
    }
    return best?.id ?? null;
  }

  #draw(sketch, look) {
    if (!this.isShown) return;
    const isDark = Math.max(...this.view.background()) < 0.5;
    const isFree = look.isParallel && !this.view.camera.pinned;
    const isEye = (pose) => !isFree && distance(centreOf(pose), centreOf(look.pose)) < 0.02 * this.depth;
    for (const station of this.session.state.stations) {
      const isChosen = station.id === this.session.chosen;
      const isWrong = station.place && station.place !== "allowed";
      let colour = isDark ? DARK_ON : COLOURS.on;
      if (isChosen) colour = COLOURS.chosen;
      if (isWrong) colour = COLOURS.wrong;
      if (!station.is_on) colour = COLOURS.off;
      if (isEye(this.session.poseOf(station))) this.#border(sketch, station, colour);
      else this.#frustum(sketch, station, colour, isChosen);
    }
    for (const { device, pose } of this.session.shownDevices())
      if (device.pose || !isEye(pose)) this.#device(sketch, device, pose, look);
    const chosen = this.session.station();
    if (chosen && this.hasFocus) this.#focus(sketch, chosen);
  }

  #devices() {
    return [...this.session.state.stations, ...this.session.devices];
  }

  /** Points of a device, and the border of its cone; one that reaches all around has rays. */
  #device(sketch, device, pose, look) {
    const isChosen = device.id === this.session.chosen;
    const [colour, width] = isChosen ? [COLOURS.chosen, 2.5] : [COLOURS.device, 1.6];
    const size = 5 * look.pixelAt(centreOf(pose));
    for (const point of device.points)
      for (const axis of [0, 1, 2]) {
        const way = [0, 1, 2].map((k) => (k === axis ? size : 0));
        sketch.line(fromCamera(pose, subtract(point, way)), fromCamera(pose, add(point, way)), colour, width);
      }
    const angle = radians(Math.min(device.half_angle_deg, 80));
    const isAround = device.half_angle_deg >= 180;
    const [wide, deep] = [this.depth * Math.sin(angle), this.depth * Math.cos(angle)];
    const reach = 0.3 * this.depth;
    const border = isAround ? ellipse([0, 0, 0], [0, 0, reach], [reach, 0, 0], 24) : ellipse([0, 0, deep], [wide, 0, 0], [0, wide, 0], 24);
    const ring = border.map((end) => fromCamera(pose, end));
    if (!isAround) sketch.path(ring, colour, width, true);
    for (let k = 0; k < 24; k += isAround ? 2 : 6) sketch.line(centreOf(pose), ring[k], colour, width);
  }

  /** Ends of the border rays, world. */
  #ends(station) {
    const camera = this.session.cameraOf(station);
    const reach = this.depth / Math.max(1, ...camera.border.map(length)); // wide ones are not larger
    return borderAt(camera, this.session.poseOf(station), reach);
  }

  /** Border of the image, for whoever looks through the camera. */
  #border(sketch, station, colour) {
    sketch.path(this.#ends(station), colour, 2.5, true);
  }

  /** View pyramid, with dashed edges where the camera was kept. */
  #frustum(sketch, station, colour, isChosen) {
    const pose = this.session.poseOf(station);
    const ends = this.#ends(station);
    const parts = station.name.endsWith("(kept)") ? [0, 2, 4, 6] : [null];
    const line = (from, to, tint, wide) => {
      for (const at of parts)
        if (at === null) sketch.line(from, to, tint, wide);
        else sketch.line(mix(from, to, at / 8), mix(from, to, (at + 1) / 8), tint, wide);
    };
    const width = isChosen ? 2.5 : 1.4;
    const starts = borderAt(this.session.cameraOf(station), pose, 0);
    const quarter = ends.length / 4;
    // A contrasting line below the coloured one keeps it visible on faces of any colour.
    for (const [tint, wide] of [
      [colour === DARK_ON ? DARK_HALO : HALO, width + 2],
      [colour, width],
    ]) {
      sketch.path(ends, tint, wide, true);
      for (const corner of [0, 1, 2, 3].map((side) => side * quarter))
        line(starts[corner], ends[corner], tint, wide);
      if (distance(starts[0], starts[quarter]) > 0) sketch.path(starts, tint, wide, true);
    }
    // A mark above the upper border says which way is up in the image.
    const [a, b] = [ends[Math.floor(0.35 * quarter)], ends[Math.ceil(0.65 * quarter)]];
    if (quarter > 3) {
      const tip = add(mix(a, b, 0.5), scale(column(pose, 1), -0.22 * distance(ends[0], ends[quarter])));
      sketch.path([a, tip, b], colour, width);
    }
    if (isChosen) sketch.polygon(ends, [colour[0], colour[1], colour[2], 0.1]);
  }

  /** Planes between which the camera is in focus, where it has such. */
  #focus(sketch, station) {
    const camera = this.session.cameraOf(station);
    if (!camera.depth_of_field || !isPlanar(camera)) return;
    const pose = this.session.poseOf(station);
    const reach = 3 * sphereAround(this.session.scene.frame).radius;
    for (const depth of camera.depth_of_field) {
      if (depth === null || depth <= 0 || depth > reach) continue;
      const corners = borderAt(camera, pose, depth);
      sketch.polygon(corners, [...COLOURS.focus.slice(0, 3), 0.16]);
      sketch.path(corners, COLOURS.focus, 1.2, true);
    }
  }

  /** Stations that have names: of a crowd the chosen one and that under the pointer. */
  #named() {
    const { chosen } = this.session;
    const devices = this.#devices();
    const isNamed = ({ id }) => devices.length <= CROWD || id === chosen || id === this.hovered;
    return devices.filter(isNamed);
  }

  #label() {
    const stations = this.#named();
    const known = new Set(stations.map((station) => station.id));
    for (const [id, made] of this.names) {
      if (known.has(id)) continue;
      made.remove();
      this.names.delete(id);
    }
    for (const station of stations) {
      let made = this.names.get(station.id);
      if (!made) {
        made = element("button.name", {
          type: "button",
          tabindex: "-1",
          on: { click: () => this.session.choose(station.id) },
        });
        this.names.set(station.id, made);
        this.overlay.append(made);
      }
      made.textContent = station.name;
      made.classList.toggle("chosen", station.id === this.session.chosen);
      made.classList.toggle("off", station.is_on === false);
      made.classList.toggle("wrong", Boolean(station.place) && station.place !== "allowed");
    }
  }

  /** Puts names at their cameras; one that would lie on another is left out, the chosen one never. */
  #place(look) {
    const taken = [];
    const width = this.view.canvas.clientWidth;
    const { chosen } = this.session;
    const ordered = this.#named().sort((a, b) => (b.id === chosen) - (a.id === chosen));
    for (const station of ordered) {
      const made = this.names.get(station.id);
      if (!made) continue;
      const at = this.isShown ? look.toScreen(centreOf(this.session.poseOf(station))) : null;
      const isInside = at && at[0] > 0 && at[1] > 0 && at[0] < width && at[1] < this.view.canvas.clientHeight;
      const isFree =
        isInside && taken.every(([x, y]) => Math.abs(x - at[0]) > 62 || Math.abs(y - at[1]) > 18);
      made.hidden = !isFree;
      if (!isFree) continue;
      taken.push(at);
      const left = at[0] > width - 90 ? at[0] - 9 - made.offsetWidth : at[0] + 9;
      made.style.transform = `translate(${Math.round(left)}px, ${Math.round(at[1] - 22)}px)`;
    }
  }
}

const isPlanar = ({ border }) => border.every((ray) => Math.abs(ray[2] - 1) < 1e-6);

/** Points of the border rays of a camera at a multiple of them, world; parallel ones start side by side. */
function borderAt(camera, pose, times) {
  const from = (row) => camera.origins?.[row] ?? [0, 0, 0];
  return camera.border.map((ray, row) => fromCamera(pose, add(from(row), scale(ray, times))));
}

/**
 * Diameter of the blur circle of a point, pixels: A fx |z - z_s| / (z (z_s - f)), with aperture A = f / N,
 * depth z and distance in focus z_s, of a telecentric lens |z - z_s| M fx / N; null where it is not known.
 */
export function blurAt(camera, pose, point) {
  const { focal_length: f, f_number: stop, focus_distance: focus, fx, magnification } = camera;
  if (magnification && stop && focus)
    return (Math.abs(inCamera(pose, point)[2] - focus) * magnification * camera.plain.fx) / stop;
  if (!f || !stop || !focus) return null;
  const z = inCamera(pose, point)[2];
  return z > 0 ? ((f / stop) * fx * Math.abs(z - focus)) / (z * (focus - f)) : null;
}

/** Half height, metres, of a parallel picture on a canvas that shows all of a camera's image; or null. */
export function halfOfStation(camera, canvas) {
  if (!camera.origins) return null;
  const half = (axis) => Math.max(...camera.origins.map((start) => Math.abs(start[axis])));
  return 1.03 * Math.max(half(1), (half(0) * canvas.clientHeight) / canvas.clientWidth);
}

/** Vertical field of view, radians, of a picture on a canvas that shows all of a camera's image. */
export function fieldOfStation(camera, canvas) {
  if (!isPlanar(camera)) return radians(110);
  const slope = (axis) => Math.max(...camera.border.map((ray) => Math.abs(ray[axis])));
  const half = Math.max(slope(1), (slope(0) * canvas.clientHeight) / canvas.clientWidth);
  return Math.min(radians(150), 2 * Math.atan(1.03 * half));
}
