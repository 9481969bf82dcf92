/** Panel "One camera": what it sees, what it covers, what is sharp; and its image as large as the window. */

import { blurAt } from "rastercov/frusta.js";
import {
  button,
  choice,
  count,
  cssColour,
  cssHatch,
  element,
  figure,
  fill,
  keepingFocus,
  later,
  metres,
  percent,
  section,
  toggle,
  when,
} from "rastercov/dom.js";
import { inCamera } from "rastercov/maths.js";
import { modeList } from "rastercov/modes.js";
import { keyOf } from "rastercov/session.js";

const IMAGE_SIDE = 720;
const LARGE_SIDE = 2048;
const IMAGE_AFTER = 250; // ms without a change

/** Menu of the cameras; what it chooses is chosen everywhere. */
function stationMenu(session) {
  const root = element("div.field-head.station");
  const show = () => {
    const choices = session.state.stations.map((station) => [station.id, station.name]);
    const menu = choices.length
      ? choice("Camera", choices, session.chosen, (id) => session.choose(id))
      : element("span.soft", "none");
    keepingFocus(root, () => fill(root, element("span.field-label", "Camera"), menu));
  };
  session.follow("state chosen", show);
  return root;
}

/** Facts of the chosen camera and the colours of what it covers alone. */
function coverageSection(session, view) {
  const facts = element("dl.facts");
  const show = () => {
    const station = session.station();
    const head = session.headOf(station?.id);
    const row = session.figures?.summary.by_camera?.find((each) => each.station === station?.id);
    fill(
      facts,
      !station || !row
        ? []
        : [
            element("dt", head ? `${head.name} covers` : "Covers"),
            element("dd", row.area_percent === null ? `${count(row.faces)} faces` : `${percent(row.area_percent)} of the area${when(session)}`),
            row.alone_percent === null ? null : element("dt", "Lost without it"),
            row.alone_percent === null ? null : element("dd", `${percent(row.alone_percent)} of the area`),
          ],
    );
  };
  session.follow("frame chosen", show);
  return section("What it covers", [
    facts,
    modeList(session, "camera"),
    element(
      "div.buttons",
      button("Look through", () => session.station() && view.lookThrough(session.station()), {
        title: "view the scene from this camera (L)",
      }),
    ),
  ]);
}

/** Image of the selected camera, at most `side` pixels long, with its caption, its legend, and a note; `load` asks for it once a state. */
function cameraImage(session, side) {
  const picture = element("img.camera-image", { alt: "image of the selected camera" });
  const caption = element("figcaption");
  const keys = element("ul.keys");
  const note = element("p.soft");
  let asked = "";
  const load = async () => {
    const station = session.station();
    picture.hidden = !station;
    if (!station) return;
    const wanted = `${station.id} ${keyOf(session.state)}`;
    if (wanted === asked) return;
    asked = wanted;
    note.textContent = "drawing…";
    try {
      const { json, payload } = await session.server.image(station.id, side);
      if (asked !== wanted) return;
      URL.revokeObjectURL(picture.src);
      picture.src = URL.createObjectURL(new Blob([payload], { type: "image/png" }));
      picture.alt = `image of ${station.name}: ${json.legend.map((each) => each.label).join(", ")}`;
      caption.textContent = json.title;
      fill(
        keys,
        json.legend.map((each) => element("li", swatch(each), each.label)),
      );
      note.textContent = "";
    } catch (error) {
      asked = "";
      note.textContent = error.message;
    }
  };
  return { picture, caption, keys, note, load };
}

/** Dialog with the image of the selected camera as large as the window, or in its own pixels. */
export function largeImage(session) {
  const { picture, caption, keys, note, load } = cameraImage(session, LARGE_SIDE);
  const own = toggle("Original size", false, (isOn) => dialog.classList.toggle("own-size", isOn), {
    title: "one screen pixel per image pixel",
  });
  const dialog = element(
    "dialog.large",
    { "aria-label": "Image of the selected camera" },
    element(
      "header",
      button("‹", () => session.chooseNext(-1), { title: "previous camera (←)", "aria-label": "previous camera" }),
      button("›", () => session.chooseNext(1), { title: "next camera (→)", "aria-label": "next camera" }),
      caption,
      own,
      button("Close", () => dialog.close()),
    ),
    element("div.frame", picture),
    element("footer", keys, note),
  );
  dialog.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (step) session.chooseNext(step);
  });
  session.on("state chosen", () => dialog.open && load());
  dialog.show = () => {
    dialog.showModal();
    load();
  };
  return dialog;
}

/** Panel of the chosen camera alone. */
export function cameraPanel(session, view, isVisible, large) {
  const { picture, caption, keys, note, load } = cameraImage(session, IMAGE_SIDE);
  const enlarge = button("Enlarge", () => session.station() && large.show(), {
    title: "enlarge the image",
  });
  picture.addEventListener("click", () => large.show());
  const blur = element("p.blur", { "aria-live": "polite" });
  const isRecorded = session.server.isRecorded;
  const show = () => {
    enlarge.disabled = !session.station();
    if (isVisible() && !isRecorded) load();
  };
  const showBlur = () => {
    const station = session.station();
    const point = session.facePoint;
    blur.textContent = "";
    if (!station || !point) return;
    const pose = session.poseOf(station);
    const depth = inCamera(pose, point)[2];
    const diameter = blurAt(session.cameraOf(station), pose, point);
    const at = `Picked point: depth ${metres(depth)}`;
    blur.textContent = diameter === null ? at : `${at}, blur diameter ${figure(diameter)} px`;
  };
  session.on("state chosen frame", later(show, IMAGE_AFTER));
  session.on("state chosen face poses", showBlur);
  const panel = element(
    "div",
    stationMenu(session),
    section("Camera image", [
      isRecorded
        ? element("p.soft", "This file has no images.")
        : [element("figure", picture, caption), element("div.buttons", enlarge)],
      keys,
      note,
      blur,
      isRecorded ? null : element("p.soft", "Click a face in the scene to see the diameter of the blur circle there."),
    ]),
    coverageSection(session, view),
  );
  panel.onShown = show;
  return panel;
}

/** Patch in the colour of a key, striped or hatched where the picture is. */
function swatch({ colour, stripe, hatch }) {
  const made = element("span.swatch");
  const plain = cssColour(colour);
  const other = stripe ? cssColour(stripe) : plain;
  made.style.background = stripe
    ? `repeating-linear-gradient(45deg, ${plain} 0 4px, ${other} 4px 7px)`
    : cssHatch(colour, hatch);
  return made;
}
