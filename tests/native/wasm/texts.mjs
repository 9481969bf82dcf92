// Texts of the page: node texts.mjs CASES prints what each function gives of its arguments, as JSON; "inf" is
// infinity. See tests/viewer/test_texts.py and test_live_advice.py.
import { readFileSync } from "node:fs";
import * as dom from "rastercov/dom.js";
import { formatNumber } from "rastercov/plain.js";
import * as texts from "rastercov/texts.js";

const functions = { ...texts, formatNumber, "page count": dom.count, "page figure": dom.figure, "page metres": dom.metres, "page squareMetres": dom.squareMetres, "page percent": dom.percent };
const given = JSON.parse(readFileSync(process.argv[2]), (_, value) => (value === "inf" ? Infinity : value));
for (const [name, ...values] of given) console.log(JSON.stringify(functions[name](...values), (_, value) => (value === Infinity ? "inf" : value)));
