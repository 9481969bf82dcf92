// What fails of rules of rigs at points: node rules.mjs CASES prints {reason, device} of each case.
import { readFileSync } from "node:fs";
import { failingOf } from "rastercov/live_rules.js";

const [, , cases] = process.argv;
for (const { gate, poses, reasons, spot } of JSON.parse(readFileSync(cases))) {
  console.log(JSON.stringify(failingOf(gate, poses, reasons, spot)));
}
