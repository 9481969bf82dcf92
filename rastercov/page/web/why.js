/** Panel at the right: why a face is covered or not, and the dead zones of the network. */

import { button, count, element, fill, later, percent, section, squareMetres } from "rastercov/dom.js";
import { piecesToShow } from "rastercov/pieces.js";
import { keyOf } from "rastercov/session.js";
import { planeOf } from "rastercov/tools.js";

const ZONES_AFTER = 400; // ms without a change
const MOST_OPEN = 2;
/** Reasons that need no look at figures. */
const UNTELLING = new Set(["covered", "back_facing", "outside"]);
const MOST_ZONES = 60;

export function whyPanel(session, view) {
  const body = element("div.why", { "aria-live": "polite" });
  let asked = 0;
  const show = async () => {
    const { face } = session;
    const turn = ++asked;
    view.highlight(null);
    if (face === null) {
      fill(
        body,
        element(
          "p.soft",
          session.server.isRecorded
            ? "Click a face for its figures."
            : "Click a face to see, for each camera, whether it covers the face, or why not, with the figures; the occluder is striped in the view.",
        ),
      );
      return;
    }
    if (body.dataset.face !== String(face)) fill(body, element("p.soft", "computing…"));
    try {
      const answer = await session.server.why(face);
      if (turn !== asked) return;
      body.dataset.face = face;
      fill(body, answer.levels ? recordedAnswer(session, view, answer) : explain(session, view, answer));
    } catch (error) {
      if (turn === asked) fill(body, element("p.fault", error.message));
    }
  };
  session.on("face", show);
  // A drag asks at its end: the answer measures one face in every camera.
  session.on("idle", () => session.face !== null && show());
  show();
  return body;
}

/** Answer of the server: words, then one card a camera. */
function explain(session, view, answer) {
  // Open are the chosen camera, and the first few that something could be done about.
  const telling = answer.cameras.filter((camera) => !UNTELLING.has(camera.reason)).slice(0, MOST_OPEN);
  const isOpen = (camera) => camera.station === session.chosen || telling.includes(camera);
  return [
    element("p.verdict", answer.words),
    faceFacts(answer.face, answer.group),
    piecesToShow(session, view)
      ? element("p.soft", "Reasons and figures refer to the whole face; the view shows the parts that are not covered.")
      : null,
    flight(view, answer.face),
    answer.cameras.map((camera) => cameraCard(session, view, camera, isOpen(camera))),
  ];
}

function cameraCard(session, view, camera, isOpen) {
  const isCovered = camera.reason === "covered";
  const { figures = [], occluder } = camera;
  const choose = (event) => {
    event.preventDefault();
    session.choose(camera.station);
  };
  const show = (isOn) => view.highlight(isOn ? occluder.group : null);
  const body = occluder
    ? element(
        "button.occluder",
        {
          type: "button",
          title: "highlight the occluder",
          on: {
            pointerenter: () => show(true),
            pointerleave: () => show(false),
            focus: () => show(true),
            blur: () => show(false),
            click: () => {
              const isLeftOut = view.hiddenGroups.has(occluder.group);
              view.hideGroup(occluder.group, false);
              show(isLeftOut || view.highlighted !== occluder.group);
            },
          },
        },
        `Show “${occluder.name}” in the view`,
      )
    : null;
  return element(
    `details.card.${isCovered ? "good" : "not"}`,
    { open: isOpen },
    element(
      "summary",
      button(camera.name, choose, { kind: "link" }),
      element("span", ` ${camera.words}`),
    ),
    body,
    camera.help ? element("p.advice", camera.help) : null,
    figures.length ? tableOf(figures) : null,
  );
}

/** What a static export knows of a face. */
function recordedAnswer(session, view, answer) {
  const group = session.scene.groups[session.faceGroups[answer.face]];
  const { area } = planeOf(view.corners(answer.face));
  return [
    faceFacts(answer.face, group?.name, area),
    tableOf(answer.levels),
    flight(view, answer.face),
  ];
}

const tableOf = (figures) =>
  element(
    "table.figures",
    figures.map(({ label, value }) => element("tr", element("th", { scope: "row" }, label), element("td", value))),
  );

const faceFacts = (face, group, area) =>
  element(
    "p.soft",
    `Face ${count(face)}${group ? ` of “${group}”` : ""}${area ? `, ${squareMetres(area)}` : ""}`,
  );

function flight(view, face) {
  const fly = () => {
    const { centre, normal, area } = planeOf(view.corners(face));
    const reach = 6 * Math.sqrt(area) + 0.02 * view.camera.range;
    view.flyTo(view.camera.placeBefore(centre, normal, reach), face);
  };
  return button("Centre the view on the face", fly, { kind: "link" });
}

/** Dead zones, the largest first; a click flies there. They are asked for while their list is open. */
export function zonesPanel(session, tools) {
  const list = element("ol.zones");
  const note = element("p.soft");
  const root = section("Dead zones", [note, list], { isOpen: false, name: null }); // it begins work
  root.id = "zones";
  root.hidden = session.server.hasZones === false;
  let known = -1;
  const show = async () => {
    if (!root.open || known === keyOf(session.state)) return;
    const key = keyOf(session.state);
    note.textContent = "computing…";
    try {
      const zones = await session.server.zones();
      if (key !== keyOf(session.state)) return;
      known = key;
      note.textContent = zones.length ? "Percentages refer to the evaluated area." : "None: everything is covered.";
      fill(
        list,
        zones.slice(0, MOST_ZONES).map((zone) => zoneRow(zone, tools)),
      );
      if (zones.length > MOST_ZONES) note.textContent += ` These are the ${MOST_ZONES} largest zones.`;
    } catch (error) {
      note.textContent = error.message;
    }
  };
  root.addEventListener("toggle", show);
  session.on("idle", later(show, ZONES_AFTER));
  return root;
}

const zoneRow = (zone, tools) =>
  element(
    "li",
    button(
      [
        element("strong", percent(zone.percent)),
        element("span", `${squareMetres(zone.area)} of ${zone.group}: ${zone.words.split(": ").at(-1)}`),
      ],
      () => tools.showZone(zone),
      { kind: "zone", title: `fly to the ${zone.words}` },
    ),
  );
