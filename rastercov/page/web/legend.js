/** Legend of the colours, with the menu of what they mean, and the summary of the coverage. */

import { UNITS } from "rastercov/fields.js";
import { legendOfPieces, piecesToShow, whyNoPieces } from "rastercov/pieces.js";
import { button, choice, count, coverageText, cssColour, cssHatch, element, figure, fill, percent, when } from "rastercov/dom.js";
import { formatNumber } from "rastercov/plain.js";
import { with_bound } from "rastercov/texts.js";

const BUSY_AFTER = 400; // ms
const BUSY_EVERY = 700;

export function legend(session, view) {
  const unit = element("p.soft.unit-of-legend");
  const draw = button("Draw exact outlines", () => session.drawPieces(), { title: "may take a while" });
  const entries = element("ul.keys");
  const ramp = element("canvas.ramp", { width: 256, height: 1, hidden: true });
  const ends = element("div.ends", { hidden: true });
  const choices = session.scene.modes.map((mode) => [mode.id, mode.label]);
  const menu = choice("Colour by", choices, session.mode, (id) => session.setMode(id), {
    title: "what the colours mean (M: next)",
  });
  session.on("mode", () => (menu.value = session.mode));
  session.on("frame view", () => {
    const { figures } = session;
    const pieces = piecesToShow(session, view);
    const { words, isOffered } = pieces ? { words: "Percentages refer to exact areas." } : whyNoPieces(session, view);
    unit.textContent = words;
    draw.hidden = !isOffered;
    const all = legendOfPieces(session, figures, pieces);
    const isCounted = all.every((each) => /^\d/.test(each.label)); // numbers in their order, others by area
    if (isCounted) all.sort((a, b) => parseInt(b.label, 10) - parseInt(a.label, 10));
    fill(entries, all.map(legendEntry));
    showScale(session, figures.scale, ramp, ends);
  });
  const folded = button(
    "–",
    () => {
      const isFolded = root.classList.toggle("folded");
      folded.textContent = isFolded ? "+" : "–";
    },
    { title: "collapse the legend", kind: "quiet", "aria-label": "collapse the legend" },
  );
  const root = element(
    "section.legend",
    { "aria-label": "Legend" },
    element("header", element("label", "Colour ", menu), folded),
    ramp,
    ends,
    entries,
    unit,
    draw,
  );
  return root;
}

function legendEntry({ label, colour, hatch, percent: share, level }) {
  const swatch = element("span.swatch", { "data-level": String(level) });
  swatch.style.background = cssHatch(colour, hatch);
  swatch.style.backgroundColor = cssColour(colour);
  return element(
    "li",
    swatch,
    element("span", label),
    share === null || share === undefined ? null : element("span.figure", percent(share)),
  );
}

/** Ramp of a scale, in the very colours of the palette. */
function showScale(session, scale, ramp, ends) {
  ramp.hidden = ends.hidden = !scale;
  if (!scale) return;
  const context = ramp.getContext("2d");
  const row = context.createImageData(256, 1);
  for (let x = 0; x < 256; x++) {
    const level = Math.round(scale.first + (x / 255) * (scale.last - scale.first));
    row.data.set([...session.colourOf(level), 255], 4 * x);
  }
  context.putImageData(row, 0, 0);
  const middle = scale.is_log ? Math.sqrt(scale.low * scale.high) : (scale.low + scale.high) / 2;
  fill(
    ends,
    [
      figure(scale.low),
      figure(middle) + (scale.is_log ? " (log scale)" : ""),
      `${figure(scale.high)} ${UNITS[scale.unit] ?? scale.unit ?? ""}`,
    ].map((text) =>
      element("span", text),
    ),
  );
}

/** Covered part, always in sight, with the change since the page was opened. */
export function summary(session) {
  const main = element("strong.covered");
  const change = element("span.change");
  const rest = element("span.soft");
  const firsts = {}; // of the task and of goals
  let timer = 0;
  const root = element(
    "div.summary",
    { role: "status", "aria-label": "Coverage" },
    element("span", "Covered"),
    main,
    rest,
    change,
  );
  session.on("busy", () => {
    clearTimeout(timer);
    const began = performance.now();
    const say = async () => {
      root.classList.add("busy");
      const mine = timer;
      const [done, total] = await session.measured().catch(() => []);
      if (timer !== mine) return;
      const seconds = Math.round((performance.now() - began) / 1000);
      const which = total ? `, camera ${count(done)} of ${count(total)}` : "";
      rest.textContent = `evaluating ${count(session.scene.n_faces)} faces${which}, ${seconds} s`;
      timer = setTimeout(say, BUSY_EVERY);
    };
    timer = setTimeout(say, BUSY_AFTER);
  });
  session.on("idle", () => {
    clearTimeout(timer);
    timer = 0;
    root.classList.remove("busy");
  });
  session.on("frame", ({ summary: now }) => {
    const covered = coverageText(now);
    root.hidden = covered === undefined; // of a page on something else
    main.textContent = percent(covered);
    const by = covered - (firsts[session.state.goal ?? ""] ??= covered);
    change.textContent = Math.abs(by) < 0.05 ? "" : `${by > 0 ? "+" : "−"}${formatNumber(Math.abs(by), ".1f")} points`;
    change.className = `change ${by > 0 ? "up" : "down"}`;
    change.title = "percentage points since this page was opened";
    const exact = now.covered_area;
    const why = now.by_face_because ? ` (${now.by_face_because})` : "";
    const of = `of the area${when(session)}${session.state.goal ? ` of goal ${session.state.goal}` : ""}`;
    rest.textContent = exact ? of : `${of}, by whole faces${why}`;
    root.title = exact ? with_bound(exact.percent, exact.bound_percent) : rest.textContent;
  });
  return root;
}
