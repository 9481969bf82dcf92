/** Ways to colour the faces, and their options, as controls of a panel. */

import { element, fill } from "rastercov/dom.js";
import { control } from "rastercov/fields.js";

/**
 * Modes of one panel as a list to choose from, with the options of the present one.
 *
 * @param {Session} session
 * @param {string} panel "object", "camera" or "network", as the server says of each mode
 */
export function modeList(session, panel) {
  const modes = session.scene.modes.filter((mode) => mode.panel === panel);
  const root = element("fieldset.modes", element("legend", "Colour by"));
  const rows = modes.map((mode) => {
    const radio = element("input", { type: "radio", name: `mode-${panel}`, value: mode.id });
    radio.addEventListener("change", () => session.setMode(mode.id));
    const options = element("div.options");
    const row = element(
      "div.mode",
      element("label.check", { title: mode.words ?? "" }, radio, element("span", mode.label)),
      options,
    );
    return { mode, radio, options, row };
  });
  root.append(...rows.map(({ row }) => row));
  const show = () => {
    for (const { mode, radio, options } of rows) {
      const isOn = mode.id === session.mode;
      if (radio.checked === isOn && options.childElementCount > 0 === isOn) continue;
      radio.checked = isOn;
      fill(options, isOn ? optionControls(session, mode) : []);
    }
  };
  session.follow("mode", show);
  return modes.length ? root : null;
}

/** Controls of the options of a mode; none in a static export, whose figures are fixed. */
function optionControls(session, mode) {
  const words = mode.words ? [element("p.soft", mode.words)] : [];
  if (session.server.isRecorded) return words;
  const fields = (mode.options ?? []).map((field) => {
    const value = session.options[mode.id][field.name];
    return control(field, value, (next, isDrag) => session.setOption(field.name, next, isDrag)).root;
  });
  return [...words, ...fields];
}
