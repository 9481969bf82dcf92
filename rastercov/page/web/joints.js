/**
 * Sliders of the joints of robots, within their limits.
 *
 * `scene.joints` has the fields of joints and their values in each frame, radians or metres. Other ones
 * follow the frame in what names a phase.
 */

import { button, element, section } from "rastercov/dom.js";
import { control } from "rastercov/fields.js";
import { clamp, radians } from "rastercov/maths.js";

/** Joints of a session; null where it has none that can be moved. */
export function joints(session) {
  const { fields = [] } = session.scene.joints ?? {};
  return fields.length && session.canEdit ? { network: () => panel(session, session.scene.joints) } : null;
}

function panel(session, { fields, frames }) {
  const now = () => (session.further.length ? session.further : frames[session.frame]);
  const inPage = (at) => (fields[at].unit === "°" ? radians(1) : 1); // of a unit of the server
  const controls = fields.map((field, at) => {
    const per = inPage(at);
    const own = { ...field, label: field.name, kind: "float", low: field.low / per, high: field.high / per };
    return control(own, now()[at] / per, (value, isDrag) => {
      session.further = now().slice();
      session.further[at] = clamp(value * per, field.low, field.high);
      session.act({ do: "none" }, { isDrag });
    });
  });
  const show = () => controls.forEach((each, at) => each.set(now()[at] / inPage(at)));
  session.on("phase", show);
  const back = button("Reset to this frame", () => session.setFrame(session.frame), { title: "joint values of this frame, or the rest pose" });
  return section("Joints", [...controls.map((each) => each.root), element("div.buttons", back)]);
}
