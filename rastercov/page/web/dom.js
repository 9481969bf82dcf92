/** Elements of the page: made from a tag, properties and children, never from text with markup. */

import { formatNumber } from "rastercov/plain.js";
import { area, distance, number, percent as percentOf } from "rastercov/texts.js";

const flat = (children) => children.flat(Infinity).filter((child) => (child ?? null) !== null);

/**
 * Element with properties, if any, and children.
 *
 * @param {string} tag name with optional classes, such as "div.card.wide"
 * @param {...*} given an object of attributes, which may be left out, before the children; `on` maps names of
 *   events to listeners, and `value`, `checked`, `disabled`, `hidden`, `htmlFor` and `textContent` are set as
 *   properties
 */
export function element(tag, ...given) {
  const properties = given[0]?.constructor === Object ? given.shift() : {};
  const [name, ...classes] = tag.split(".");
  const made = document.createElement(name);
  if (classes.length) made.className = classes.join(" ");
  for (const [key, value] of Object.entries(properties)) {
    if (key === "on") {
      for (const [event, listener] of Object.entries(value)) made.addEventListener(event, listener);
    } else if (key in made && typeof value !== "string") {
      made[key] = value;
    } else if (value !== null && value !== undefined) {
      if (["value", "textContent", "htmlFor"].includes(key)) made[key] = value;
      else made.setAttribute(key, value);
    }
  }
  made.append(...flat(given));
  return made;
}

/** Button with a text, and a title that says more. */
export function button(text, onClick, { title = "", kind = "", ...more } = {}) {
  const tag = kind ? `button.${kind}` : "button";
  return element(tag, { type: "button", title, ...more, on: { click: onClick } }, text);
}

/** Button that opens a file of the user's disk; the same one may be chosen again. */
export function fileButton(text, accept, take, isOfSeveral = false) {
  const input = element("input", { type: "file", accept, hidden: true, multiple: isOfSeveral, "aria-label": text });
  input.addEventListener("change", () => {
    const files = [...input.files];
    input.value = "";
    if (files.length) take(...files);
  });
  return element("span.file-button", input, button(text, () => input.click()));
}

/** Two-state button: `aria-pressed` says whether it is on. */
export function toggle(text, isOn, onChange, { title = "" } = {}) {
  const made = button(text, () => made.set(!made.isOn(), true), { title, kind: "toggle" });
  made.isOn = () => made.getAttribute("aria-pressed") === "true";
  made.set = (value, isTold = false) => {
    made.setAttribute("aria-pressed", String(Boolean(value)));
    if (isTold) onChange(Boolean(value));
  };
  made.set(isOn);
  return made;
}

/** Check box with its label. */
export function check(text, isOn, onChange, { title = "" } = {}) {
  const box = element("input", { type: "checkbox", checked: isOn });
  box.addEventListener("change", () => onChange(box.checked));
  return element("label.check", { title }, box, element("span", text));
}

/** Menu of choices [[value, text], ...] with a label. */
export function choice(label, choices, value, onChange, { title = "" } = {}) {
  const options = choices.map(([key, text]) =>
    element("option", { value: String(key), selected: key === value }, text),
  );
  const menu = element("select", { title, "aria-label": label }, options);
  menu.addEventListener("change", () => onChange?.(choices[menu.selectedIndex][0]));
  return menu;
}

/** Menu that opens below a button, and closes at Esc and at a press elsewhere; `root.open = false` closes it. */
export function menu(text, title, items) {
  const root = element("details.menu", element("summary", { title }, text), element("div.items", items));
  document.addEventListener("pointerdown", (event) => root.contains(event.target) || (root.open = false));
  root.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || !root.open) return;
    root.open = false;
    root.firstChild.focus();
    event.stopPropagation();
  });
  return root;
}

const KEPT_KEY = "rastercov-page:";

/** What this browser remembers of the page under a name, or `otherwise`. */
export function recall(name, otherwise) {
  try {
    return JSON.parse(localStorage.getItem(KEPT_KEY + name)) ?? otherwise;
  } catch {
    return otherwise; // forbidden by the browser
  }
}

/** Keeps a value for the next page; false where the browser forbids it, or has no room. */
export function remember(name, value) {
  try {
    localStorage.setItem(KEPT_KEY + name, JSON.stringify(value));
    return true;
  } catch {
    return false;
  }
}

/** Section of a panel that folds, and stays so in the next page by its name; null: it does not. */
export function section(title, children, { isOpen = true, name = title } = {}) {
  const made = element(
    "details.section",
    { open: name === null ? isOpen : recall(`section ${name}`, isOpen) },
    element("summary", title),
    children,
  );
  if (name !== null) made.addEventListener("toggle", () => remember(`section ${name}`, made.open));
  return made;
}

/** Column at the side of the picture with a button that folds it, remembered by its name. */
export function side(name, label, ...children) {
  const fold = button("", () => keep(!made.classList.contains("folded")), { kind: "fold" });
  const made = element(`aside.${name}`, { "aria-label": label }, fold, element("div.inner", children));
  const show = (isFolded) => {
    made.classList.toggle("folded", isFolded);
    fold.textContent = isFolded === (name === "left") ? "›" : "‹";
    fold.title = `${isFolded ? "show" : "hide"} this column`;
    fold.setAttribute("aria-label", `${isFolded ? "show" : "hide"} ${label}`);
    fold.setAttribute("aria-expanded", String(!isFolded));
  };
  const keep = (isFolded) => {
    show(isFolded);
    remember(`side ${name}`, isFolded);
  };
  show(recall(`side ${name}`, window !== window.top)); // a frame of another page is mostly picture
  made.unfold = () => made.classList.contains("folded") && keep(false);
  return made;
}

/** A function that calls another one when a time in ms has passed since its own last call. */
export function later(call, wait) {
  let timer = 0;
  return () => {
    clearTimeout(timer);
    timer = setTimeout(call, wait);
  };
}

/** Replaces all children. */
export function fill(parent, ...children) {
  parent.replaceChildren(...flat(children));
  return parent;
}

/** Rebuilds what is in `parent`; the focus stays at the control of the same number, if there is one. */
export function keepingFocus(parent, rebuild) {
  const controls = () => [...parent.querySelectorAll("button, input, select")];
  const at = controls().indexOf(document.activeElement);
  rebuild();
  if (at >= 0) controls()[at]?.focus({ preventScroll: true });
}

/** CSS colour of [r, g, b], 0 to 255. */
export const cssColour = ([r, g, b]) => `rgb(${r}, ${g}, ${b})`;

/** Backgrounds of a hatch: lines / have bit 1, their mirror image 2, | 4, - 8, and dots 16. */
const HATCHES = [
  ...[135, 45, 90, 0].map(
    (angle) => `repeating-linear-gradient(${angle}deg, #ffffff73 0 1.5px, transparent 1.5px 5px)`,
  ),
  "radial-gradient(#ffffff73 1.5px, transparent 1.5px) 0 0 / 5px 5px",
];

/** Background of a colour under the paler lines of a hatch. */
export const cssHatch = (colour, hatch = 0) =>
  [
    ...HATCHES.filter((_, bit) => (hatch >> bit) & 1),
    `linear-gradient(${cssColour(colour)} 0 0)`,
  ].join(", ");

/** Text of a number with at most `digits` significant digits, and of none. */
export const figure = (value, digits = 3) => (Number.isNaN(value ?? NaN) ? "–" : number(value, digits));

/** Text of a percentage, and of none. */
export const percent = (value) => ((value ?? null) === null ? "–" : percentOf(value / 100));

/** Covered part of a summary, percent: by area, or by whole faces where the result is. */
export const coverageText = ({ covered, covered_area: exact }) => (exact ? exact.percent : covered?.area_percent);

/** Words on the frames in which parts are covered, after a space; none of one frame. */
export const when = ({ scene }) => (scene.when ? ` ${scene.when}` : "");

/** Whole number with commas between thousands. */
export const count = (n) => formatNumber(n, ",");

let unit = "m";

/** Unit of lengths from here on: "m", or "unit" for a reconstruction without scale. */
export function useUnit(name) {
  unit = name;
}

/** A unit with metres, such as "m" or "px/m", in the unit of lengths. */
export const inUnit = (text) => (unit === "m" ? text : text === "m" ? "units" : text.replace("/m", "/unit"));

/** Length with a fitting unit. */
export const metres = (value) => distance(value, unit);

/** Area with a fitting unit. */
export const squareMetres = (value) => area(value, unit);
