/** Panel "Cameras": the rig, and of the chosen camera its pose, its lens and what can be done with it. */

import { button, choice, count, element, fileButton, fill, keepingFocus, metres, percent, section, inUnit, when } from "rastercov/dom.js";
import { FILES, openCameras } from "rastercov/camera_files.js";
import { finder } from "rastercov/finder.js";
import { anglesOf, centreOf, distance, poseFromAngles, scale } from "rastercov/maths.js";
import { variantsSection } from "rastercov/variants.js";
import { control, labelOf, numberBox, ofRig } from "rastercov/fields.js";

export function camerasPanel(session, { view, tools, jobs }) {
  const list = element("div.cameras", { role: "group", "aria-label": "Cameras" });
  const showList = () => keepingFocus(list, () => fill(list, stationRows(session)));
  session.follow("state frame chosen", showList);
  const panel = element(
    "div",
    section("Rig", [list, session.canEdit ? rigButtons(session, view, jobs) : null]),
    devicesSection(session),
  );
  if (session.canEdit) {
    panel.append(variantsSection(session), poseSection(session, { view, tools, jobs }), typeSection(session));
  }
  return panel;
}

/** Devices beside the cameras, which are chosen here as in the picture; null where there are none. */
function devicesSection(session) {
  if (!session.state.devices.length) return null;
  const { group } = session.state.devices[0];
  const list = element("div.cameras", { role: "group", "aria-label": group });
  const show = () => keepingFocus(list, () => fill(list, session.state.devices.map((device) => {
    const isChosen = device.id === session.chosen;
    const name = chooser(session, device, { disabled: !device.pose });
    const words = device.pose ? device.words : `${device.words}, on the rig`;
    return element(isChosen ? "div.row.device.chosen" : "div.row.device", element("span.who", name), element("span.soft", words));
  })));
  session.follow("state chosen", show);
  return section(group, [list]);
}

/** One row a camera: on or off, name, what it covers, and what it alone covers; of sensors of a head its row has that. */
function stationRows(session) {
  const shares = new Map((session.figures?.summary.by_camera ?? []).map((row) => [row.station, row]));
  const covers = (row) => (row && row.area_percent === null ? count(row.faces) : percent(row?.area_percent));
  const isAloneKnown = [...shares.values()].some((row) => row.alone_percent !== null);
  const alone = (row) => (isAloneKnown ? percent(row?.alone_percent) : "");
  const areFaces = [...shares.values()].some((row) => row.area_percent === null);
  const head = element(
    "div.row.head",
    element("span"),
    element("span", "Name"),
    areFaces
      ? element("span", { title: "whole faces that this camera covers" }, "faces")
      : element("span", { title: `share of the area that this camera covers${when(session)}` }, "covers"),
    element("span", { title: "share of the area lost without this camera" }, isAloneKnown ? "lost without" : ""),
  );
  const figuresOf = (share) => [element("span.figure", covers(share)), element("span.figure", alone(share))];
  const rows = session.state.stations.flatMap((station) => {
    const share = shares.get(station.id);
    const head = session.headOf(station.id);
    const isFirst = head?.ids[0] === station.id;
    const ofHead = isFirst ? [element("div.row.of-head", element("span"), element("span.who", head.name), figuresOf(share))] : [];
    const isChosen = station.id === session.chosen;
    const box = element("input", {
      type: "checkbox",
      checked: station.is_on,
      disabled: !session.canEdit,
      "aria-label": `use ${station.name}`,
    });
    box.addEventListener("change", () =>
      session.act({ do: "switch", station: station.id, is_on: box.checked }),
    );
    const name = chooser(session, station);
    const place = isAllowed(station) ? null : element("span.bad", { title: placeWords(station), role: "img", "aria-label": placeWords(station) }, "⚠");
    const own = element(
      isChosen ? "div.row.chosen" : "div.row",
      box,
      element("span.who", name, place),
      head ? [] : figuresOf(share),
    );
    return [...ofHead, own];
  });
  return rows.length ? [head, rows] : [element("p.soft.empty", "No camera yet.")];
}

const chooser = (session, { id, name }, more = {}) =>
  button(name, () => session.choose(id), { kind: "link", "aria-current": String(id === session.chosen), ...more });

const isAllowed = (station) => !station.place || station.place === "allowed";
const placeWords = (station) =>
  `${station.name} violates the constraints of the plan: ${station.place}`;

/** Type of a further camera. */
export const typeOfNext = (session) => {
  const { cameras } = session.state;
  const chosen = session.station()?.camera ?? session.typeOfNext;
  return chosen in cameras ? chosen : Object.keys(cameras)[0];
};

/** Adds a camera with the pose of the current view. */
export function addHere(session, view) {
  session.act({ do: "add", camera: typeOfNext(session), pose: view.camera.pose() });
}

/** Adds the candidate that covers most of what is not covered. */
export function addNext(session, jobs) {
  return jobs.start({ kind: "add", camera: typeOfNext(session) });
}

function rigButtons(session, view, jobs) {
  const remove = button("Delete", () => session.act({ do: "delete", station: session.chosen }), {
    title: "delete the selected camera (Del)",
  });
  const copy = button("Duplicate", () => session.act({ do: "duplicate", station: session.chosen }), {
    title: "a second camera at the same pose (Ctrl+D)",
  });
  const best = button("Add the best next camera", () => addNext(session, jobs), {
    title: "find the candidate that adds the most coverage",
    kind: "primary",
  });
  const show = () => {
    remove.disabled = copy.disabled = !session.station();
  };
  session.follow("chosen state", show);
  return element(
    "div.buttons",
    button("Add here", () => addHere(session, view), { title: "a camera with the pose of the current view" }),
    copy,
    remove,
    best,
  );
}

function poseSection(session, { view, tools, jobs }) {
  const { up } = session.scene;
  const name = element("input.text", { type: "text", "aria-label": "Name of the camera", maxlength: "80" });
  const writeName = ofRig(name, (text) => {
    if (text.trim()) session.act({ do: "rename", station: session.chosen, name: text.trim() });
    return Boolean(text.trim());
  });
  const [low, high] = session.scene.bounds;
  const size = distance(low, high);
  const perField = inUnit("m") === "m" && size < 1 ? 1000 : 1; // millimetres of a small part
  const lengths = perField > 1 ? "mm" : inUnit("m");
  const decimals = Math.max(0, 4 - Math.round(Math.log10(perField * size)));
  const values = () => {
    const pose = session.poseOf(session.station());
    const [x, y, z] = scale(centreOf(pose), perField);
    const { heading, elevation, roll } = anglesOf(pose, up);
    return { x, y, z, heading, tilt: -elevation, roll };
  };
  const fields = [
    ...["x", "y", "z"].map((key) => [key, lengths]),
    ...["heading", "tilt", "roll"].map((key) => [key, "°"]),
  ].map(([key, unit]) => {
    const limits =
      key === "tilt" ? { low: -90, high: 90 } : key.length > 1 ? { low: -360, high: 360 } : {};
    const box = numberBox({ label: labelOf(key), value: 0, unit, ...limits }, (value) => {
      const next = { ...values(), [key]: value };
      const centre = scale([next.x, next.y, next.z], 1 / perField);
      session.act({
        do: "pose",
        station: session.chosen,
        pose: poseFromAngles(next.heading, -next.tilt, next.roll, up, centre),
      });
    });
    return {
      key,
      box,
      root: element(
        "label.pose-field",
        element("span", labelOf(key)),
        box.input,
        element("span.unit", unit),
      ),
    };
  });
  const warning = element("p.bad");
  const body = element(
    "div",
    name,
    element(
      "div.pose",
      fields.map((field) => field.root),
    ),
    fields.map((field) => field.box.fault),
    warning,
    element(
      "div.buttons",
      button("Aim", () => tools.set("aim"), { title: "click it, then the point to look at (I)" }),
      button("Look through", () => view.lookThrough(session.station()), {
        title: "view the scene from this camera (L)",
      }),
      button("Refine this camera", () => jobs.start({ kind: "refine", station: session.chosen }), {
        title: "optimise its pose for the coverage of the rig",
        kind: "primary",
      }),
    ),
    element(
      "p.soft",
      "Heading is counter-clockwise from +x (seen from above), tilt is down from level, roll is clockwise along the view. Drag the arrows and rings in the view, or press the arrow keys.",
    ),
  );
  const root = section("Selected camera", [body]);
  const show = () => {
    const station = session.station();
    root.hidden = !station;
    if (!station) return;
    writeName(station.name);
    warning.textContent = isAllowed(station) ? "" : `Its position violates the constraints of the plan: ${station.place}.`;
    const now = values();
    // Typed poses keep all digits of what is not typed; these are for reading.
    for (const { key, box } of fields) box.set(Number(now[key].toFixed(key.length > 1 ? 2 : decimals)) + 0); // -0 is 0
  };
  session.follow("state chosen poses", show);
  return root;
}

function typeSection(session) {
  const body = element("div");
  let made = null;
  /** Gives a camera of the rig or of the catalogue to the chosen station, or to the next one. */
  const use = async (camera) => {
    if (session.station()) session.act({ do: "use", station: session.chosen, camera });
    else {
      const isNew = !(camera in session.state.cameras);
      if (isNew && !(await session.act({ do: "new_camera", name: camera, source: camera }))) return;
      session.typeOfNext = camera;
      show();
    }
  };
  const sold = finder("Search the camera catalogue", session.scene.catalogue, use);
  const root = section("Camera type", [body]);
  const build = (station, type) => {
    const camera = session.state.cameras[type];
    const controls = !station
      ? []
      : session.scene.camera_fields
          .filter((field) => isApplicable(field.name, camera))
          .map((field) => {
            const change = (value, isDrag) =>
              session.act({ do: "camera", camera: type, changes: { [field.name]: value } }, { isDrag });
            const kind = field.kind ?? (["width", "height"].includes(field.name) ? "int" : "float");
            return { field, control: control({ ...field, kind }, camera[field.name], change) };
          });
    const menu = choice(
      "Type",
      Object.keys(session.state.cameras).map((name) => [name, name]),
      type,
      use,
    );
    const shared = session.state.stations.filter((each) => each.camera === type).length;
    fill(
      body,
      element("label.field-head", element("span.field-label", station ? "Type" : "Type of the next camera"), menu),
      sold,
      fileButton("Open a rig, plan or camera…", FILES, (...files) => openCameras(session, files), true),
      focusWords(camera),
      shared > 1 && station ? element("p.soft", `${shared} cameras use this type; a change affects all of them.`) : null,
      controls.map((each) => each.control.root),
      station ? button("Copy this type", () => copyType(session, type), { title: "copy the type for the selected camera only" }) : null,
    );
    return { key: keyOf(station, type), controls };
  };
  const keyOf = (station, type) =>
    `${station?.id} ${type} ${Object.keys(session.state.cameras)} ` +
    session.state.stations.filter((each) => each.camera === type).length;
  const show = () => {
    const station = session.station();
    const type = station?.camera ?? typeOfNext(session);
    const camera = session.state.cameras[type];
    if (made?.key !== keyOf(station, type)) made = build(station, type);
    for (const each of made.controls) each.control.set(camera[each.field.name]);
    body.querySelector(".focus-words")?.replaceWith(focusWords(camera));
  };
  session.follow("state chosen", show);
  return root;
}

/** Makes a copy of a type, and gives it to the chosen camera. */
async function copyType(session, source) {
  let name = source;
  for (let at = 2; name in session.state.cameras; at++) name = `${source} ${at}`;
  const done = await session.act({ do: "new_camera", name, source });
  if (done) session.act({ do: "use", station: session.chosen, camera: name });
}

/** Whether a lens has a value to change: focus by an aperture, or by depths that are known. */
function isApplicable(name, camera) {
  if (["focus_distance", "f_number"].includes(name)) return camera.can_focus;
  if (["focus_near", "focus_far"].includes(name)) return !camera.can_focus || camera[name] !== null;
  return name in camera && camera[name] !== null;
}

/** Line about the lens: model, size, depth of field. */
function focusWords(camera) {
  const sharp = camera.depth_of_field;
  const far = sharp && (sharp[1] === null ? "infinity" : metres(sharp[1]));
  const words =
    `${camera.model}, ${camera.width} × ${camera.height} px` +
    (sharp ? `, in focus from ${metres(sharp[0])} to ${far}` : ", in focus everywhere");
  return element("p.soft.focus-words", words);
}
