// Colours of the page: node painting.mjs COLOURS CASES prints what each case {own, mode, figures} is painted as, as
// JSON; "inf" is infinity. See tests/viewer/test_painting.py.
import { readFileSync } from "node:fs";
import { bytesOf } from "rastercov/api.js";
import { paintFaces } from "rastercov/live_paint.js";

const [colours, cases] = process.argv.slice(2).map((path) => JSON.parse(readFileSync(path), (_, value) => (value === "inf" ? Infinity : value)));
for (const each of Object.values(colours.scales)) each.palette = bytesOf(each.palette);
const arrays = (figures) =>
  Object.fromEntries(Object.entries(figures).map(([name, value]) => [name, Array.isArray(value) && typeof value[0] === "number" ? new Float64Array(value) : value]));
for (const { own, mode, figures } of cases) {
  const given = { ...arrays(figures), measured: arrays(figures.measured ?? {}) };
  const found = paintFaces({ ...own, ...colours, isTask: new Uint8Array(own.isTask) }, mode, given);
  console.log(JSON.stringify({ ...found, levels: [...found.levels], palette: [...found.palette] }));
}
