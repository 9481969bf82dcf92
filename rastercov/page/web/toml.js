/** TOML 1.0 as objects without a prototype; dates stay texts. What is none is refused with its line. */

import { expected } from "rastercov/api.js";

const DEEPEST = 100;
const pattern = (text, flags = "uy") => RegExp(text, flags);
const [BARE, BLANKS, LINES, COMMENT] = ["[\\w-]+", "[ \\t]*", "([ \\t\\n]|#([^\\p{Cc}]|\\t)*(?=\\n|$))*", "[ \\t]*(#([^\\p{Cc}]|\\t)*)?"].map((text) => pattern(text));
const [LONG, LONG_LITERAL, SHORT, LITERAL] = [
  '"""\\n?(([^"\\\\\\p{Cc}]|[\\t\\n]|\\\\[^]|"{1,2}(?!"))*"{0,2})"""',
  "'''\\n?(([^'\\p{Cc}]|[\\t\\n]|'{1,2}(?!'))*'{0,2})'''",
  '"(([^"\\\\\\p{Cc}]|\\t|\\\\.)*)"',
  "'(([^'\\p{Cc}]|\\t)*)'",
].map((text) => pattern(text));
const ESCAPES = pattern('\\\\(?:([btnfr"\\\\])|u([\\da-fA-F]{4})|U([\\da-fA-F]{8})|[ \\t]*\\n\\s*|([^]))', "gu");
const ESCAPED = { b: "\b", t: "\t", n: "\n", f: "\f", r: "\r", '"': '"', "\\": "\\" };
const NAMED = { true: true, false: false, inf: Infinity, "+inf": Infinity, "-inf": -Infinity, nan: NaN, "+nan": NaN, "-nan": NaN };
const WORD = pattern("[^\\s,\\]}#=]+");
const NUMBER = pattern("^([+-]?(0|[1-9](_?\\d)*)(\\.\\d(_?\\d)*)?([eE][+-]?\\d(_?\\d)*)?|0x[\\da-fA-F](_?[\\da-fA-F])*|0o[0-7](_?[0-7])*|0b[01](_?[01])*)$", "u");
const MOMENT = pattern("(\\d{4}-\\d\\d-\\d\\d([Tt ]\\d\\d:\\d\\d:\\d\\d(\\.\\d+)?([Zz]|[+-]\\d\\d:\\d\\d)?)?|\\d\\d:\\d\\d:\\d\\d(\\.\\d+)?)");

/** The table of a text. */
export function readToml(text) {
  return new Reader(text.replace(/^\ufeff/u, "").replaceAll("\r\n", "\n")).read();
}

class Reader {
  #at = 0;
  #kinds = new Map(); // of tables: "header", "implied" by one, "dotted" by a key, or "inline"; and lists of tables

  constructor(text) {
    this.text = text;
  }

  read() {
    const root = this.#table("header");
    let table = root;
    for (this.#pass(true); this.#at < this.text.length; this.#end()) {
      if (this.#takes("[[")) table = this.#header(root, "]]");
      else if (this.#takes("[")) table = this.#header(root, "]");
      else this.#entry(table, 0);
    }
    return root;
  }

  #wrong(wanted) {
    const line = this.text.slice(0, this.#at).split("\n").length;
    const [got] = this.text.slice(this.#at).trimStart().split("\n");
    expected(wanted, got || "the end of the line", "correct the file", `line ${line}: `);
  }

  #table(kind) {
    const made = Object.create(null);
    this.#kinds.set(made, kind);
    return made;
  }

  #match(form) {
    form.lastIndex = this.#at;
    const found = form.exec(this.text);
    if (found) this.#at = form.lastIndex;
    return found;
  }

  #takes(mark) {
    const isThere = this.text.startsWith(mark, this.#at);
    if (isThere) this.#at += mark.length;
    return isThere;
  }

  /** Passes blanks, and lines and comments if they may be there. */
  #pass(isOverLines = false) {
    this.#match(isOverLines ? LINES : BLANKS);
  }

  /** The end of a line, and what is blank behind it. */
  #end() {
    this.#match(COMMENT);
    if (this.#at < this.text.length && !this.#takes("\n")) this.#wrong("the end of the line");
    this.#pass(true);
  }

  #key() {
    const keys = [];
    do {
      this.#pass();
      keys.push(this.#match(BARE)?.[0] ?? this.#text(SHORT, LITERAL) ?? this.#wrong("a key"));
      this.#pass();
    } while (this.#takes("."));
    return keys;
  }

  /** The table that the keys of a header or an entry lead to; `kind` is that of tables on the way. */
  #inside(table, keys, kind) {
    return keys.reduce((own, key) => {
      own[key] ??= this.#table(kind);
      const next = kind === "implied" && this.#kinds.get(own[key]) === "list" ? own[key].at(-1) : own[key];
      const known = this.#kinds.get(next);
      if (!known || known === "inline" || known === "list" || (kind === "dotted" && known === "header")) this.#wrong("one " + key);
      if (kind === "dotted") this.#kinds.set(next, kind);
      return next;
    }, table);
  }

  #header(root, end) {
    const keys = this.#key();
    if (!this.#takes(end)) this.#wrong(end);
    const last = keys.pop();
    const table = this.#inside(root, keys, "implied");
    if (end === "]]") {
      if (!(last in table)) this.#kinds.set((table[last] = []), "list");
      if (this.#kinds.get(table[last]) !== "list") this.#wrong("one " + last);
      table[last].push(this.#table("header"));
      return table[last].at(-1);
    }
    table[last] ??= this.#table("implied");
    if (this.#kinds.get(table[last]) !== "implied") this.#wrong("one " + last);
    this.#kinds.set(table[last], "header");
    return table[last];
  }

  #entry(table, depth) {
    const keys = this.#key();
    if (!this.#takes("=")) this.#wrong("=");
    const last = keys.pop();
    const own = this.#inside(table, keys, "dotted");
    if (last in own) this.#wrong("one " + last);
    this.#pass();
    own[last] = this.#value(depth);
  }

  #text(withEscapes, literal) {
    const found = this.#match(withEscapes)?.[1].replace(ESCAPES, (...parts) => this.#escaped(parts));
    return found ?? this.#match(literal)?.[1];
  }

  #escaped([whole, letter, short, long, other]) {
    const code = parseInt(short ?? long ?? 0, 16);
    if (other || code > 0x10ffff || (code >= 0xd800 && code < 0xe000)) this.#wrong("another character than " + whole);
    return letter ? ESCAPED[letter] : code || short || long ? String.fromCodePoint(code) : "";
  }

  #value(depth) {
    if (depth > DEEPEST) this.#wrong("up to 100 levels");
    const text = this.#text(LONG, LONG_LITERAL) ?? this.#text(SHORT, LITERAL);
    if (text !== undefined) return text;
    if (this.#takes("[")) return this.#list(depth);
    if (this.#takes("{")) return this.#inline(depth);
    const start = this.#at;
    const [word] = this.#match(WORD) ?? [""];
    if (Object.hasOwn(NAMED, word)) return NAMED[word];
    if (NUMBER.test(word)) return Number(word.replaceAll("_", ""));
    this.#at = start;
    return this.#match(MOMENT)?.[0] ?? this.#wrong("a value");
  }

  #list(depth) {
    const values = [];
    for (this.#pass(true); !this.#takes("]"); this.#pass(true)) {
      values.push(this.#value(depth + 1));
      this.#pass(true);
      if (!this.#takes(",") && this.text[this.#at] !== "]") this.#wrong(", or ]");
    }
    return values;
  }

  #inline(depth) {
    const table = this.#table("dotted");
    this.#pass();
    for (let isFirst = true; !(isFirst && this.#takes("}")); isFirst = false) {
      this.#entry(table, depth + 1);
      this.#pass();
      if (this.#takes("}")) break;
      if (!this.#takes(",")) this.#wrong(", or }");
    }
    this.#kinds.set(table, "inline");
    return table;
  }
}
