// Advice of the page: node advice.mjs CASES prints a text of each case, as JSON. See tests/viewer/test_live_advice.py.
import { readFileSync } from "node:fs";
import { adviceFor } from "rastercov/live_advice.js";

for (const { template, general, figures, limits } of JSON.parse(readFileSync(process.argv[2]))) {
  const focus = limits.focus.map((depth) => depth ?? Infinity);
  console.log(JSON.stringify(adviceFor(template, general, figures, { ...limits, focus })));
}
