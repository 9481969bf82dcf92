/** Card over an empty rig: the ways to its first cameras. */

import { button, element } from "rastercov/dom.js";
import { fitAll } from "rastercov/bars.js";
import { addHere, addNext, typeOfNext } from "rastercov/cameras_panel.js";

export function startCard(session, view, jobs) {
  const { placement } = session.scene;
  const number = element("input.number", {
    type: "number",
    min: "1",
    max: "500",
    value: String(placement?.cameras ?? ""),
    "aria-label": "Cameras to place",
  });
  const hasNumber = Boolean(placement?.cameras);
  const place = async () => {
    if (hasNumber && !number.reportValidity()) return;
    const cameras = hasNumber ? Number(number.value) || null : null;
    await jobs.start({ kind: "place", cameras, camera: typeOfNext(session) });
    fitAll(session, view); // with the cameras in sight
  };
  const addBest = async () => {
    await addNext(session, jobs);
    fitAll(session, view);
  };
  number.addEventListener("keydown", (event) => event.key === "Enter" && place());
  const root = element(
    "section.start",
    { "aria-label": "First cameras" },
    element("h2", "No camera yet"),
    way(
      placement &&
        element(
          "span.group",
          button("Place", place, { kind: "primary" }),
          hasNumber ? number : null,
          hasNumber ? "cameras" : "cameras as the plan specifies",
        ),
      placement?.words,
    ),
    way(
      button("Add the best one", addBest),
      placement?.is_by_plan ? "the candidate of the plan with the largest gain" : `the best of ${placement?.tries ?? 120} poses`,
    ),
    way(
      button("Add one here", () => addHere(session, view)),
      "at the current view; move it with the arrows and rings",
    ),
  );
  const show = () => {
    root.hidden = !session.canEdit || session.state.stations.length > 0 || jobs.isRunning;
  };
  session.follow("state job", show);
  return root;
}

const way = (control, words) => element("div.way", control, element("p.soft", words));
