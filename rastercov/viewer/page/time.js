/**
 * Bodies that move: the frame that is shown, the corners of the mesh in it, and the slider of frames.
 *
 * `scene.motion` has the duration of each of T frames; for each group its body; and of B bodies, frame by
 * frame, poses, 3 x 4 numbers from the rest pose to the world, and whether they are there.
 */

import { bytesOf } from "rastercov/api.js";
import { button, element } from "rastercov/dom.js";

/** Mean time for which a frame is shown, ms. */
const FRAME_MS = 160;

/** Corners of a frame, relative to the origin, from those at rest; bodies that are absent have no area. */
export function cornersAt(session, frame) {
  const { scene, origin, cornersAtRest: rest, faceGroups } = session;
  const { bodies, durations } = scene.motion;
  const poses = (scene.motion.table ??= new Float64Array(bytesOf(scene.motion.poses).buffer));
  const present = (scene.motion.there ??= bytesOf(scene.motion.present));
  const count = present.length / durations.length;
  const moved = new Float32Array(rest.length);
  for (let face = 0; face < faceGroups.length; face++) {
    const row = frame * count + bodies[faceGroups[face]];
    const m = poses.subarray(12 * row, 12 * row + 12);
    for (let corner = 0; corner < 3; corner++) {
      const from = 9 * face + (present[row] ? 3 * corner : 0);
      const [x, y, z] = [0, 1, 2].map((axis) => rest[from + axis] + origin[axis]);
      for (let axis = 0; axis < 3; axis++) {
        const at = m[4 * axis] * x + m[4 * axis + 1] * y + m[4 * axis + 2] * z + m[4 * axis + 3];
        moved[9 * face + 3 * corner + axis] = at - origin[axis];
      }
    }
  }
  return moved;
}

/** Slider and button to play; null where nothing moves. */
export function timePanel(session) {
  const { motion } = session.scene;
  if (!motion) return null;
  const last = motion.durations.length - 1;
  const whole = motion.durations.reduce((sum, each) => sum + each, 0);
  const slider = element("input", {
    type: "range", min: "0", max: String(last), step: "1", value: String(session.frame), "aria-label": "frame",
  });
  const words = element("output");
  let timer = null;
  const stop = () => {
    clearTimeout(timer);
    timer = null;
    play.textContent = "Play";
  };
  const next = () => {
    session.setFrame(session.frame === last ? 0 : session.frame + 1);
    timer = setTimeout(next, (FRAME_MS * (last + 1) * motion.durations[session.frame]) / whole);
  };
  const play = button("Play", () => {
    if (timer !== null) return stop();
    play.textContent = "Stop";
    next();
  });
  slider.addEventListener("input", () => {
    stop();
    session.setFrame(Number(slider.value));
  });
  const show = () => {
    slider.value = String(session.frame);
    const start = motion.durations.slice(0, session.frame).reduce((sum, each) => sum + each, 0);
    words.textContent = `frame ${session.frame} of ${last}, at ${Number(start.toPrecision(4))}`;
  };
  session.on("time", show);
  show();
  return element("div.time", {}, slider, element("div.buttons", {}, play, words));
}
