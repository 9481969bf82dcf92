/**
 * Fields for numbers and choices, as the server describes them: name, words, kind, low, high,
 * choices, default, is_optional, unit. A number has a slider and a box to type in; a value out of
 * range is answered by one line under the box and goes no further.
 */

import { check, choice, element, figure, inUnit, toggle } from "rastercov/dom.js";
import { clamp } from "rastercov/maths.js";
import { formatNumber } from "rastercov/plain.js";

/**
 * Makes an input a text of the rig. What is typed is the rig's once `onChange(text)` takes it, with true;
 * until then Esc and Ctrl+Z give back what the rig has, and then Ctrl+Z is that of the rig.
 *
 * @returns {(text: string) => void} writes what the rig has, unless something else is being typed
 */
export function ofRig(input, onChange, onWritten = () => {}) {
  let own = input.value;
  let taken = own; // the last text that is the rig's, or on its way there
  const write = () => {
    taken = input.value = own;
    onWritten();
  };
  input.classList.add("of-rig");
  input.addEventListener("change", () => {
    if (onChange(input.value)) taken = input.value;
  });
  input.addEventListener("keydown", (event) => {
    const isUndo = (event.ctrlKey || event.metaKey) && /^[zy]$/i.test(event.key) && input.value !== taken;
    if (!isUndo && event.key !== "Escape") return;
    write();
    if (!isUndo) input.blur();
    event.preventDefault();
    event.stopPropagation();
  });
  return (text) => {
    own = text;
    if (document.activeElement !== input || input.value === taken) write();
  };
}

/**
 * Box for a number; `onValue` gets numbers in range alone.
 *
 * @param {object} options label, value, low and high (or null), is_low_open, isWhole, unit
 * @param {(value: number) => void} onValue
 */
export function numberBox(options, onValue) {
  const { label, low = null, high = null, isWhole = false, unit = "", is_low_open: isLowOpen } = options;
  const fault = element("p.fault", { role: "alert", hidden: true });
  const input = element("input.number", {
    type: "text",
    inputmode: "decimal",
    "aria-label": label,
    autocomplete: "off",
    placeholder: options.placeholder ?? "none",
    value: shown(options.value),
  });
  const say = (problem) => {
    fault.hidden = !problem;
    fault.textContent = problem;
    input.setAttribute("aria-invalid", String(Boolean(problem)));
  };
  const judge = () => {
    const number = Number(input.value.trim().replace(",", "."));
    const problem = faultOf(input.value, number, { label, low, high, isLowOpen, isWhole, unit });
    say(problem);
    return problem ? null : number;
  };
  input.addEventListener("input", judge);
  const take = () => {
    const number = judge();
    if (number !== null) onValue(number);
    return number !== null;
  };
  const write = ofRig(input, take, () => say(""));
  return { input, fault, set: (value) => write(shown(value)) };
}

const shown = (value) => ((value ?? null) === null ? "" : formatNumber(value, Math.abs(value) < 1e5 ? ".6g" : ".9g"));

/** One line about a typed number, or "" where it may pass. */
function faultOf(text, number, { label, low, high, isLowOpen, isWhole, unit }) {
  const least = low === null ? "" : isLowOpen ? ` above ${figure(low)}` : ` of at least ${figure(low)}`;
  const most = high === null ? "" : `${least ? " and" : " of"} at most ${figure(high)}`;
  const wanted = `${label}: expected a${isWhole ? " whole" : ""} number${least}${most}${unit ? ` ${unit}` : ""}`;
  const isNumber = text.trim() !== "" && Number.isFinite(number);
  const isAboveLow = low === null || number > low || (number === low && !isLowOpen);
  const isInside = isAboveLow && (high === null || number <= high);
  const isRight = isNumber && isInside && (!isWhole || Number.isInteger(number));
  return isRight ? "" : `${wanted}, got “${text.trim()}”`;
}

/**
 * Slider and box of one number.
 *
 * @param {object} field as the server describes it; its `is_low_open` keeps the slider above low, and
 *   `presets` are numbers by name
 * @param {number|null} value
 * @param {(value: number|null, isDrag: boolean) => void} onValue isDrag while the slider moves
 */
export function numberField(field, value, onValue) {
  const isWhole = field.kind === "int";
  const unit = inUnit(field.unit ?? "");
  const span = spanOf(field, value);
  const label = field.label ?? labelOf(field.name);
  const slider = element("input", {
    type: "range",
    min: "0",
    max: "1000",
    step: "any",
    "aria-label": label,
    title: field.words ?? "",
  });
  if (span.isWholeSteps) {
    slider.min = span.low;
    slider.max = span.high;
    slider.step = 1;
  }
  const toSlider = (x) => (span.isWholeSteps ? x : 1000 * span.part(x));
  const fromSlider = () => {
    const x = span.isWholeSteps ? Number(slider.value) : span.at(Number(slider.value) / 1000);
    return isWhole ? Math.round(x) : Number(x.toPrecision(4));
  };
  const box = numberBox({ ...field, label, value, isWhole, unit }, (number) => {
    slider.value = toSlider(number);
    onValue(number, false);
  });
  const presets = Object.entries(field.presets ?? {}).map(([name, number]) => {
    const pick = (isOn) => onValue(isOn ? number : field.default, false);
    return { number, chip: toggle(labelOf(name), false, pick, { title: `${number} ${unit}, by EN 62676-4` }) };
  });
  let isDragging = false;
  slider.addEventListener("input", () => {
    isDragging = true;
    box.set(fromSlider());
    onValue(fromSlider(), true);
  });
  slider.addEventListener("change", () => {
    isDragging = false;
    onValue(fromSlider(), false);
  });
  const optional = field.is_optional
    ? check(
        "",
        value !== null,
        (isOn) => {
          setEnabled(isOn);
          onValue(isOn ? fromSlider() : null, false);
        },
        { title: "limit on or off" },
      )
    : null;
  optional?.querySelector("input").setAttribute("aria-label", `limit ${label}`);
  const setEnabled = (isOn) => {
    slider.disabled = box.input.disabled = !isOn;
  };
  const set = (next) => {
    for (const { number, chip } of presets) chip.set(number === next);
    if (isDragging) return;
    const isOn = next !== null && next !== undefined;
    if (optional) {
      optional.querySelector("input").checked = isOn;
      setEnabled(isOn);
    }
    if (isOn) slider.value = toSlider(next);
    box.set(next);
  };
  set(value ?? null);
  if (value === null || value === undefined) slider.value = toSlider(field.default ?? span.low);
  const root = element(
    "div.field",
    { title: field.words ?? "" },
    element(
      "div.field-head",
      optional,
      element("span.field-label", label),
      box.input,
      element("span.unit", UNITS[unit] ?? unit),
    ),
    slider,
    presets.length ? element("div.presets", presets.map(({ chip }) => chip)) : null,
    box.fault,
  );
  return { root, set, slider, input: box.input };
}

/** Range of a slider, and the maps between it and [0, 1]. */
function spanOf(field, value) {
  const largest = Math.max(Math.abs(value ?? 0), Math.abs(field.default ?? 0));
  const low = field.low ?? 0;
  const high = field.high ?? Math.max(low + 1, 5 * largest, SOFT_HIGH[field.unit] ?? 10);
  const isLog = low > 0 && high / low > 100 && field.unit !== "deg";
  // A range without an end is finer near its beginning.
  const power = field.high === null && !isLog && field.kind !== "int" ? 3 : 1;
  const least = field.is_low_open ? 1 / 1000 : 0;
  return {
    low,
    high,
    isWholeSteps: field.kind === "int" && high - low <= 200,
    at: (t) => {
      const part = Math.max(t, least);
      return isLog ? low * (high / low) ** part : low + (high - low) * part ** power;
    },
    part: (x) => {
      const t = isLog
        ? Math.log(x / low) / Math.log(high / low)
        : Math.max(0, (x - low) / (high - low)) ** (1 / power);
      return clamp(Number.isFinite(t) ? t : 0, 0, 1);
    },
  };
}

/** End of a slider, by the unit, where the server knows none. */
const SOFT_HIGH = { px: 1000, "px/m": 5000, "px/m²": 1e7, "px/m2": 1e7 };

/** Units for people. */
export const UNITS = { deg: "°", um: "µm", "W/m2": "W/m²" };

const LABELS = {
  hfov_deg: "Field of view",
  fx: "Focal length",
  px_per_m: "Pixels per metre",
  width: "Image width",
  f_number: "F-number",
  focus_near: "In focus from",
  focus_far: "In focus to",
  near: "Near plane",
  alpha_deg: "Max angle within a segment",
  beta_deg: "Max angle to merge segments",
  min_pixels_per_m2: "Min pixels per m²",
};

/** Words for people of a name such as min_pixels. */
export function labelOf(name) {
  if (name in LABELS || name.length < 3) return LABELS[name] ?? name;
  const words = name.replace(/_deg$/, "").replaceAll("_", " ");
  return words[0].toUpperCase() + words.slice(1);
}

/** Control of any kind of field: {root, set}. */
export function control(field, value, onValue) {
  const label = field.label ?? labelOf(field.name);
  const options = { title: field.words ?? "" };
  if (field.kind === "choice") {
    const choices = field.choices.map((each) => (Array.isArray(each) ? each : [each, labelOf(each)]));
    const menu = choice(label, choices, value, (next) => onValue(next, false));
    const root = element(
      "div.field",
      options,
      element("label.field-head", element("span.field-label", label), menu),
    );
    const set = (next) => {
      menu.selectedIndex = choices.findIndex(([key]) => key === next);
    };
    return { root, set };
  }
  if (field.kind === "bool") {
    const root = check(label, value, (next) => onValue(next, false), options);
    return { root, set: (next) => (root.querySelector("input").checked = Boolean(next)) };
  }
  return numberField(field, value, onValue);
}
