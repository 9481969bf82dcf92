/**
 * A drawing under the floor plan: a picture of the user's own disk, which is saved with the rig.
 *
 * It lies by a similarity: a place [x, y] of the drawing, whose width is `WIDTH`, is the complex number
 * z = x - i y, and a z + b that of the plan, metres towards east and north. Two places of the drawing
 * and theirs in the plan give a and b; two and their distance give |a|. An SVG is shown as an image,
 * in which browsers run no script and load nothing.
 */

import { base64Of, bytesOf } from "rastercov/api.js";
import { button, element, fileButton, inUnit, menu } from "rastercov/dom.js";
import { rayAt } from "rastercov/gizmo.js";
import { add, boxCorners, dot, horizon, scale } from "rastercov/maths.js";
import { numberBox } from "rastercov/fields.js";

const WIDTH = 1000;
const MOST_BYTES = 16 << 20; // which the program takes, too
const MOST_PIXELS = 64e6;
const MOST_ASPECT = 50;
const SNAP = 10; // pixels from a click to a corner of the mesh that takes it
const MOST_CORNERS = 1_000_000;
const MARKS = [
  [0.85, 0.15, 0.55, 1],
  [0.1, 0.45, 0.9, 1],
];
const STEPS = [
  "Click a point of the drawing that you can find in the model, too, such as a corner of a wall.",
  "Click a second point of the drawing, far from the first.",
  "Type the distance between the two points, or click where the first point is in the model.",
  "Click where the second point is in the model.",
];
const TO_MOVE = "The drawing is now to scale. Click where the first point is in the model, or press Esc to finish.";

const plus = ([a, b], [c, d]) => [a + c, b + d];
const minus = ([a, b], [c, d]) => [a - c, b - d];
const times = ([a, b], [c, d]) => [a * c - b * d, a * d + b * c];
const over = ([a, b], [c, d]) => [(a * c + b * d) / (c * c + d * d), (b * c - a * d) / (c * c + d * d)];

/** Menu of the drawing, for the tools; `setPlan` says whether the floor plan is shown. */
export class Drawing {
  constructor(view, session, tools, overlay) {
    Object.assign(this, { view, session, tools });
    this.kept = null; // {name, place: [a, b], opacity, image: base64}, as the program has it
    this.isPlan = false;
    this.points = []; // that were clicked: two of the drawing, then two of the plan
    this.image = element("img.drawing", { alt: "drawing under the floor plan", hidden: true });
    overlay.prepend(this.image);
    this.#build();
    tools.add("drawing", (x, y) => this.#click(x, y));
    session.on("tool", (tool) => tool === "drawing" || this.#ask([]));
    view.onSketch((sketch, look) => this.#mark(sketch, look), { isOnTop: true });
    view.onDrawn((look) => this.#lay(look));
    session.on("restarted", () => this.kept && this.#keep(this.kept));
    this.#load();
  }

  async #load() {
    const kept = await this.session.server.drawing();
    if (kept.image) this.#show(kept, bytesOf(kept.image));
  }

  /** Gives changes of the drawing to the program, which saves it with the rig; {} removes it. */
  #keep(changes) {
    return this.session.attempt(async () => {
      await this.session.server.keepDrawing(changes);
      this.session.takeOver(); // it is not saved
    });
  }

  #build() {
    this.place = button("Place by two points", () => this.#ask([], true), {
      title: "scale the drawing: click two points of it, then type their distance or click them in the model",
    });
    this.remove = button("Remove", () => {
      this.kept = null;
      this.#update();
      this.#keep({});
    });
    this.opacity = element("input", { type: "range", min: "0.05", max: "1", step: "0.05" });
    this.opacity.addEventListener("input", () => (this.image.style.opacity = this.opacity.value));
    this.opacity.addEventListener("change", () => this.#set({ opacity: Number(this.opacity.value) }));
    const saved = this.session.server.isLive ? "" : ", saved with the rig";
    this.menu = menu("Drawing", `a drawing under the floor plan${saved}`, [
      fileButton("Choose a PNG, JPEG or SVG…", ".png,.jpg,.jpeg,.svg", (file) => this.choose(file)),
      this.place,
      element("label.check.opacity", "Opacity", this.opacity),
      this.remove,
    ]);
    this.menu.hidden = true;
    this.words = element("span");
    this.distance = numberBox({ label: "Distance", placeholder: "", value: null, low: 0, is_low_open: true, unit: inUnit("m") }, (value) =>
      this.#scaleTo(value),
    );
    this.typed = element("label.group", this.distance.input, element("span.unit", inUnit("m")));
    this.hint = element(
      "div.hint",
      { role: "status", hidden: true },
      this.words,
      this.typed,
      this.distance.fault,
      button("End", () => this.tools.set("pick")),
    );
  }

  setPlan(isPlan) {
    this.isPlan = isPlan;
    if (!isPlan && this.tools.tool === "drawing") this.tools.set("pick");
    this.#update();
  }

  /** Takes a file, over the whole scene at first; a new version of the last one where that is. */
  async choose(file) {
    const bytes = new Uint8Array(await file.slice(0, MOST_BYTES + 1).arrayBuffer());
    const place = this.kept?.name === file.name ? this.kept.place : null;
    if (!(await this.#show({ opacity: 0.6, name: file.name.slice(-120), place }, bytes))) return;
    if (!this.isPlan) this.session.emit("notice", `${file.name} is under the floor plan (P).`);
    this.#keep(this.kept);
  }

  /** Shows the bytes of an image at its place; false, and a line, where it is none. */
  async #show(kept, bytes) {
    const { fault, type } = checkDrawing(kept.name, bytes);
    if (fault) return this.session.emit("fault", fault);
    const text = base64Of(bytes);
    const src = `data:${type};base64,${text}`;
    const image = Object.assign(new Image(), { src });
    const isImage = await image.decode().then(
      () => true,
      () => false,
    );
    const aspect = image.naturalHeight / image.naturalWidth;
    if (!isImage || !(aspect > 1 / MOST_ASPECT && aspect < MOST_ASPECT))
      return this.session.emit("fault", `${kept.name} cannot be shown; save it again as PNG, JPEG or SVG`);
    this.aspect = aspect;
    Object.assign(this.image, { src, width: WIDTH, height: WIDTH * aspect });
    this.kept = { ...kept, place: kept.place ?? this.#overScene(), image: text };
    this.image.style.opacity = this.opacity.value = String(kept.opacity);
    this.#update();
    return true;
  }

  /** Changes the place or the opacity. */
  #set(changes) {
    Object.assign(this.kept, changes);
    this.#keep(changes);
    this.#update();
  }

  #update() {
    const isShown = Boolean(this.kept) && this.isPlan;
    this.menu.hidden = !this.isPlan;
    this.place.disabled = this.opacity.disabled = this.remove.disabled = !this.kept;
    this.image.hidden = !isShown;
    document.documentElement.classList.toggle("paper", isShown);
    this.view.request();
  }

  /** Place over the middle of the scene, and at least as large. */
  #overScene() {
    const corners = boxCorners(this.session.scene.bounds).map((corner) => this.#toPlan(corner));
    const [us, vs] = [0, 1].map((axis) => corners.map((corner) => corner[axis]));
    const [low, high] = [[Math.min(...us), Math.min(...vs)], [Math.max(...us), Math.max(...vs)]]; // prettier-ignore
    const size = Math.max((high[0] - low[0]) / WIDTH, (high[1] - low[1]) / (WIDTH * this.aspect));
    const middle = [(size * WIDTH) / 2, (-size * WIDTH * this.aspect) / 2];
    return [[size, 0], minus(scale2(plus(low, high), 0.5), middle)];
  }

  #toPlan(point) {
    return horizon(this.session.scene.up).map((axis) => dot(point, axis));
  }

  /** World point of the plan, at the top of the scene. */
  #toWorld([u, v]) {
    const { up, bounds } = this.session.scene;
    const [east, north] = horizon(up);
    const top = Math.max(...boxCorners(bounds).map((corner) => dot(corner, up)));
    return [scale(east, u), scale(north, v), scale(up, top)].reduce(add);
  }

  #onPlan([x, y]) {
    const [a, b] = this.kept.place;
    return plus(times(a, [x, -y]), b);
  }

  /** Puts the image where it lies in the picture. */
  #lay(look) {
    if (this.image.hidden) return;
    const corners = [[0, 0], [WIDTH, 0], [0, WIDTH]]; // prettier-ignore
    const [o, right, down] = corners.map((each) => look.toScreen(this.#toWorld(this.#onPlan(each))));
    const columns = [right, down].map((end) => [(end[0] - o[0]) / WIDTH, (end[1] - o[1]) / WIDTH]);
    this.image.style.transform = `matrix(${[...columns.flat(), o[0], o[1]].join(", ")})`;
  }

  #ask(points, isNew = false) {
    this.points = points;
    this.isToMove = false;
    this.menu.open = false;
    if (isNew) {
      this.view.moving(); // and so not framed anew between two clicks
      this.tools.set("drawing");
    }
    const isAsking = this.tools.tool === "drawing";
    this.hint.hidden = !isAsking;
    this.words.textContent = STEPS[points.length];
    this.typed.hidden = points.length !== 2;
    this.distance.fault.hidden = true;
    this.distance.set(null);
    this.view.request();
  }

  #click(x, y) {
    const plan = this.#toPlan(rayAt(this.view, x, y).from);
    const [a, b] = this.kept.place;
    const [re, im] = over(minus(plan, b), a);
    const isOfDrawing = this.points.length < 2 && !this.isToMove;
    const points = [...this.points, isOfDrawing ? [re, -im] : this.#corner(x, y) ?? plan];
    if (points.length === 2 && isOfDrawing && length2(minus(...points)) < 1) return true;
    if (this.isToMove) this.#set({ place: [a, plus(b, minus(points[2], this.#onPlan(points[0])))] });
    else if (points.length === 4) this.#set({ place: placeBy(points) ?? this.kept.place });
    if (this.isToMove || points.length === 4) this.tools.set("pick");
    else this.#ask(points);
    return true;
  }

  /** Plan of the corner of a face that is next to a place of the picture, or null. */
  #corner(x, y) {
    const { corners, origin } = this.session;
    if (corners.length > 3 * MOST_CORNERS) return null;
    const { toScreen } = this.view.look();
    let best = { away: SNAP, point: null };
    for (let at = 0; at < corners.length; at += 3) {
      const point = [0, 1, 2].map((axis) => corners[at + axis] + origin[axis]);
      const place = toScreen(point);
      const away = place ? Math.hypot(place[0] - x, place[1] - y) : Infinity;
      if (away < best.away) best = { away, point };
    }
    return best.point && this.#toPlan(best.point);
  }

  /** Makes the distance of the two points of the drawing that of the model; the first one stays. */
  #scaleTo(metres) {
    const [first, second] = this.points.map((each) => this.#onPlan(each));
    const [a, b] = this.kept.place;
    const factor = metres / length2(minus(second, first));
    this.#set({ place: [scale2(a, factor), plus(first, scale2(minus(b, first), factor))] });
    this.isToMove = true;
    this.words.textContent = TO_MOVE;
    this.typed.hidden = true;
    this.view.canvas.focus({ preventScroll: true });
  }

  /** Crosses at the points so far. */
  #mark(sketch, look) {
    if (!this.kept || !this.isPlan) return;
    this.points.forEach((each, at) => {
      const middle = this.#toWorld(at < 2 ? this.#onPlan(each) : each);
      const arm = 9 * look.pixelAt(middle);
      for (const axis of horizon(this.session.scene.up))
        sketch.line(add(middle, scale(axis, -arm)), add(middle, scale(axis, arm)), MARKS[at % 2], 3);
    });
  }
}

const scale2 = ([x, y], s) => [x * s, y * s];
const length2 = ([x, y]) => Math.hypot(x, y);

/** Place by two points of the drawing and two of the plan; null where these are one. */
function placeBy([from, to, start, end]) {
  const [z, w] = [[from[0], -from[1]], minus([to[0], -to[1]], [from[0], -from[1]])]; // prettier-ignore
  const a = over(minus(end, start), w);
  return length2(a) > 0 ? [a, minus(start, times(a, z))] : null;
}

/** Type of a drawing by its first bytes, or one line on what is wrong with it, before it is decoded. */
function checkDrawing(name, bytes) {
  if (bytes.length > MOST_BYTES) return { fault: `${name}: expected at most ${MOST_BYTES >> 20} MB; reduce it` };
  const found = headOf(bytes);
  if (!found) return { fault: `${name}: expected a PNG, JPEG or SVG; open meshes and rigs with rastercov view` };
  const [type, width, height] = found;
  if (width * height <= MOST_PIXELS) return { type };
  return { fault: `${name} has ${width} × ${height} pixels, expected at most ${MOST_PIXELS / 1e6} million; reduce it` };
}

/** Type, width and height of a PNG, a JPEG, or an SVG, which has no pixels; null for another file. */
function headOf(bytes) {
  const data = new DataView(bytes.buffer);
  if (data.byteLength >= 24 && data.getUint32(0) === 0x89504e47)
    return ["image/png", data.getUint32(16), data.getUint32(20)];
  if (data.byteLength > 4 && data.getUint16(0) === 0xffd8) {
    for (let at = 2; at + 9 < data.byteLength; at += 2 + data.getUint16(at + 2)) {
      const marker = data.getUint16(at);
      const isFrame = marker >= 0xffc0 && marker <= 0xffcf && ![0xffc4, 0xffc8, 0xffcc].includes(marker);
      if (isFrame) return ["image/jpeg", data.getUint16(at + 7), data.getUint16(at + 5)];
    }
    return null;
  }
  const isSvg = /<svg[\s>]/.test(new TextDecoder().decode(bytes.subarray(0, 1 << 16)));
  return isSvg ? ["image/svg+xml", 0, 0] : null;
}
