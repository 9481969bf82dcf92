/**
 * Mouse, pen, touch and keys over the picture.
 *
 * Drag turns, right or middle drag (or Shift) pans, the wheel zooms towards what is under it, a click
 * picks. Tools may claim a press first: `claim(listener)`, where the listener returns null or
 * {move(x, y, event), end(), cancel()}.
 */

import { clamp } from "rastercov/maths.js";

const CLICK_SLACK = 4; // pixels that a click may move
const TURN = 0.007; // radians a pixel

export class Navigation {
  #claims = [];
  #clicks = [];
  #hovers = [];
  #pointers = new Map();
  #gesture = null;

  constructor(view) {
    this.view = view;
    const { canvas } = view;
    canvas.addEventListener("pointerdown", (event) => this.#down(event));
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    canvas.addEventListener("pointerup", (event) => this.#up(event));
    canvas.addEventListener("pointercancel", (event) => this.#up(event, true));
    canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("blur", () => canvas.classList.remove("by-mouse"));
    canvas.addEventListener("dblclick", (event) => this.#centre(event));
  }

  /** Listener gets (x, y, event) of a press and may take it. */
  claim(listener) {
    this.#claims.push(listener);
  }

  /** Listener gets (x, y, event) of a click that no tool took; true ends the search for others. */
  onClick(listener) {
    this.#clicks.push(listener);
  }

  onHover(listener) {
    this.#hovers.push(listener);
  }

  /** Ends the gesture in progress as if it had not been; false where there is none. */
  cancel() {
    if (!this.#gesture) return false;
    const hasCancelled = Boolean(this.#gesture.cancel);
    this.#gesture.cancel?.();
    this.#gesture = null;
    return hasCancelled;
  }

  #down(event) {
    const { canvas } = this.view;
    canvas.classList.add("by-mouse"); // no ring around what a mouse has the focus on
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    const [x, y] = [event.offsetX, event.offsetY];
    this.#pointers.set(event.pointerId, { x, y });
    if (this.#pointers.size === 2) {
      this.cancel();
      this.#gesture = this.#pinch();
      return;
    }
    const isPick = (canvas.dataset.tool ?? "pick") === "pick"; // a tool's clicks go before handles
    const claimed =
      isPick && event.button === 0 && !event.shiftKey && this.#claims.map((each) => each(x, y, event)).find(Boolean);
    this.#gesture = claimed || this.#turnOrPan(event, x, y);
  }

  #turnOrPan(event, startX, startY) {
    const isPan = event.button !== 0 || event.shiftKey || this.view.camera.isPlan;
    let [lastX, lastY] = [startX, startY];
    let isClick = event.button === 0 && !event.shiftKey;
    return {
      move: (x, y) => {
        if (isClick && Math.hypot(x - startX, y - startY) <= CLICK_SLACK) return;
        isClick = false;
        const height = this.view.canvas.clientHeight;
        if (isPan) this.view.camera.pan((lastX - x) / height, (lastY - y) / height);
        else this.view.camera.orbit(TURN * (x - lastX), -TURN * (y - lastY));
        [lastX, lastY] = [x, y];
        this.view.moving();
      },
      end: (x, y, last) => {
        if (isClick) this.#clicks.find((listener) => listener(x, y, last));
      },
    };
  }

  /** Two fingers: pan by their middle, zoom by their distance. */
  #pinch() {
    const spread = () => {
      const [a, b] = [...this.#pointers.values()];
      return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, size: Math.hypot(a.x - b.x, a.y - b.y) };
    };
    let last = spread();
    return {
      move: () => {
        if (this.#pointers.size < 2) return;
        const now = spread();
        const height = this.view.canvas.clientHeight;
        this.view.camera.pan((last.x - now.x) / height, (last.y - now.y) / height);
        this.view.camera.zoom(last.size / Math.max(1, now.size));
        last = now;
        this.view.moving();
      },
      end: () => {},
    };
  }

  #move(event) {
    const [x, y] = [event.offsetX, event.offsetY];
    if (this.#pointers.has(event.pointerId)) this.#pointers.set(event.pointerId, { x, y });
    if (this.#gesture) this.#gesture.move(x, y, event);
    else if (event.pointerType !== "touch") for (const listener of this.#hovers) listener(x, y, event);
  }

  #up(event, isCancelled = false) {
    this.#pointers.delete(event.pointerId);
    const gesture = this.#gesture;
    this.#gesture = null;
    if (!gesture) return;
    if (isCancelled) gesture.cancel?.();
    else gesture.end(event.offsetX, event.offsetY, event);
  }

  #wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    const found = this.#anchor(event);
    this.view.camera.zoom(Math.exp(0.0012 * lines * clamp(event.deltaY, -200, 200)), found);
    this.view.moving();
  }

  /** World point under the pointer; one pick for a series of turns of the wheel. */
  #anchor(event) {
    const now = performance.now();
    const isSeries =
      this.wheeled &&
      now - this.wheeled.time < 300 &&
      Math.hypot(this.wheeled.x - event.offsetX, this.wheeled.y - event.offsetY) < 6;
    const point = isSeries ? this.wheeled.point : this.view.pick(event.offsetX, event.offsetY)?.point;
    this.wheeled = { time: now, x: event.offsetX, y: event.offsetY, point };
    return point ?? null;
  }

  #centre(event) {
    const found = this.view.pick(event.offsetX, event.offsetY);
    if (!found) return;
    const place = this.view.camera.place();
    this.view.flyTo({ ...place, target: found.point, range: 0.6 * place.range });
  }

  /** Key over the picture that moves the view; true where it did. */
  key(event) {
    const { camera } = this.view;
    const step = event.shiftKey ? 0.02 : 0.1;
    const steps = {
      w: [0, 0, 1],
      s: [0, 0, -1],
      a: [-1, 0, 0],
      d: [1, 0, 0],
      q: [0, 1, 0],
      e: [0, -1, 0],
    };
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (steps[event.key.toLowerCase()]) {
      camera.walk(steps[event.key.toLowerCase()].map((x) => x * step));
    } else if (turns[event.key]) {
      const [right, up] = turns[event.key];
      if (camera.isPlan) camera.pan(0.5 * step * right, -0.5 * step * up);
      else camera.orbit(-step * right, step * up);
    } else if (event.key === "+" || event.key === "=") {
      camera.zoom(1 / 1.2);
    } else if (event.key === "-") {
      camera.zoom(1.2);
    } else {
      return false;
    }
    this.view.moving();
    return true;
  }
}
