/** Panel "Network": all cameras together by the model of choice, and the thresholds of the task. */

import { button, element, fill, percent, section } from "rastercov/dom.js";
import { control } from "rastercov/fields.js";
import { modeList } from "rastercov/modes.js";
import { jointsPanel } from "rastercov/time.js";

export function networkPanel(session) {
  const modes = modeList(session, "network");
  return element(
    "div",
    {},
    jointsPanel(session),
    section("All cameras together", [modes, reasons(session)]),
    session.canEdit ? section("What counts as covered", [thresholds(session)]) : null,
    session.canEdit ? section("Exact area", [exactArea(session)]) : null,
  );
}

/** Table of what is not covered, by reason. */
function reasons(session) {
  const table = element("table.reasons");
  const show = () => {
    const because = Object.entries(session.figures?.summary.not_covered_because ?? {});
    const rows = because
      .filter(([, row]) => (row.faces ?? row.m2) > 0)
      .sort((a, b) => b[1].area_percent - a[1].area_percent);
    fill(
      table,
      element("caption", {}, rows.length ? "Not covered, of the area" : ""),
      rows.map(([name, row]) =>
        element(
          "tr",
          {},
          element("th", { scope: "row" }, session.scene.reasons[name]),
          element("td", {}, percent(row.area_percent)),
        ),
      ),
    );
  };
  session.on("frame", show);
  show();
  return table;
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

function exactArea(session) {
  const words = element("p");
  const show = () => {
    const exact = session.figures?.summary.exact_area_percent;
    words.textContent =
      exact === null || exact === undefined
        ? "Faces count wholly or not at all above. The exact area counts each point of the surface."
        : `The cameras cover ${exact.toFixed(2)} % of the area, point by point.`;
  };
  session.on("frame", show);
  show();
  const compute = async () => {
    words.textContent = "computing… (a change of the rig ends it)";
    await session.computePieces();
    show();
  };
  return element(
    "div",
    {},
    words,
    element("div.buttons", {}, button("Compute exact area", compute, { title: "may take a while" })),
  );
}
