/** Panels behind tabs; arrows go from tab to tab, as the ARIA pattern has it. */

import { button, element, remember, recall } from "rastercov/dom.js";

/**
 * @param {[string, HTMLElement][]} panels titles and contents
 * @param {number} first index of the one that is shown at first
 */
export function tabs(panels, first) {
  const heads = panels.map(([title], at) =>
    button(title, () => show(at), {
      kind: "tab",
      role: "tab",
      id: `tab-${at}`,
      "aria-controls": `panel-${at}`,
      title: `press ${at + 1}`,
    }),
  );
  const bodies = panels.map(([, body], at) =>
    element("div.panel", { role: "tabpanel", id: `panel-${at}`, "aria-labelledby": `tab-${at}` }, body),
  );
  let shown = first;
  let onShow = () => {};
  const show = (at) => {
    shown = at;
    onShow();
    remember("tab", at);
    heads.forEach((head, k) => {
      head.setAttribute("aria-selected", String(k === at));
      head.tabIndex = k === at ? 0 : -1;
      bodies[k].hidden = k !== at;
    });
    panels[at][1].onShown?.();
  };
  const list = element("div.tabs", { role: "tablist", "aria-label": "Panels" }, heads);
  list.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    show((shown + step + panels.length) % panels.length);
    heads[shown].focus();
    event.preventDefault();
  });
  show(Math.min(recall("tab", first), panels.length - 1));
  return {
    onShow: (listener) => (onShow = listener),
    root: element("div.tabbed", list, bodies),
    show,
    isShown: (title) => panels[shown][0] === title,
  };
}
