/** Overlay with keys and mouse, and the listener of the keys. */

import { button, element } from "rastercov/dom.js";

const KEYS = [
  [
    "Mouse",
    [
      ["drag", "turn the view (floor plan: move it)"],
      ["right drag, middle drag, Shift + drag", "move the view"],
      ["wheel", "nearer or farther, towards the pointer"],
      ["double click", "fly to the point"],
      ["click on a face", "why it is covered or not"],
      ["click on a camera or its name", "choose it"],
      ["drag an arrow, a ring, the square", "move or turn the chosen camera; Ctrl: steps of 15°; Esc: back"],
    ],
  ],
  [
    "Keys over the picture",
    [
      ["arrows, Page Up, Page Down", "move the chosen camera (Shift: finely); without one, turn the view"],
      ["Alt + arrows, Alt + Page", "turn and roll the chosen camera"],
      ["W S A D, Q E", "walk, down and up"],
      ["+ −", "nearer, farther"],
      ["F", "show everything"],
      ["P", "floor plan"],
      ["K", "section"],
      ["L", "look through the chosen camera"],
      ["Enter", "ask about the face in the middle of the picture; a click there for aim and measure"],
      ["N, Shift + N", "next, previous camera"],
      ["I", "aim: then click a point, or Enter"],
      ["R", "measure: click two points, or Enter"],
      ["C, G", "show or hide cameras, handles"],
      ["X", "handles along the camera or the world"],
      ["T, B", "transparent occluders, faces turned away"],
      ["O, H", "lines along edges, flat colours"],
      ["Esc", "end a drag or a tool, then let go of the face and the camera"],
    ],
  ],
  [
    "Everywhere",
    [
      ["Ctrl + Z, Ctrl + Shift + Z", "undo, redo"],
      ["Ctrl + S, Ctrl + Shift + S", "save the rig, download the page"],
      ["Ctrl + D", "duplicate the chosen camera"],
      ["Delete", "delete the chosen camera (over the picture)"],
      [", and .", "frame before, after"],
      ["Space over the picture", "play, stop"],
      ["1 to 4", "panels"],
      ["M", "next colours"],
      ["?", "this help"],
    ],
  ],
];

export function helpOverlay() {
  const dialog = element("dialog.help", { "aria-label": "Keys and mouse" });
  dialog.append(
    element(
      "header",
      {},
      element("h2", {}, "Keys and mouse"),
      button("Close", () => dialog.close()),
    ),
    element(
      "div.columns",
      {},
      KEYS.map(([title, rows]) =>
        element(
          "section",
          {},
          element("h3", {}, title),
          element(
            "dl",
            {},
            rows.map(([key, words]) => [element("dt", {}, key), element("dd", {}, words)]),
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

const STEPS = { ",": -1, ".": 1 };

function pageKey(event, { session, tabs, help, tools, navigation }) {
  if (event.key === "?") help.show();
  else if (/^[1-4]$/.test(event.key)) tabs.show(Number(event.key) - 1);
  else if (event.key in STEPS && session.scene.motion) session.stepFrame(STEPS[event.key]);
  else if (event.key.toLowerCase() === "m") nextMode(session, event.shiftKey ? -1 : 1);
  else if (event.key === "Escape") escape(session, tools, navigation);
  else return false;
  return true;
}

function nextMode(session, step) {
  const { modes } = session.scene;
  const at = modes.findIndex((mode) => mode.id === session.mode);
  session.setMode(modes[(at + step + modes.length) % modes.length].id);
}

/** Ends the innermost thing in progress. */
function escape(session, tools, navigation) {
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
    x: "Handles along the camera",
    t: "Transparent occluders",
    b: "Leave out faces turned away",
    o: "Lines along edges",
    h: "Flat colours",
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
  } else if (event.key === " " && event.target === view.canvas && session.play) {
    session.play();
  } else {
    return gizmo.key(event) || navigation.key(event);
  }
  return true;
}
