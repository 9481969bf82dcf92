// Numbers and borders of lenses by the page's worker: node lenses.mjs MODULE CASES, a line of JSON each.
import { readFileSync } from "node:fs";
import { Figures } from "rastercov/live_worker.js";

const [module, cases] = process.argv.slice(2);
const bytes = readFileSync(module);
for (const optics of JSON.parse(readFileSync(cases))) {
  try {
    const { row, border } = await new Figures().prove(bytes, optics);
    const numbers = Buffer.from(row.buffer, row.byteOffset, row.byteLength).toString("base64");
    console.log(JSON.stringify({ numbers, border: [...border] }));
  } catch (error) {
    console.log(JSON.stringify({ line: error.message, status: error.status }));
  }
}
