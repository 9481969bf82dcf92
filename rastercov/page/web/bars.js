/** Bar at the top (undo, saving, help) and the tools over the picture. */

import { button, choice, element, menu, metres, toggle } from "rastercov/dom.js";
import { offerFile } from "rastercov/status.js";
import { heightOf, sectionOf } from "rastercov/tools.js";

/** A sign that is not read out. */
const sign = (text) => element("span", { "aria-hidden": "true" }, text);

export function topBar(session, { summary, help }) {
  const undo = button([sign("↶"), " Undo"], () => session.act({ do: "undo" }), { title: "Ctrl+Z" });
  const redo = button([sign("↷"), " Redo"], () => session.act({ do: "redo" }), { title: "Ctrl+Shift+Z" });
  const unsaved = element("span.unsaved", { title: "the rig has unsaved changes" });
  const show = (state) => {
    undo.disabled = !state.can_undo;
    redo.disabled = !state.can_redo;
    undo.title = state.can_undo ? `undo: ${state.undo_label} (Ctrl+Z)` : "nothing to undo";
    redo.title = state.can_redo ? `redo: ${state.redo_label} (Ctrl+Shift+Z)` : "nothing to redo";
    unsaved.textContent = state.is_saved === false ? "●" : "";
  };
  session.on("state", show);
  show(session.state);
  return element(
    "header.top",
    element("h1", "rastercov ", element("span.soft", session.scene.title), unsaved),
    session.canEdit ? element("div.group", undo, redo, saveMenu(session)) : null,
    summary,
    button("?", () => help.show(), { title: "keys and mouse (?)", "aria-label": "help" }),
  );
}

const savesOf = ({ isLive }) => [
  ["rig", isLive ? "Save rig, plan and surfaces" : "Save rig", "poses, cameras and thresholds"],
  ["report", "Save report", "page, tables and pictures, to the output folder"],
];
const downloadsOf = ({ isLive }) => [
  ["rig", "Download rig", "rig.json"],
  isLive ? ["task", "Download plan", "plan.toml"] : ["task", "Download thresholds", "task.toml"],
  ["page", "Download page (one file, opens without rastercov)", "rastercov.html"],
];

function saveMenu(session) {
  const save = async (what) => {
    root.open = false;
    if (what === "report") session.emit("notice", "Writing the report…");
    await session.attempt(async () => {
      const { words } = await session.server.save(what);
      session.emit("notice", words);
      session.takeOver();
    });
  };
  const download = async (what, name) => {
    root.open = false;
    await session.attempt(async () => offerFile(name, await session.server.download(what)));
  };
  const canSave = ([what]) => session.server.canSave?.(what) ?? true;
  const copyLink = async () => {
    root.open = false;
    const address = await session.server.link();
    try {
      await navigator.clipboard.writeText(address);
      session.emit("notice", "Link copied. It opens this file with this rig; send the file, too.");
    } catch {
      session.emit("notice", "The link is in the address bar: copy it from there.");
    }
  };
  const root = menu("Save", "Ctrl+S saves the rig, Ctrl+Shift+S downloads the page", [
    savesOf(session.server).filter(canSave).map(([what, text, title]) => button(text, () => save(what), { title })),
    session.server.link ? button("Copy link", copyLink, { title: "the address of this page with the rig in it" }) : null,
    element("hr"),
    downloadsOf(session.server).filter(canSave).map(([what, text, name]) => button(text, () => download(what, name))),
  ]);
  session.saveRig = () => save("rig");
  session.downloadPage = () => download("page", "rastercov.html");
  return root;
}

/** Tools over the picture. */
export function toolBar(session, { view, tools, frusta, gizmo, drawing }) {
  const fit = button("Fit", () => fitAll(session, view), { title: "show the whole scene (F)" });
  const plan = toggle(
    "Floor plan",
    false,
    (isOn) => {
      view.moving();
      view.camera.setPlan(isOn);
      if (isOn) fitAll(session, view);
      cut.setPlan(isOn);
      drawing?.setPlan(isOn);
    },
    { title: "view from above, cut at a height (P)" },
  );
  const cut = sectionControls(session, view);
  const measure = toggle("Measure", false, (isOn) => tools.set(isOn ? "measure" : "pick"), {
    title: "distance between two points (R)",
  });
  const aim = toggle("Aim", false, (isOn) => tools.set(isOn ? "aim" : "pick"), {
    title: "aim the selected camera at a point (I)",
  });
  session.on("tool", (tool) => {
    measure.set(tool === "measure");
    aim.set(tool === "aim");
  });
  const shows = menu("Show", "visible items", [
    toggle("Cameras", true, (isOn) => frusta.setShown(isOn), { title: "frusta and names (C)" }),
    session.canEdit
      ? [
          toggle("Handles", true, (isOn) => gizmo.setShown(isOn), {
            title: "arrows and rings of the selected camera (G)",
          }),
          toggle("Handles along camera axes", false, (isOn) => gizmo.setLocal(isOn), {
            title: "axes of the camera, not of the world (X)",
          }),
        ]
      : null,
    toggle("Depth of field", false, (isOn) => frusta.setFocus(isOn), {
      title: "planes of the depth of field of the selected camera",
    }),
    OPTIONS.map((option) => optionToggle(session, view, ...option)),
  ]);
  const bar = element(
    "div.tools",
    { role: "toolbar", "aria-label": "View" },
    fit,
    shows,
    plan,
    drawing?.menu,
    cut.root,
    measure,
    session.canEdit ? aim : null,
  );
  bar.leavePlan = () => plan.isOn() && plan.set(false, true);
  return bar;
}

const OPTIONS = [
  ["Transparent occluders", "isTransparent", "see through occluders (T)"],
  ["Back-face culling", "isCulled", "look into rooms from outside (B)"],
  ["Exact outlines", "hasPieces", "exact outlines of the uncovered area, while no camera moves"],
  ["Edge lines", "hasEdges", "creases, borders, and edges between groups (O)"],
  ["Unshaded colours", "isFlat", "colours of the legend, without shading (H)"],
];

function optionToggle(session, view, text, name, title) {
  const made = toggle(text, view.options[name], (isOn) => view.setOption(name, isOn), { title });
  session.on("view", () => made.set(view.options[name]));
  return made;
}

/** Whole scene with its cameras in sight; inside a room of its own size that is the room alone. */
export function fitAll(session, view) {
  view.frame(() => view.camera.fit(session.centres(), view.aspect(), view.covered()));
}

/** Controls of the section: axis, place, side. */
function sectionControls(session, view) {
  const cut = { axis: 2, at: 0.6, isFlipped: false };
  let isOn = false;
  let isPlan = false;
  const apply = () => {
    height.textContent = metres(heightOf(cut, session.scene.bounds));
    view.setOption("section", isOn || isPlan ? sectionOf(cut, session.scene.bounds) : null);
  };
  const place = element("input.place", {
    type: "range",
    min: "0",
    max: "1",
    step: "0.005",
    value: "0.6",
    "aria-label": "position of the section",
  });
  place.addEventListener("input", () => {
    cut.at = Number(place.value);
    apply();
  });
  const axis = choice("axis of the section", ["x", "y", "z"].map((name, at) => [at, name]), 2, (value) => {
    cut.axis = value;
    apply();
  });
  const flip = button(
    "⇄",
    () => {
      cut.isFlipped = !cut.isFlipped;
      apply();
    },
    { title: "flip the section", "aria-label": "flip the section" },
  );
  const height = element("output.soft.height");
  const more = element("span.section-controls", { hidden: true }, axis, place, flip, height);
  const main = toggle(
    "Section",
    false,
    (next) => {
      isOn = next;
      more.hidden = !isOn && !isPlan;
      apply();
    },
    { title: "cut the scene open (K)" },
  );
  const setPlan = (next) => {
    isPlan = next;
    if (isPlan) {
      const { up, cut: height, bounds } = session.scene;
      cut.axis = up.map(Math.abs).indexOf(Math.max(...up.map(Math.abs)));
      cut.isFlipped = up[cut.axis] < 0;
      axis.value = String(cut.axis);
      const [low, high] = bounds.map((corner) => corner[cut.axis]);
      cut.at = place.value = (height - low) / (high - low || 1); // in the storey of the task
    }
    axis.hidden = flip.hidden = isPlan;
    more.hidden = !isOn && !isPlan;
    apply();
  };
  return { root: element("span.group", main, more), setPlan };
}
