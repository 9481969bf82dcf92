/** What the page reads of files: one line of JSON for each case, {value} or {fault}; numbers that JSON lacks as texts. */

import { readFileSync } from "node:fs";
import { plainOf } from "rastercov/camera_entries.js";
import { readColmap } from "rastercov/colmap.js";
import { editState } from "rastercov/live_rig.js";
import { readToml } from "rastercov/toml.js";

const { data, sold, cases } = JSON.parse(readFileSync(process.argv[2], "utf8"));
const READ = {
  toml: readToml,
  camera: (entries) => plainOf(entries, data.models, sold),
  colmap: (files) => readColmap(files.map(({ name, text }) => ({ name, bytes: new Uint8Array(Buffer.from(text, "base64")) })), data),
  pose: (pose) => {
    const stations = [{ id: 0, name: "a", camera: "a", pose, is_on: true }];
    return editState({ stations: [], cameras: { a: {} } }, { do: "restore", rig: { stations, cameras: {} } })[0].stations[0].pose;
  },
};
const special = (_, value) => (typeof value === "number" && !Number.isFinite(value) ? `number ${value}` : value);
for (const [kind, given] of cases) {
  try {
    console.log(JSON.stringify({ value: READ[kind](given) }, special));
  } catch (error) {
    console.log(JSON.stringify({ fault: error.message, isRefused: error.constructor.name === "Refused" }));
  }
}
