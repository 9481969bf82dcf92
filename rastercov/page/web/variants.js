/** Section of the panel "Cameras": variants of the rig side by side, with coverage and cost. */

import { button, coverageText, element, figure, fill, percent, section } from "rastercov/dom.js";

export function variantsSection(session) {
  const table = element("table.variants");
  const note = element("p.soft");
  const name = element("input.text", { type: "text", "aria-label": "Name of the variant", maxlength: "60" });
  const keep = async () => {
    const done = await session.act({ do: "keep_variant", name: name.value.trim() || free(session) });
    if (done) name.value = "";
  };
  name.addEventListener("keydown", (event) => event.key === "Enter" && keep());
  const keeping = button("Keep as variant", keep, { title: "the rig and the thresholds as they are now" });
  const show = () => {
    const { stations, heads, variants = [] } = session.state;
    const summary = session.figures?.summary ?? {};
    const present = {
      name: "current rig",
      cameras: (heads ?? stations).filter((each) => each.counts ?? each.is_on).length,
      ...summary,
      is_of_task: true,
    };
    const isKept = variants.some((each) => each.is_shown);
    const rows = isKept || !variants.length ? variants : [present, ...variants];
    keeping.disabled = isKept || !stations.length;
    name.disabled = keeping.disabled;
    name.placeholder = keeping.disabled ? "" : free(session);
    fill(table, rows.length ? tableOf(session, rows) : []);
    note.textContent = variants.some((each) => !each.is_of_task)
      ? "* evaluated with the thresholds of that variant; showing the variant restores them."
      : variants.length
        ? ""
        : "Keep the rig as a variant, change it, and compare.";
  };
  session.follow("state frame", show);
  return section("Variants", [table, note, element("div.buttons.keep", name, keeping)]);
}

/** First letter that no variant has as its name. */
function free(session) {
  const taken = new Set((session.state.variants ?? []).map((each) => each.name));
  for (let number = 0; ; number++) {
    const name = `variant ${number < 26 ? String.fromCharCode(65 + number) : number}`;
    if (!taken.has(name)) return name;
  }
}

function tableOf(session, rows) {
  const columns = [
    [session.state.heads?.some(({ ids }) => ids.length > 1) ? "heads" : "cameras", "those that are on", (row) => String(row.cameras)],
    ["covers", "of the evaluated area", (row) => percent(coverageText(row)) + (row.is_of_task ? "" : "*")],
    ["cost", "total cost; each camera costs as much as the nearest candidate of the plan", (row) => figure(row.cost, 4), "cost"],
  ].filter(([, , , key]) => !key || rows.some((row) => typeof row[key] === "number"));
  const best = Math.max(...rows.map((row) => coverageText(row) ?? 0));
  return [
    element(
      "thead",
      element(
        "tr",
        element("th", { scope: "col" }, "Variant"),
        columns.map(([text, title]) => element("th", { scope: "col", title }, text)),
        element("td"),
      ),
    ),
    element("tbody", rows.map((row) => rowOf(session, row, columns, best))),
  ];
}

function rowOf(session, row, columns, best) {
  const isKept = "is_shown" in row;
  const name = isKept
    ? button(row.name, () => session.act({ do: "show_variant", name: row.name }), {
        kind: "link",
        title: "show this variant",
        "aria-current": String(row.is_shown),
      })
    : row.name;
  const drop = button("×", () => session.act({ do: "drop_variant", name: row.name }), {
    kind: "quiet",
    title: `drop ${row.name}`,
    "aria-label": `drop ${row.name}`,
  });
  return element(
    row.is_shown ?? true ? "tr.chosen" : "tr",
    element("th", { scope: "row" }, name),
    columns.map(([text, , value]) =>
      element(text === "covers" && coverageText(row) === best ? "td.best" : "td", value(row)),
    ),
    element("td", isKept ? drop : null),
  );
}
