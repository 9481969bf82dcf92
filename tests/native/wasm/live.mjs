// A page that computes, without a browser: node live.mjs PAGE prints the figures, pieces, zones and words of some faces.
import { readFileSync } from "node:fs";

const [, , page, faces] = process.argv;
Object.assign(globalThis, { location: { protocol: "about:", href: "", hash: "" }, document: { getElementById: () => null, documentElement: {}, addEventListener() {} } });
const { Live } = await import("rastercov/live.js");
const [, text] = readFileSync(page, "utf8").match(/<script[^>]*id="live"[^>]*>([^]*?)<\/script>/);
const live = new Live(JSON.parse(text));
await live.scene();
const { json } = await live.act({ revision: 0, mode: "area", is_drag: false, action: { do: "none" } });
const pieces = await live.asking.ask("pieces", live.rigOf(live.history.state));
const areas = {};
pieces.reasons.forEach((reason, row) => (areas[reason] = (areas[reason] ?? 0) + pieces.areas[row]));
const words = [];
for (const face of JSON.parse(faces)) words.push((await live.why(face)).words);
console.log(JSON.stringify({ summary: json.summary, areas, zones: await live.zones(), words }));
