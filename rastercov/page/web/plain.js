/** Python's formats of numbers and texts, for `texts.js`, which is made from Python: see rastercov/report/script.py. */

/** |x| in units of 10^-decimals as a whole number: rounded exactly, halves to the even one. */
function whole(x, decimals) {
  let [above, below] = [Math.abs(x), 1n];
  for (; above % 1; above *= 2) below *= 2n;
  above = BigInt(above);
  if (decimals > 0) above *= 10n ** BigInt(decimals);
  else below *= 10n ** BigInt(-decimals);
  const [down, rest] = [above / below, 2n * (above % below)];
  return down + (rest > below || (rest === below && down % 2n) ? 1n : 0n);
}

/** |x| with a point before some decimals. */
function toFixed(x, decimals) {
  const text = String(whole(x, decimals)).padStart(decimals + 1, "0");
  return decimals > 0 ? [text.slice(0, -decimals), text.slice(-decimals)].join(".") : text;
}

/** |x| in some significant digits: its own text, and the exponent of its first digit. */
function significant(x, digits) {
  let exponent = Number(x.toExponential(30).split("e")[1]);
  let own = whole(x, digits - 1 - exponent);
  if (String(own).length > digits) [own, exponent] = [own / 10n, exponent + 1];
  return [String(own).padEnd(digits, "0").replace(/(?<=^.)(?=.)/, "."), exponent];
}

/** As Python's format(x, spec), for specs "", "," and [,][.digits](e|f|g). */
export function formatNumber(x, spec = "") {
  if (typeof x === "string") return x;
  if (!Number.isFinite(x)) return String(x).toLowerCase().replace("inity", "");
  const [, comma, given, kind] = /(,?)\.?(\d*)(.?)/.exec(spec);
  const digits = given ? Number(given) : kind ? 6 : 0;
  let text = toFixed(x, digits);
  if (kind === "e" || kind === "g") {
    const most = kind === "g" ? digits : digits + 1;
    const [own, exponent] = significant(x, most);
    const isLong = kind === "e" || exponent < -4 || exponent >= most;
    text = isLong ? own : toFixed(x, most - 1 - exponent);
    if (kind === "g" && text.includes(".")) text = text.replace(/\.?0+$/, "");
    if (isLong) text += (exponent < 0 ? "e-" : "e+") + String(Math.abs(exponent)).padStart(2, "0");
  }
  if (comma) text = text.replace(/(?<!\.\d*)\B(?=(\d{3})+(?!\d))/g, ",");
  return (x < 0 || Object.is(x, -0) ? "-" : "") + text;
}

/** As Python's text.format(**values), of texts by their names. */
export const fillText = (text, values) => text.replace(/\{(\w+)\}/g, (_, name) => values[name]);

/** As Python's text.removesuffix(end). */
export const withoutEnd = (text, end) => (text.endsWith(end) ? text.slice(0, -end.length) : text);

/** As Python's `one in all`, of a list, a text or the names of an object. */
export const isIn = (one, all) => (typeof all === "string" || Array.isArray(all) ? all.includes(one) : Object.hasOwn(all, one));

/** A value that a file gave, as Python shows it. */
export function shown(value) {
  const text = typeof value === "string" ? `'${value}'` : ({ null: "None", undefined: "None", true: "True", false: "False" }[value] ?? JSON.stringify(value));
  return text.length > 30 ? [text.slice(0, 13), text.slice(-14)].join("...") : text;
}

/** Whether a value of JSON is a table of names and values. */
export const isTable = (value) => typeof value === "object" && value !== null && !Array.isArray(value);

/** Type of a value of JSON, as Python names it. */
export const kindOf = (value) => (value === null ? "NoneType" : Array.isArray(value) ? "list" : ({ object: "dict", string: "str", boolean: "bool" }[typeof value] ?? (Number.isInteger(value) ? "int" : "float")));

/** An answer that says no: `message` is its one line, `status` that of HTTP. */
export class Refused extends Error {
  constructor(message, status = 400) {
    super(message);
    this.status = status;
  }
}
