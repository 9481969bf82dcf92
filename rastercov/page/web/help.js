/** Overlay with keys and mouse, and the listener of the keys. */

import { button, element } from "rastercov/dom.js";

const [EDITS, STILL] = [true, false]; // of a row of pages with editing, and without
const KEYS = [
  [
    "Mouse",
    [
      ["drag", "orbit (floor plan: pan)"],
      ["right drag, middle drag, Shift + drag", "pan"],
      ["wheel", "zoom towards the pointer"],
      ["double click", "fly to the point"],
      ["click on a face", "why it is covered or not"],
      ["click on a camera or its name", "select it"],
      ["drag an arrow, a ring or the square", "move or rotate the selected camera; Ctrl: 15° steps; Esc: undo the drag", EDITS],
    ],
  ],
  [
    "Keys in the 3-D view",
    [
      ["arrows, Page Up, Page Down", "move the selected camera (Shift: fine steps); without one, orbit", EDITS],
      ["arrows", "orbit", STILL],
      ["Alt + arrows, Alt + Page Up, Page Down", "rotate and roll the selected camera", EDITS],
      ["W S A D, Q E", "walk; down and up"],
      ["+ −", "zoom"],
      ["F", "fit the scene"],
      ["P", "floor plan"],
      ["K", "section"],
      ["L", "look through the selected camera"],
      ["Delete", "delete the selected camera", EDITS],
      ["Enter", "inspect the face at the centre of the view; while aiming or measuring, pick it"],
      ["N, Shift + N", "next, previous camera"],
      ["I", "aim at a point: click it, or press Enter", EDITS],
      ["R", "measure: click two points, or press Enter"],
      ["C, G", "show or hide cameras, handles"],
      ["X", "handles along camera or world axes", EDITS],
      ["T, B", "transparent occluders, back-face culling"],
      ["O, H", "edge lines, unshaded colours"],
      ["Esc", "end a drag or a tool, then clear the selection"],
    ],
  ],
  [
    "Everywhere",
    [
      ["Ctrl + Z, Ctrl + Shift + Z", "undo, redo", EDITS],
      ["Ctrl + S, Ctrl + Shift + S", "save the rig, download the page", EDITS],
      ["Ctrl + D", "duplicate the selected camera", EDITS],
      ["1 to 4", "show a panel"],
      ["M", "next colour mode"],
      ["?", "this help"],
    ],
  ],
];

/** The overlay, with sections of features. */
export function helpOverlay(more, canEdit) {
  const dialog = element("dialog.help", { "aria-label": "Keys and mouse" });
  dialog.append(
    element(
      "header",
      element("h2", "Keys and mouse"),
      button("Close", () => dialog.close()),
    ),
    element(
      "div.columns",
      [...KEYS, ...more].map(([title, rows]) =>
        element(
          "section",
          element("h3", title),
          element(
            "dl",
            rows.filter(([, , own = canEdit]) => own === canEdit).map(([key, words]) => [element("dt", key), element("dd", words)]),
          ),
        ),
      ),
    ),
  );
  dialog.show = () => dialog.showModal();
  return dialog;
}

/**
 * Listens to keys: those of the page everywhere except where text is typed, those of the picture while
 * it has the focus, so that arrows on a slider move the slider alone.
 *
 * @param {object} parts session, view, navigation, gizmo, tools, bar (the tools), tabs, help
 */
export function listenToKeys({ session, view, navigation, gizmo, tools, bar, tabs, help }) {
  document.addEventListener("keydown", (event) => {
    if (document.querySelector("dialog[open]")) return;
    const target = event.target;
    const isTyping = target.matches?.(
      "input:not([type=checkbox]):not([type=radio]):not([type=range]), textarea, select",
    );
    if (event.ctrlKey || event.metaKey) {
      const isText = isTyping && !target.matches(".of-rig, select"); // which undo by themselves
      if (control(event, session, isText)) event.preventDefault();
      return;
    }
    if (isTyping || target.closest?.("[role=tablist]")) return;
    // Without any focus keys are meant for the picture, too.
    const isTool = event.key !== "Enter" && target.closest?.(".tools"); // a button that was clicked
    const isPicture = target === view.canvas || target === document.body || isTool;
    const isUsed = isPicture ? pictureKey(event, { session, view, navigation, gizmo, tools, bar }) : false;
    if (isUsed) view.canvas.classList.remove("by-mouse");
    if (isUsed || pageKey(event, { session, tabs, help, tools, navigation, isPicture }))
      event.preventDefault();
  });
  document.addEventListener("keyup", () => gizmo.endKeys());
  window.addEventListener("blur", () => gizmo.endKeys());
}

function control(event, session, isText) {
  if (!session.canEdit) return false;
  const key = event.key.toLowerCase();
  if (key === "s") {
    if (event.target.matches("input")) event.target.blur(); // what is typed is taken first
    session.refresh().then(event.shiftKey ? session.downloadPage : session.saveRig);
  } else if (isText) return false;
  else if (key === "z") session.act({ do: event.shiftKey ? "redo" : "undo" });
  else if (key === "y") session.act({ do: "redo" });
  else if (key === "d" && session.station()) session.act({ do: "duplicate", station: session.chosen });
  else return false;
  return true;
}

function pageKey(event, { session, tabs, help, tools, navigation }) {
  if (event.key === "?") help.show();
  else if (/^[1-4]$/.test(event.key)) tabs.show(Number(event.key) - 1);
  else if (session.features.some((each) => each.key?.(event))) return true;
  else if (event.key.toLowerCase() === "m") nextMode(session, event.shiftKey ? -1 : 1);
  else if (event.key === "Escape") endInnermost(session, tools, navigation);
  else return false;
  return true;
}

function nextMode(session, step) {
  const { modes } = session.scene;
  const at = modes.findIndex((mode) => mode.id === session.mode);
  session.setMode(modes[(at + step + modes.length) % modes.length].id);
}

/** Ends the innermost thing in progress. */
function endInnermost(session, tools, navigation) {
  if (navigation.cancel()) return;
  if (tools.tool !== "pick") tools.set("pick");
  else if (session.face !== null || tools.zone) tools.pickFace(null);
  else session.choose(null);
}

function pictureKey(event, { session, view, navigation, gizmo, tools, bar }) {
  const simple = {
    f: "Fit",
    p: "Floor plan",
    k: "Section",
    r: "Measure",
    i: "Aim",
    c: "Cameras",
    g: "Handles",
    x: "Handles along camera axes",
    t: "Transparent occluders",
    b: "Back-face culling",
    o: "Edge lines",
    h: "Unshaded colours",
  };
  const text = simple[event.key.toLowerCase()];
  if (text) {
    [...bar.querySelectorAll("button")].find((each) => each.textContent === text)?.click();
  } else if (event.key.toLowerCase() === "l") {
    if (session.station()) view.lookThrough(session.station());
  } else if (event.key.toLowerCase() === "n") {
    session.chooseNext(event.shiftKey ? -1 : 1);
  } else if (event.key === "Delete" && session.canEdit && session.station()) {
    session.act({ do: "delete", station: session.chosen });
  } else if (event.key === "Enter") {
    tools.clickMiddle();
  } else {
    return gizmo.key(event) || navigation.key(event);
  }
  return true;
}
