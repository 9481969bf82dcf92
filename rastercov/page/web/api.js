/**
 * The program behind a served page, and the data of a static export, which stands for `Live`: all methods
 * give promises.
 *
 * A binary answer is a frame: uint32 little-endian n, n bytes of JSON, payload.
 */

import { UNITS } from "rastercov/fields.js";
import { Refused } from "rastercov/plain.js";
import { number } from "rastercov/texts.js";

const TOKEN_HEADER = "X-Rastercov-Token";
const TOKEN_KEY = "rastercov-token";

/** Says no to a request. */
export function refuse(words) {
  throw new Refused(words);
}

/** Says no in the form that all such lines have; texts that a file gave are cut short. */
export const expected = (wanted, got, remedy = "export it again", where = "") => refuse(`${where}expected ${wanted}, got ${(typeof got === "object" ? JSON.stringify(got) : String(got)).slice(0, 60)}; ${remedy}`);

/** No answer at all: the program has ended, or the network is down. */
export class Gone extends Error {}

/** Token from the address (taken out of it) or from this tab's memory. */
export function takeToken() {
  const token = location.hash.slice(1);
  if (token) {
    sessionStorage.setItem(TOKEN_KEY, token);
    history.replaceState(null, "", location.pathname);
  }
  return token || sessionStorage.getItem(TOKEN_KEY) || "";
}

/** The program: it opens a scene, keeps what pages store, and answers what they cannot. */
export class Server {
  constructor(token) {
    this.token = token;
  }

  open = () => this.#json("open");
  load = () => this.#json("load");
  store = (changes) => this.#json("store", postOf(changes));
  job = () => this.#json("job");
  ping = () => this.#json("ping", { signal: AbortSignal.timeout(8000) });
  startJob = (what) => this.#json("job", postOf(what));
  cancelJob = () => this.#json("job/cancel", postOf({}));
  drawing = () => this.#json("drawing");
  keepDrawing = (changes) => this.#json("drawing", postOf(changes));
  save = (what) => this.#json("save", postOf(what));
  download = async (what) => (await this.#ask("download", postOf(what))).blob();

  /** Answer to a question: JSON, or a frame. */
  async ask(question) {
    const answer = await this.#ask("ask", postOf(question));
    return answer.headers.get("Content-Type") === "application/json" ? answer.json() : frameOf(await answer.arrayBuffer());
  }

  async #json(path, options) {
    return (await this.#ask(path, options)).json();
  }

  async #ask(path, options = {}) {
    let response;
    try {
      response = await fetch(`/api/${path}`, {
        ...options,
        cache: "no-store",
        headers: { ...options.headers, [TOKEN_HEADER]: this.token },
      });
    } catch (error) {
      throw new Gone(`rastercov does not respond: ${error.message}`);
    }
    if (response.ok) return response;
    const text = await response.text();
    let message = `the server answered ${response.status}`;
    try {
      message = JSON.parse(text).error ?? message;
    } catch {
      // no JSON: the status has to do
    }
    throw new Refused(message, response.status);
  }
}

const postOf = (body) => ({
  method: "POST",
  headers: { "Content-Type": "application/json" },
  body: JSON.stringify(body),
});

/** {json, payload} of a frame. */
function frameOf(buffer) {
  const n = new DataView(buffer).getUint32(0, true);
  const json = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, n)));
  return { json, payload: new Uint8Array(buffer, 4 + n) };
}

/** Base64 text of bytes. */
export function base64Of(bytes) {
  const [own, parts] = [Uint8Array.from(bytes), []];
  for (let at = 0; at < own.length; at += 0x8000) parts.push(String.fromCharCode(...own.subarray(at, at + 0x8000)));
  return btoa(parts.join(""));
}

/** Bytes of base64 text. */
export function bytesOf(text) {
  const characters = atob(text);
  const bytes = new Uint8Array(characters.length);
  for (let at = 0; at < bytes.length; at++) bytes[at] = characters.charCodeAt(at);
  return bytes;
}

/** The data of a static export, which answers what a look needs and refuses every change. */
export class Recorded {
  constructor(data) {
    this.data = data;
    this.isRecorded = true;
    this.at = []; // the phase of the last figures
    this.hasZones = data.zones?.length > 0;
  }

  /** The export of this page, or null where a server is behind it. */
  static ofPage() {
    const holder = document.getElementById("export");
    return holder ? new Recorded(JSON.parse(holder.textContent)) : null;
  }

  scene = async () => this.data.scene;
  state = async () => this.data.state;
  zones = async () => this.data.zones ?? [];
  soup = async () => ({
    corners: new Float32Array(bytesOf(this.data.soup).buffer),
    origin: this.data.origin ?? [0, 0, 0],
  });
  groups = async () => new Uint16Array(bytesOf(this.data.groups).buffer);

  /** Frame of a mode, or of its phase, "mode@at". */
  async act({ mode, at, action }) {
    if (action.do !== "none")
      refuse("this file shows a result; open the plan with rastercov view to change it");
    const { frames } = this.data;
    this.at = at;
    const frame = frames[[mode, ...at].join("@")] ?? frames[mode];
    if (!frame) throw new Refused(`this file has no figures of ${mode}`, 404);
    return { json: { state: this.data.state, ...frame }, payload: bytesOf(frame.levels) };
  }

  /** Modes that the file holds. */
  hasMode = (mode) => Object.keys(this.data.frames).some((key) => key.split("@")[0] === mode);

  /** Whether the file has figures of each phase of the scene. */
  hasPhases = (mode) => Object.keys(this.data.frames).some((key) => key.startsWith(`${mode}@`));

  /** Group of a face and its label in each mode. */
  async why(face) {
    const isShown = ([key]) => key !== "segments" && (!key.includes("@") || key.endsWith(`@${this.at.join("@")}`));
    const figures = Object.entries(this.data.frames).filter(isShown).map(([mode, frame]) => {
      const level = atob(frame.levels).charCodeAt(face);
      return {
        label: this.data.scene.modes.find((each) => each.id === mode.split("@")[0])?.label ?? mode,
        value: labelOfLevel(frame, level),
      };
    });
    return { face, group: null, area: null, words: "", cameras: [], levels: figures };
  }
}

/** Words of a level by the legend of its frame. */
export function labelOfLevel(frame, level) {
  const entry = frame.legend?.find((each) => each.level === level);
  if (entry) return entry.label;
  const { scale } = frame;
  if (!scale || level < scale.first || level > scale.last) return "–";
  const part = (level - scale.first) / Math.max(1, scale.last - scale.first);
  const value = scale.is_log
    ? scale.low * (scale.high / scale.low) ** part
    : scale.low + part * (scale.high - scale.low);
  return [number(value), UNITS[scale.unit] ?? scale.unit].join(" ").trim().replace(" °", "°");
}
