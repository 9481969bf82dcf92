// What fails of rules of rigs at points, by the engine: node rules.mjs ENGINE CASES prints {reason, device} of each case.
import { readFileSync } from "node:fs";
import { Engine } from "rastercov/live_engine.js";

const [, , module, cases] = process.argv;
const engine = await Engine.of(readFileSync(module));
for (const { gate, poses, reasons, point, normal } of JSON.parse(readFileSync(cases))) {
  const found = { reasons: new Uint8Array(1), devices: new Int32Array(1) };
  engine.call("rc_judge_together", gate, poses.flat(), poses.length, 1, point, normal, reasons, found);
  console.log(JSON.stringify({ reason: found.reasons[0], device: found.devices[0] }));
}
