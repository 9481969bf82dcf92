/** Panel "Object": the mesh, its groups, its segments, and the constraints of the plan. */

import { check, count, element, metres, section } from "rastercov/dom.js";
import { hasConstraints } from "rastercov/constraints.js";
import { modeList } from "rastercov/modes.js";

const ROLES = { task: "evaluated", occluder: "occluder", target: "target" };

export function objectPanel(session, view, shown) {
  const { scene } = session;
  const sides = [0, 1, 2].map((axis) => metres(scene.bounds[1][axis] - scene.bounds[0][axis]));
  const facts = element(
    "dl.facts",
    element("dt", "Faces"),
    element("dd", count(scene.n_faces)),
    element("dt", "Vertices"),
    element("dd", count(scene.n_vertices)),
    element("dt", "Size"),
    element("dd", sizeOf(sides)),
    scene.result ? [element("dt", "Result"), element("dd", scene.result.words)] : null,
  );
  const groups = scene.groups.map((group, at) =>
    element(
      "li",
      check(
        group.name || `group ${at}`,
        true,
        (isOn) => view.hideGroup(at, !isOn),
        { title: "show or hide" },
      ),
      element("span.soft", `${ROLES[group.role] ?? group.role}, ${count(group.faces)} faces`),
    ),
  );
  const listed = section("Groups", [element("ul.plain", groups)]);
  session.on("groups", () => {
    listed.open = true;
    groups.forEach((row, at) => (row.querySelector("input").checked = !view.hiddenGroups.has(at)));
  });
  const modes = modeList(session, "object");
  return element(
    "div",
    section(scene.title, [facts], { name: "facts" }),
    listed,
    modes ? section("Segmentation", [modes]) : null,
    hasConstraints(scene.constraints)
      ? section("Constraints", constraintControls(session, view, shown))
      : null,
  );
}

/** Lengths with their unit once, where all have one. */
function sizeOf(sides) {
  const [unit, ...others] = new Set(sides.map((each) => each.split(" ")[1]));
  return others.length ? sides.join(" × ") : `${sides.map(parseFloat).join(" × ")} ${unit}`;
}

function constraintControls(session, view, shown) {
  const { constraints } = session.scene;
  const kept = check("Enforce the constraints of the plan", constraints.is_kept, (isKept) => {
    session.act({ do: "constraints", is_kept: isKept });
  });
  kept.hidden = !session.canEdit;
  session.on("state", (state) => {
    const isKept = state.is_kept ?? constraints.is_kept;
    kept.querySelector("input").checked = isKept;
  });
  const words = [
    constraints.boxes?.length ? `mounting boxes (green): ${constraints.boxes.length}` : "",
    ...(constraints.keep_out ?? []).map((part) => `keep-out “${part.name}” (red)`),
  ].filter(Boolean);
  return [
    check("Show the constraints", shown.constraints, (isOn) => {
      shown.constraints = isOn;
      view.request();
    }),
    kept,
    element(
      "ul.plain.soft",
      words.map((text) => element("li", text)),
    ),
  ];
}
