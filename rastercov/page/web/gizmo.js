/**
 * Handles on the chosen camera or device: three arrows, three rings, and a square that moves it in the plane of
 * the picture. They keep their size on the screen and nothing hides them.
 *
 * A drag changes the pose at once in this page; the server follows as fast as it can. Esc puts the pose
 * back. Axes are those of the world or of the camera.
 */

import {
  add,
  centreOf,
  clamp,
  column,
  cross,
  directionFromCamera,
  distance,
  dot,
  ellipse,
  length,
  movePose,
  radians,
  rotatePose,
  scale,
  subtract,
  unit,
} from "rastercov/maths.js";
import { allowPose } from "rastercov/constraints.js";

const ARM = 84; // pixels
const RING = 62;
const REACH = 9; // pixels from a handle that take it
const SEGMENTS = 48;
const AXES = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];
const TINTS = [
  [0.9, 0.25, 0.27, 1],
  [0.2, 0.65, 0.25, 1],
  [0.18, 0.45, 0.95, 1],
];
const TAKEN = [1, 0.75, 0.1, 1];
const NUDGE = 0.004; // of the scene's size, a key
const TURN_STEP = radians(2);

export class Gizmo {
  constructor(view, session, navigation) {
    Object.assign(this, { view, session });
    this.isShown = true;
    this.isLocal = false;
    this.hovered = null;
    this.drag = null;
    view.onSketch((sketch, look) => this.#draw(sketch, look), { isOnTop: true });
    navigation.claim((x, y) => this.#take(x, y));
    navigation.onHover((x, y) => this.#hover(x, y));
  }

  get device() {
    const isUsable = this.isShown && this.session.canEdit;
    return isUsable ? this.session.device() : null;
  }

  setLocal(isLocal) {
    this.isLocal = isLocal;
    this.view.request();
  }

  setShown(isShown) {
    this.isShown = isShown;
    this.view.request();
  }

  #axes(pose) {
    return this.isLocal ? [0, 1, 2].map((at) => column(pose, at)) : AXES;
  }

  /** Handles of the present picture: {kind, axis, points (world)}. */
  #handles(look) {
    const { device } = this;
    if (!device) return [];
    const pose = this.drag?.kind === "ring" ? this.drag.start : this.session.poseOf(device);
    const centre = centreOf(this.session.poseOf(device));
    if (!look.toScreen(centre)) return [];
    const pixel = look.pixelAt(centre);
    const axes = this.#axes(pose);
    const handles = [];
    axes.forEach((axis, at) => {
      const tip = add(centre, scale(axis, ARM * pixel));
      handles.push({ kind: "arrow", at, axis, points: [add(centre, scale(axis, 14 * pixel)), tip] });
      const side = scale(unit(cross(axis, axes[(at + 1) % 3])), RING * pixel);
      const ring = ellipse(centre, side, cross(axis, side), SEGMENTS);
      handles.push({ kind: "ring", at, axis, points: [...ring, ring[0]] });
    });
    const [right, down] = AXES.slice(0, 2).map((axis) => scale(directionFromCamera(look.pose, axis), 9 * pixel));
    const square = [
      [-1, -1],
      [1, -1],
      [1, 1],
      [-1, 1],
    ].map(([x, y]) => add(centre, add(scale(right, x), scale(down, y))));
    handles.push({ kind: "plane", at: 3, axis: null, points: square });
    return handles;
  }

  #draw(sketch, look) {
    const active = this.drag ?? this.hovered;
    const away = directionFromCamera(look.pose, [0, 0, 1]);
    for (const handle of this.#handles(look)) {
      const isActive = active && active.kind === handle.kind && active.at === handle.at;
      if (this.drag && !isActive) continue;
      const tint = isActive ? TAKEN : (TINTS[handle.at] ?? [0.5, 0.55, 0.62, 1]);
      if (handle.kind === "arrow") this.#arrow(sketch, handle, tint, look);
      else if (handle.kind === "plane") {
        sketch.polygon(handle.points, [...tint.slice(0, 3), isActive ? 0.6 : 0.3]);
        sketch.path(handle.points, tint, 1.5, true);
      } else this.#ring(sketch, handle, tint, away, isActive);
    }
  }

  #arrow(sketch, { points: [from, to], axis }, tint, look) {
    sketch.line(from, to, tint, 3);
    const pixel = look.pixelAt(to);
    const view = directionFromCamera(look.pose, [0, 0, 1]);
    const side = unit(cross(axis, view));
    const tip = add(to, scale(axis, 13 * pixel));
    const base = (sign) => add(to, scale(side, sign * 6 * pixel));
    sketch.triangle(tip, base(1), base(-1), tint);
  }

  /** The half of a ring behind the camera's centre is faint, so that its sense can be seen. */
  #ring(sketch, { points }, tint, away, isActive) {
    const centre = scale(add(points[0], points[SEGMENTS / 2]), 0.5);
    for (let k = 0; k < SEGMENTS; k++) {
      const isBehind = dot(subtract(points[k], centre), away) > 1e-9 * length(centre);
      const opacity = isActive ? 1 : isBehind ? 0.18 : 0.9;
      sketch.line(points[k], points[k + 1], [...tint.slice(0, 3), opacity], isActive ? 3 : 2);
    }
  }

  /** Handle near a place of the canvas, or null. */
  #handleAt(x, y) {
    const look = this.view.look();
    let best = null;
    for (const handle of this.#handles(look)) {
      const places = handle.points.map((point) => look.toScreen(point));
      if (places.some((place) => place === null)) continue;
      let away = Infinity;
      if (handle.kind === "plane") {
        const middle = [0, 1].map((k) => (places[0][k] + places[2][k]) / 2);
        away = Math.max(Math.abs(x - middle[0]), Math.abs(y - middle[1])) < 11 ? 0 : Infinity;
      } else {
        for (let k = 1; k < places.length; k++)
          away = Math.min(away, toSegment([x, y], places[k - 1], places[k]));
        if (handle.kind === "ring") away += 1; // an arrow goes before a ring
      }
      if (away < REACH && (!best || away < best.away)) best = { ...handle, away };
    }
    return best;
  }

  #hover(x, y) {
    const found = this.#handleAt(x, y);
    const changed = found?.kind !== this.hovered?.kind || found?.at !== this.hovered?.at;
    this.hovered = found;
    this.view.canvas.style.cursor = found ? "grab" : "";
    if (changed) this.view.request();
  }

  #take(x, y) {
    const handle = this.#handleAt(x, y);
    if (!handle) return null;
    const { device } = this;
    const start = this.session.poseOf(device);
    this.drag = { ...handle, start };
    const follow = this.#follower(handle, start, x, y);
    let pose = start;
    const { reloads } = this.session;
    const isVoid = () => reloads !== this.session.reloads;
    const finish = (final) => {
      this.drag = null;
      this.hovered = null;
      if (pose !== start && !isVoid()) this.session.place(device, final);
      this.view.request();
    };
    return {
      move: (nowX, nowY, event) => {
        if (isVoid()) return;
        const wanted = follow(nowX, nowY, event.ctrlKey);
        pose = (wanted && this.#allowed(device, wanted)) ?? pose;
        if (pose !== start) this.session.place(device, pose, { isDrag: true });
      },
      end: () => finish(pose),
      cancel: () => finish(start),
    };
  }

  /** The pose, or the nearest one that the plan allows a camera; other devices may be anywhere. */
  #allowed(device, pose) {
    return "rides" in device ? pose : allowPose(this.session.scene.constraints, this.session.state, pose);
  }

  /** Function from a place of the pointer to the pose there. */
  #follower({ kind, axis }, start, startX, startY) {
    const { view } = this;
    const centre = centreOf(start);
    const look = view.look();
    if (kind === "ring") {
      const middle = look.toScreen(centre);
      const angle = (x, y) => Math.atan2(y - middle[1], x - middle[0]);
      const first = angle(startX, startY);
      // Seen from its tip an axis turns against the clock, and rows of the screen run down.
      const sense = Math.sign(dot(axis, directionFromCamera(look.pose, [0, 0, 1]))) || 1;
      return (x, y, isCoarse) => {
        let turn = sense * (angle(x, y) - first);
        if (isCoarse) turn = Math.round(turn / (Math.PI / 12)) * (Math.PI / 12);
        return rotatePose(start, axis, turn);
      };
    }
    const ray = (x, y) => rayAt(view, x, y);
    if (kind === "arrow") {
      const first = alongAxis(centre, axis, ray(startX, startY));
      return (x, y) => movePose(start, scale(axis, alongAxis(centre, axis, ray(x, y)) - first));
    }
    const normal = directionFromCamera(look.pose, [0, 0, 1]);
    const first = onPlane(centre, normal, ray(startX, startY));
    return (x, y) => movePose(start, subtract(onPlane(centre, normal, ray(x, y)), first));
  }

  /** Key over the picture: arrows and page keys move the chosen device, with Alt they turn it. */
  key(event) {
    const { device } = this;
    if (!device) return false;
    const keys = {
      ArrowLeft: [-1, 0, 0],
      ArrowRight: [1, 0, 0],
      ArrowUp: [0, 1, 0],
      ArrowDown: [0, -1, 0],
      PageUp: [0, 0, 1],
      PageDown: [0, 0, -1],
    };
    const step = keys[event.key];
    if (!step) return false;
    const pose = this.session.poseOf(device);
    const { bounds, up } = this.session.scene;
    const fine = event.shiftKey ? 0.1 : 1;
    let wanted;
    if (event.altKey) {
      const angle = TURN_STEP * fine;
      wanted = rotatePose(pose, up, -step[0] * angle);
      wanted = rotatePose(wanted, column(wanted, 0), step[1] * angle);
      wanted = rotatePose(wanted, column(wanted, 2), step[2] * angle);
    } else {
      const size = NUDGE * fine * distance(...bounds);
      const across = column(this.view.look().pose, 0);
      const right = unit(subtract(across, scale(up, dot(across, up))));
      const ahead = cross(up, right);
      const by = [scale(right, step[0]), scale(ahead, step[1]), scale(up, step[2])].reduce(add);
      wanted = movePose(pose, scale(by, size));
    }
    const next = this.#allowed(device, wanted);
    if (!next) return true;
    this.nudged = { device, pose: next, reloads: this.session.reloads };
    this.session.place(device, next, { isDrag: true });
    return true;
  }

  /** Ends a series of keys, so that they are one step of undo. */
  endKeys() {
    const { device, pose, reloads } = this.nudged ?? {};
    if (reloads === this.session.reloads) this.session.place(device, pose);
    this.nudged = null;
  }
}

/** Ray {from, along} through a place of the canvas. */
export function rayAt(view, x, y) {
  const { clientWidth: width, clientHeight: height } = view.canvas;
  return view.camera.ray((2 * x) / width - 1, 1 - (2 * y) / height, width, height);
}

/** Place along an axis that is nearest to a ray, metres from `centre`. */
function alongAxis(centre, axis, { from, along }) {
  const away = subtract(centre, from);
  const b = dot(axis, along);
  const slant = 1 - b * b;
  return slant < 1e-4 ? 0 : (b * dot(along, away) - dot(axis, away)) / slant;
}

/** Point of a ray in the plane through `centre`. */
function onPlane(centre, normal, { from, along }) {
  const t = dot(subtract(centre, from), normal) / dot(along, normal);
  return add(from, scale(along, t));
}

/** Distance of a place from a segment, pixels. */
function toSegment([x, y], a, b) {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
  const square = dx * dx + dy * dy;
  const t = square > 0 ? clamp(((x - a[0]) * dx + (y - a[1]) * dy) / square, 0, 1) : 0;
  return Math.hypot(x - a[0] - t * dx, y - a[1] - t * dy);
}
