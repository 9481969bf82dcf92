/** Panel "All cameras": all of them together by the model of choice, and the thresholds of the task. */

import { button, element, fill, keepingFocus, section } from "rastercov/dom.js";
import { control } from "rastercov/fields.js";
import { modeList } from "rastercov/modes.js";

export function networkPanel(session) {
  const modes = modeList(session, "network");
  return element(
    "div",
    session.features.map((each) => each.network?.()),
    goals(session),
    section(session.canEdit || session.state.stations.length ? "Coverage by all cameras" : "Colours", [modes]),
    session.canEdit ? thresholds(session) : null,
  );
}

/** What the plan asks of its task and its goals; a goal is shown by its button. Null without any. */
function goals(session) {
  const list = element("ul.goals");
  const root = section("Goals", [list]);
  const row = ({ goal, status, words, asked }) =>
    element(
      `li.${status}`,
      element("strong", status),
      button(words, () => session.setGoal(goal), {
        kind: "link",
        "aria-current": String(goal === (session.state.goal ?? "")),
        disabled: !session.canEdit,
        title: goal ? `show ${goal}` : "show the task",
      }),
      element("span.soft", asked),
    );
  const show = () => {
    const required = session.figures?.summary.required ?? [];
    const isTask = required.some(({ goal }) => !goal);
    const task = isTask ? [] : [{ goal: "", status: "task", words: "the task alone, without the goals", asked: "" }];
    root.hidden = !required.length;
    keepingFocus(list, () => fill(list, [...task, ...required].map(row)));
  };
  session.follow("frame", show);
  return root;
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
    root.hidden = Boolean(state.goal);
    for (const { field, control: made } of controls) made.set(state.task[field.name] ?? null);
    const own = Object.entries(state.needed ?? {});
    note.hidden = !own.length;
    note.textContent = `The plan requires views by group: ${own.map(([name, views]) => `${name} ${views}`).join(", ")}, others 1. A change of Views replaces them.`;
  });
  const note = element("p.soft", { hidden: true });
  const rows = controls.map(({ control: made }) => made.root);
  const root = section("What counts as covered", [note, element("div", rows)]);
  return root;
}
