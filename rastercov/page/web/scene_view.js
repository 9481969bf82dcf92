/**
 * The picture of the scene: a WebGL2 canvas that is drawn only when something changed.
 *
 * Others add to it by `onSketch((sketch, look) => ...)`, in world coordinates, and by
 * `onDrawn(look)`, after each picture. `look` says how the world projects: see `look()`.
 */

import { creasesOf } from "rastercov/creases.js";
import { later } from "rastercov/dom.js";
import { MESH_STAGES, GROUP, MeshPass } from "rastercov/mesh_pass.js";
import { add, centroid, inCamera, multiply, scale, forwardOf, centreOf, soupCorners, subtract } from "rastercov/maths.js";
import { piecesToShow } from "rastercov/pieces.js";
import { SKETCH_STAGES, Sketch, SketchPass } from "rastercov/sketch_pass.js";
import { loadShaders } from "rastercov/shaders.js";
import { ViewCamera } from "rastercov/view_camera.js";

/** Faces from which on the picture is coarser while it moves, and how much. */
const MANY_FACES = 250_000;
const COARSER = 0.5;
const STILL_AFTER = 180; // ms
const FLIGHT = 450; // ms

export class SceneView {
  #sketchers = [];
  #onTop = [];
  #drawnListeners = [];
  #isAsked = false;
  #flight = null;
  #framing = () => {};
  #rest = later(() => {
    this.isMoving = false;
    this.request();
  }, STILL_AFTER);
  #waiting = [];

  constructor(session, canvas) {
    this.session = session;
    this.canvas = canvas;
    this.camera = new ViewCamera(session.scene);
    this.options = {
      isFlat: false,
      hasEdges: session.scene.n_faces <= 200_000,
      isCulled: Boolean(session.scene.is_room),
      isTransparent: false,
      hasPieces: true,
      section: null,
    };
    this.hiddenGroups = new Set();
    this.highlighted = null; // index of a group
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.isLost = true;
      session.emit("notice", "The graphics device was lost; the view returns with it.");
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.isLost = false;
      this.#createPasses();
      this.request();
    });
    new ResizeObserver(() => this.#reframe()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.request());
  }

  /** Opens the device; an Error says what is missing. */
  async open() {
    await loadShaders([...MESH_STAGES, ...SKETCH_STAGES]);
    this.gl = this.canvas.getContext("webgl2", {
      antialias: true,
      alpha: false,
      powerPreference: "high-performance",
    });
    if (!this.gl)
      throw new Error(
        "this browser has no WebGL2; try a current Firefox, Chromium or Safari, or switch hardware acceleration on",
      );
    this.#createPasses();
    this.session.on("frame", () => {
      this.#colour();
      this.request();
    });
    this.session.on("state chosen face poses", () => this.request());
    this.session.on("phase", () => {
      this.#framing = () => {}; // cameras that ride, and the legend, would move the view
      if (!this.isLost) this.mesh.setCorners(this.session.corners);
      this.request();
    });
  }

  #createPasses() {
    const { corners, faceGroups, scene } = this.session;
    this.mesh = new MeshPass(this.gl, corners, faceGroups, scene.groups.length);
    this.sketches = new SketchPass(this.gl);
    this.#colour();
    this.showGroups();
    this.#showCreases();
  }

  #showCreases() {
    if (!this.options.hasEdges || this.isLost) return;
    this.creases ??= creasesOf(this.session.cornersAtRest, this.session.faceGroups);
    this.mesh.setCreases(this.creases);
  }

  #colour() {
    if (!this.session.levels || this.isLost) return;
    const pieces = piecesToShow(this.session, this);
    this.mesh.setLevels(pieces ? pieces.base : this.session.levels);
    this.mesh.setPieces(pieces);
    this.mesh.setPalette(this.session.palette, this.session.figures.legend);
  }

  /** Tells the device which groups are hidden, transparent or highlighted. */
  showGroups() {
    const flags = this.session.scene.groups.map((group, at) => {
      const isSeenThrough = this.options.isTransparent && group.role === "occluder";
      return (
        (this.hiddenGroups.has(at) ? GROUP.hidden : 0) |
        (group.is_two_sided ? GROUP.twoSided : 0) |
        (isSeenThrough ? GROUP.transparent : 0) |
        (this.highlighted === at ? GROUP.highlighted : 0)
      );
    });
    if (!this.isLost) this.mesh.setGroups(Uint8Array.from(flags.length ? flags : [0]));
    this.request();
  }

  /** Leaves a group out of the picture, or shows it again. */
  hideGroup(group, isHidden) {
    if (isHidden) this.hiddenGroups.add(group);
    else this.hiddenGroups.delete(group);
    this.showGroups();
    this.session.emit("groups");
  }

  /** Leaves out what hides a face in the picture, other groups than its own; their names. */
  openTo(face) {
    const { faceGroups, scene } = this.session;
    const { toScreen } = this.look();
    const at = this.camera.isPlan ? null : toScreen(centroid(this.corners(face)));
    const names = [];
    while (at && names.length < scene.groups.length) {
      const found = this.pick(at[0], at[1]);
      const group = faceGroups[found?.face ?? face];
      if (group === faceGroups[face] || toScreen(found.point)[2] > at[2]) break;
      this.hideGroup(group, true);
      names.push(scene.groups[group].name || `group ${group}`);
    }
    if (names.length)
      this.session.emit("notice", `Hidden because they block the view: ${names.join(", ")}. Show them again under Object, Groups.`);
  }

  highlight(group) {
    if (group === this.highlighted) return;
    this.highlighted = group;
    this.showGroups();
  }

  setOption(name, value) {
    this.options[name] = value;
    if (name === "isTransparent") this.showGroups();
    if (name === "hasEdges") this.#showCreases();
    if (name === "hasPieces") this.#colour();
    this.session.emit("view");
    this.request();
  }

  /** Draws a sketch with each picture, hidden by the mesh; `isOnTop`: by nothing. */
  onSketch(draw, { isOnTop = false } = {}) {
    (isOnTop ? this.#onTop : this.#sketchers).push(draw);
  }

  onDrawn(listener) {
    this.#drawnListeners.push(listener);
  }

  /** Asks for a picture, soon. */
  request() {
    if (this.#isAsked || !this.mesh) return;
    this.#isAsked = true;
    requestAnimationFrame(() => {
      this.#isAsked = false;
      this.draw();
      if (this.#flight) this.#fly();
      if (!this.#isAsked) for (const resolve of this.#waiting.splice(0)) resolve();
    });
  }

  /** Ends when no picture is due. */
  whenDrawn() {
    return this.#isAsked ? new Promise((resolve) => this.#waiting.push(resolve)) : Promise.resolve();
  }

  /** Takes a view that suits the size of the picture, and again at other sizes until the view is moved. */
  frame(take) {
    this.#framing = take;
    this.#reframe();
  }

  /** Makes room for what is over the picture, of any size that it gets. */
  keepFree(over, legend) {
    Object.assign(this, { over, legend });
    new ResizeObserver(() => this.#reframe()).observe(legend);
  }

  /** A picture without a size, as in a frame that is hidden, is framed when it gets one. */
  #reframe() {
    if (this.canvas.clientWidth && this.canvas.clientHeight) this.#framing();
    this.request();
  }

  /** Says that the view moves: many faces are drawn coarser until it rests. */
  moving() {
    this.#flight = null;
    this.#framing = () => {};
    this.isMoving = true;
    this.#rest();
    this.request();
  }

  #resize() {
    const { canvas } = this;
    const coarser = this.isMoving && this.mesh.nFaces > MANY_FACES ? COARSER : 1;
    const density = (window.devicePixelRatio || 1) * coarser;
    const width = Math.max(1, Math.round(canvas.clientWidth * density));
    const height = Math.max(1, Math.round(canvas.clientHeight * density));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    return { width, height, density };
  }

  /**
   * How the world projects now.
   *
   * @returns clipFromWorld (of coordinates relative to the origin), world (of absolute ones), pose,
   *   width, height, density, near, pixel(depth), toScreen(point), eye
   */
  look() {
    const size = this.#resize();
    const { session, camera } = this;
    const others = session.shownDevices().map(({ pose }) => centreOf(pose));
    const seen = camera.look(size.width, size.height, [...session.centres(), ...others]);
    const { origin } = session;
    const shift = [1, 0, 0, origin[0], 0, 1, 0, origin[1], 0, 0, 1, origin[2], 0, 0, 0, 1];
    const eye = seen.isParallel ? scale(forwardOf(seen.pose), -1) : subtract(centreOf(seen.pose), origin);
    const { section } = this.options;
    const offset = section
      ? section[0] * origin[0] + section[1] * origin[1] + section[2] * origin[2] + section[3]
      : 0;
    return {
      ...seen,
      ...size,
      eye,
      world: seen.clipFromWorld,
      clipFromWorld: multiply(seen.clipFromWorld, shift),
      section: section ? [section[0], section[1], section[2], offset] : null,
      isCulled: this.options.isCulled,
      isFlat: this.options.isFlat,
      hasEdges: this.options.hasEdges,
      hasTransparent: this.options.isTransparent,
      accent: [0.95, 0.25, 0.85],
      toScreen: (point) => screenOf(seen.clipFromWorld, point, this.canvas),
      /** World length that a pixel of the page has at a point. */
      pixelAt: (point) => seen.pixel(Math.max(seen.near, inCamera(seen.pose, point)[2])) * size.density,
    };
  }

  aspect() {
    return this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
  }

  /** Parts of the height of the picture that tools cover above, and a legend of half its width below. */
  covered() {
    const { top, bottom, width, height } = this.canvas.getBoundingClientRect();
    const [over, legend] = [this.over, this.legend].map((each) => each?.getBoundingClientRect());
    const above = over ? over.bottom - top : 0;
    const below = legend && legend.width > width / 2 ? bottom - legend.top : 0;
    return [above, below].map((size) => Math.min(0.4, Math.max(0, size) / Math.max(1, height)));
  }

  draw() {
    if (this.isLost || this.gl.isContextLost()) return;
    const look = this.look();
    this.#drawMesh(look);
    const sketch = new Sketch(this.session.origin);
    for (const draw of this.#sketchers) draw(sketch, look);
    this.sketches.draw(sketch, look);
    const onTop = new Sketch(this.session.origin);
    for (const draw of this.#onTop) draw(onTop, look);
    this.sketches.draw(onTop, look, { isOnTop: true });
    for (const listener of this.#drawnListeners) listener(look);
  }

  #drawMesh(look) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, look.width, look.height);
    const [r, g, b] = this.background();
    gl.clearColor(r, g, b, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.mesh.draw(look);
  }

  /** Colour behind the scene, 0 to 1, from the style sheet. */
  background() {
    const text = getComputedStyle(document.documentElement).getPropertyValue("--scene").trim();
    return [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255);
  }

  /** {face, point} under a place of the canvas, in pixels of the page from its top left; or null. */
  pick(x, y) {
    if (this.isLost) return null;
    const look = this.look();
    const column = Math.floor(x * look.density);
    const row = look.height - 1 - Math.floor(y * look.density);
    const found = this.mesh.pick(look, column, row, look.width, look.height);
    if (!found) return null;
    return { face: found.face, point: add(found.point, this.session.origin) };
  }

  /** Colour of the mesh at a place of the canvas, [r, g, b]: drawn anew, because nothing keeps it. */
  readPixel(x, y, isWhole = false) {
    const look = this.look();
    if (isWhole) this.draw();
    else this.#drawMesh(look);
    const { gl } = this;
    const found = new Uint8Array(4);
    const row = look.height - 1 - Math.floor(y * look.density);
    gl.readPixels(Math.floor(x * look.density), row, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, found);
    this.request();
    return [...found.subarray(0, 3)];
  }

  /** Flies to a place of the view camera, at once where the user prefers that, and opens the view to a face. */
  flyTo(place, face = null) {
    this.#framing = () => {};
    this.camera.release();
    const isAtOnce = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const start = isAtOnce ? -Infinity : performance.now();
    this.#flight = { from: this.camera.place(), to: place, start, face };
    if (isAtOnce) this.#fly();
    this.request();
  }

  #fly() {
    const { from, to, start, face } = this.#flight;
    const t = Math.min(1, (performance.now() - start) / FLIGHT);
    this.camera.setBetween(from, to, t * t * (3 - 2 * t));
    if (t === 1) {
      this.#flight = null;
      if (face !== null) this.openTo(face);
    }
    this.request();
  }

  /** Corners of a face, world. */
  corners(face) {
    const { corners, origin } = this.session;
    return soupCorners(corners, face).map((corner) => add(corner, origin));
  }
}

/** Place on the canvas, pixels of the page from its top left, and depth (w); null behind the eye. */
function screenOf(clip, point, canvas) {
  const row = (at) => clip[at] * point[0] + clip[at + 1] * point[1] + clip[at + 2] * point[2] + clip[at + 3];
  const w = row(12);
  if (w <= 1e-9) return null;
  return [((row(0) / w + 1) / 2) * canvas.clientWidth, ((1 - row(4) / w) / 2) * canvas.clientHeight, w];
}
