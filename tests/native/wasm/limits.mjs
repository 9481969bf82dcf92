// A page at the end of its memory: node limits.mjs ENGINE CASES prints the line, and the area before and after
// it, as JSON. See tests/native/test_wasm.py.
import { readFileSync } from "node:fs";
import { Figures } from "rastercov/live_worker.js";

const [, , module, cases] = process.argv;
const [{ vertices, faces, roles }] = JSON.parse(readFileSync(cases));
const n = roles.length;
const mesh = {
  vertices: Float64Array.from(vertices),
  faces: Int32Array.from(faces),
  group: new Uint16Array(n),
  parts: { "": { roles: Uint8Array.from(roles), isTask: new Uint8Array(n).fill(1), unseeable: new Map() } },
};
const figures = new Figures(readFileSync(module), mesh);
const sum = async () => (await figures.answer("areas", [])).reduce((total, each) => total + each, 0);
const before = await sum();
figures.fill = () => new Float64Array(2 ** 45);
const line = await figures.answer("fill", []).catch((error) => error.message);
console.log(JSON.stringify({ line, before, after: await sum() }));
