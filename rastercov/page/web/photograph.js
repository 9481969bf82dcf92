/**
 * Photograph of an installed camera beside the model: pairs of a pixel and a corner, for `locate --points`.
 *
 * A click in the photograph takes a pixel, the next one in the scene the corner nearest to it on the
 * screen. The pairs are saved as a CSV file: u, v (px from the top-left corner), x, y, z (m).
 */

import { button, element, fileButton, fill, section, toggle } from "rastercov/dom.js";
import { offerFile } from "rastercov/status.js";

const LEAST = 4;
const MARK = [0.95, 0.25, 0.85, 1];

/** Photographs of a session; null where its cameras cannot be changed. */
export function photograph(session) {
  return session.canEdit ? { side: (page) => panel(session, page) } : null;
}

function panel(session, { view, tools }) {
  let pairs = []; // {pixel, corner}; the last one may have no corner yet
  const picture = element("img.camera-image", { alt: "photograph" });
  const marks = element("div.marks");
  const sheet = element("div.sheet", { hidden: true }, element("div.photograph", picture, marks));
  const note = element("p.soft", { role: "status" });
  const whole = () => pairs.filter((pair) => pair.corner);
  const drop = button("Undo point", () => (pairs.pop(), show()));
  const save = button("Save points", () => offerFile("points.csv", csvOf(whole()), "text/csv"), {
    title: "points.csv, for rastercov locate --points",
  });
  const show = (refusal = "") => {
    sheet.hidden = refusal;
    fill(marks, pairs.map(({ pixel: [u, v] }, at) => {
      const mark = element("span.mark", String(at + 1));
      mark.style.left = `${(100 * u) / picture.naturalWidth}%`;
      mark.style.top = `${(100 * v) / picture.naturalHeight}%`;
      return mark;
    }));
    const isOpen = pairs.length > whole().length;
    drop.disabled = !pairs.length;
    save.disabled = whole().length < LEAST;
    note.textContent =
      refusal ||
      (isOpen
        ? `Now click corner ${pairs.length} in the scene.`
        : `${whole().length} of at least ${LEAST} points; eight are better. Click a corner in the photograph.`);
    view.request();
  };
  const open = (file) => {
    URL.revokeObjectURL(picture.src);
    picture.src = URL.createObjectURL(file);
    pairs = [];
  };
  picture.addEventListener("error", () => show("Expected a photograph, got a file that is none."));
  picture.addEventListener("load", () => {
    const station = session.station();
    const { width, height } = station ? session.cameraOf(station) : {};
    const size = `${picture.naturalWidth} x ${picture.naturalHeight} px`;
    const isOther = station && size !== `${width} x ${height} px`;
    show(isOther ? `Expected ${width} x ${height} px as ${station.name}, got ${size}; choose its camera first.` : "");
  });
  picture.addEventListener("click", ({ offsetX, offsetY }) => {
    const scale = picture.naturalWidth / picture.clientWidth;
    pairs = [...whole(), { pixel: [offsetX * scale, offsetY * scale] }];
    tools.set("corner");
    show();
  });
  tools.add("corner", (x, y) => {
    const found = view.pick(x, y);
    const { toScreen } = view.look();
    const away = (corner) => Math.hypot(toScreen(corner)[0] - x, toScreen(corner)[1] - y);
    if (!found) session.emit("notice", "Click on a corner of the model, or press Esc.");
    else if (pairs.length > whole().length) {
      pairs.at(-1).corner = view.corners(found.face).reduce((best, each) => (away(each) < away(best) ? each : best));
      tools.set("pick");
      show();
    }
    return true;
  });
  view.onSketch((sketch, look) => {
    for (const { corner } of whole()) sketch.cross(corner, look, MARK);
  }, { isOnTop: true });
  return section(
    "Photograph",
    [
      element(
        "div.buttons",
        fileButton("Open photograph", "image/*", open),
        toggle("Original size", false, (isOn) => sheet.classList.toggle("own-size", isOn)),
      ),
      sheet,
      note,
      element("div.buttons", drop, save),
    ],
    { isOpen: false },
  );
}

const csvOf = (pairs) =>
  ["u,v,x,y,z", ...pairs.map(({ pixel, corner }) => [...pixel, ...corner].join(",")), ""].join("\n");
