/**
 * Bodies that move: the frame that is shown, the corners of the mesh in it, and the slider of frames.
 *
 * `scene.motion` has the duration of each of T frames; for each group its body; and of B bodies, frame by
 * frame, poses, 3 x 4 numbers from the rest pose to the world, and whether they are there. Numbers after
 * that of the frame, `session.further`, are of other features; the server moves bodies by these.
 */

import { bytesOf } from "rastercov/api.js";
import { button, element, percent, section } from "rastercov/dom.js";
import { clamp } from "rastercov/maths.js";

/** Mean time for which a frame is shown, ms. */
const FRAME_MS = 160;
const STEPS = { ",": -1, ".": 1 };

/** Frames of a session; null where nothing moves. */
export function time(session) {
  if (!session.scene.motion) return null;
  const show = ([frame = 0, ...further] = [], placed = null) => {
    Object.assign(session, { frame, further });
    if (!further.length || placed) session.corners = cornersAt(session, frame, placed);
    session.emit("phase");
  };
  session.phases = {
    show,
    get at() {
      return [session.frame, ...session.further];
    },
  };
  session.setFrame = async (frame) => {
    show([frame]);
    if (session.server.hasPhases?.(session.mode) ?? true) await session.refresh();
  };
  return {
    side: () => timePanel(session),
    help: [["Frames", [[", and .", "previous, next"], ["Space in the 3-D view", "play, stop"]]]],
    key({ key, target }) {
      if (!session.play) return false;
      if (key in STEPS) session.stepFrame(STEPS[key]);
      else if (key === " " && target.matches("canvas.scene")) session.play();
      else return false;
      return true;
    },
  };
}

/**
 * Corners of a frame, relative to the origin, from those at rest; bodies that are absent have no area.
 * `placed`: poses of the bodies in place of those of the frame, bytes of base64.
 */
function cornersAt(session, frame, placed = null) {
  const { scene, origin, cornersAtRest: rest, faceGroups } = session;
  const { bodies, durations } = scene.motion;
  const poses = (scene.motion.table ??= new Float64Array(bytesOf(scene.motion.poses).buffer));
  const present = (scene.motion.there ??= bytesOf(scene.motion.present));
  const count = present.length / durations.length;
  const own = placed && new Float64Array(bytesOf(placed).buffer);
  const moved = new Float32Array(rest.length);
  for (let face = 0; face < faceGroups.length; face++) {
    const row = frame * count + bodies[faceGroups[face]];
    const at = 12 * (own ? bodies[faceGroups[face]] : row);
    const m = (own ?? poses).subarray(at, at + 12);
    for (let corner = 0; corner < 3; corner++) {
      const from = 9 * face + (present[row] ? 3 * corner : 0);
      const [x, y, z] = [0, 1, 2].map((axis) => rest[from + axis] + origin[axis]);
      for (let axis = 0; axis < 3; axis++) {
        const place = m[4 * axis] * x + m[4 * axis + 1] * y + m[4 * axis + 2] * z + m[4 * axis + 3];
        moved[9 * face + 3 * corner + axis] = place - origin[axis];
      }
    }
  }
  return moved;
}

/** Slider and button to play; null for one frame. */
function timePanel(session) {
  const { motion } = session.scene;
  const last = motion.durations.length - 1;
  if (!last) return null;
  const whole = motion.durations.reduce((sum, each) => sum + each, 0);
  const slider = element("input", {
    type: "range", min: "0", max: String(last), step: "1", value: String(session.frame), "aria-label": "frame",
  });
  const words = element("output");
  let timer = null;
  const stop = () => {
    timer = null;
    play.textContent = "Play";
  };
  const next = async () => {
    const duration = (FRAME_MS * (last + 1) * motion.durations[session.frame]) / whole;
    const own = (timer = {});
    await Promise.all([session.setFrame(session.frame === last ? 0 : session.frame + 1), pause(duration)]);
    if (timer === own) next();
  };
  session.play = () => {
    if (timer !== null) return stop();
    play.textContent = "Stop";
    next();
  };
  const play = button("Play", session.play);
  const go = (frame) => {
    stop();
    session.setFrame(clamp(frame, 0, last));
  };
  session.stepFrame = (by) => go(session.frame + by);
  slider.addEventListener("input", () => go(Number(slider.value)));
  const show = () => {
    slider.value = String(session.frame);
    const start = motion.durations.slice(0, session.frame).reduce((sum, each) => sum + each, 0);
    words.textContent = `frame ${session.frame} (0 to ${last}), starts at ${percent((100 * start) / whole)} of the duration`;
  };
  session.follow("phase", show);
  const soft = session.canEdit ? element("p.soft", "Figures and cameras are those of this frame.") : null;
  return section("Time", [element("div.time", slider, element("div.buttons", play, words), soft)]);
}

const pause = (time) => new Promise((resolve) => setTimeout(resolve, time));
