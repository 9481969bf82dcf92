/** Box that finds one of many names by words; arrow keys, Enter and Esc are those of ARIA's combobox. */

import { count, element, fill } from "rastercov/dom.js";

const MOST_SHOWN = 40;
let boxes = 0;

/**
 * @param {string} label
 * @param {[string, string][]} rows names, and words that say what they are
 * @param {(name: string) => void} onPick
 */
export function finder(label, rows, onPick) {
  const id = `finder-${++boxes}`;
  const list = element("ul.found", { role: "listbox", id, "aria-label": label, hidden: true });
  const note = element("p.soft", { role: "status", hidden: true });
  const input = element("input.text", {
    type: "search",
    role: "combobox",
    placeholder: `${label}…`,
    "aria-label": label,
    "aria-controls": id,
    "aria-autocomplete": "list",
    autocomplete: "off",
    spellcheck: "false",
  });
  let at = 0;
  const show = () => {
    const words = input.value.toLowerCase().split(/[\s,]+/).filter(Boolean);
    const isIn = (row) => words.every((word) => row.join(" ").toLowerCase().includes(word));
    const found = words.length ? rows.filter(isIn) : [];
    const shown = found.slice(0, MOST_SHOWN);
    at = 0;
    fill(
      list,
      shown.map(([name, more], k) =>
        element(
          "li",
          { role: "option", id: `${id}-${k}`, on: { mousedown: (event) => (event.preventDefault(), pick(name)) } },
          element("strong", name),
          element("span.soft", more),
        ),
      ),
    );
    list.hidden = !shown.length;
    note.hidden = !words.length || (shown.length > 0 && shown.length === found.length);
    note.textContent = shown.length ? `${count(found.length - shown.length)} more; refine your search` : "no match";
    input.setAttribute("aria-expanded", String(!list.hidden));
    mark();
  };
  const mark = () => {
    [...list.children].forEach((each, k) => each.setAttribute("aria-selected", String(k === at)));
    list.children[at]?.scrollIntoView?.({ block: "nearest" });
    input.setAttribute("aria-activedescendant", list.children[at]?.id ?? "");
  };
  const pick = (name) => {
    input.value = "";
    show();
    onPick(name);
  };
  input.addEventListener("input", show);
  input.addEventListener("keydown", (event) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step && !list.hidden) {
      at = (at + step + list.children.length) % list.children.length;
      mark();
    } else if (event.key === "Enter" && !list.hidden) pick(list.children[at].firstChild.textContent);
    else if (event.key === "Escape") {
      input.value = "";
      show();
    } else return;
    event.preventDefault();
  });
  show();
  return element("div.finder", input, list, note);
}
