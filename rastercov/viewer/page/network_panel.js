/** Panel "Network": all cameras together by the model of choice, and the thresholds of the task. */

import { element, section } from "rastercov/dom.js";
import { control } from "rastercov/fields.js";
import { modeList } from "rastercov/modes.js";
import { jointsPanel } from "rastercov/time.js";

export function networkPanel(session) {
  const modes = modeList(session, "network");
  return element(
    "div",
    {},
    jointsPanel(session),
    section("All cameras together", [modes]),
    session.canEdit ? section("What counts as covered", [thresholds(session)]) : null,
  );
}

/** Sliders of the task. */
function thresholds(session) {
  const { task_fields: fields, levels } = session.scene;
  const presets = { min_facing_density: levels };
  const controls = fields.map((field) => ({
    field,
    control: control({ ...field, presets: presets[field.name] }, session.state.task[field.name] ?? null, (value, isDrag) => {
      session.act({ do: "task", changes: { [field.name]: value } }, { isDrag });
    }),
  }));
  session.on("state", (state) => {
    for (const { field, control: made } of controls) made.set(state.task[field.name] ?? null);
  });
  return element(
    "div",
    {},
    controls.map(({ control: made }) => made.root),
  );
}
