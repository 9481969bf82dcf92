/**
 * The engine in this page: engine.wasm, and its functions by the table that it holds itself.
 *
 * The table has kinds of results and arguments, offsets of records, and constants of rastercov.h. An
 * argument is a number, an array, an object with the fields of a record, or a handle; null is none. What a
 * function makes or counts (`handle&`, `i64&`) is no argument but its result.
 * Arrays that it writes are given, and filled.
 *
 * A call that fails throws an `EngineError`, and the module has no way back: make another one.
 */

const VIEWS = {
  f64: Float64Array,
  i32: Int32Array,
  u8: Uint8Array,
  handle: Uint32Array,
};

/** A call that the engine refused; `status` is an rc_status. */
export class EngineError extends Error {
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

/** What libc asks of a system: there is none. */
const system = new Proxy({}, { get: () => () => 8 });

export class Engine {
  #exports = null;
  #blocks = []; // of the call at work

  /** The engine of a module's bytes. */
  static async of(bytes) {
    const engine = new Engine();
    const host = {
      number: (text) => Number(engine.#text(text)),
      fail(status, text, got, remedy) {
        const words = engine.#text(text);
        throw new EngineError(remedy ? `expected ${words}, got ${got}; ${engine.#text(remedy)}` : words, status);
      },
    };
    const { instance } = await WebAssembly.instantiate(bytes, { host, wasi_snapshot_preview1: system });
    engine.#exports = instance.exports;
    instance.exports._initialize?.();
    engine.table = JSON.parse(engine.#text(instance.exports.rc_table()));
    engine.constants = engine.table.constants;
    return engine;
  }

  /** Bytes of memory that the module has. */
  get size() {
    return this.#exports.memory.buffer.byteLength;
  }

  /** Calls a function of rastercov.h, such as "rc_surface_create". */
  call(name, ...given) {
    const [, ...kinds] = this.table.functions[name];
    const made = []; // [pointer, kind] of what the function makes
    const written = []; // [pointer, array]
    try {
      const rest = given[Symbol.iterator]();
      const args = kinds.map((kind) => {
        if (kind === "handle&" || kind === "i64&") {
          made.push([this.#take(8), kind]);
          return made.at(-1)[0];
        }
        const { value, done } = rest.next();
        if (done) throw new TypeError(`${name} expects ${kinds}`);
        return this.#lowered(kind, value ?? null, written);
      });
      if (!rest.next().done) throw new TypeError(`${name} expects ${kinds}`);
      const answer = this.#exports[name](...args);
      for (const [at, array] of written) array.set(this.#view(array.constructor, at, array.length));
      if (!made.length) return answer;
      const values = made.map(([at, kind]) => this.#made(at, kind));
      return values.length > 1 ? values : values[0];
    } catch (error) {
      if (error instanceof WebAssembly.RuntimeError) {
        throw new EngineError(`the engine stopped in ${name}: ${error.message}`, this.constants.RC_FAILED);
      }
      throw error;
    } finally {
      for (const at of this.#blocks.splice(0)) this.#exports.rc_release(at);
    }
  }

  #made(at, kind) {
    const view = new DataView(this.#exports.memory.buffer);
    return kind === "handle&" ? view.getUint32(at, true) : Number(view.getBigInt64(at, true));
  }

  /** A value as the module takes it. */
  #lowered(kind, value, written) {
    if (kind === "i64") return BigInt(value);
    if (!/[*&]$/.test(kind)) return value ?? 0;
    if (value === null) return 0;
    const name = kind.slice(0, -1);
    const record = this.table.records[name];
    if (record) return this.#put(record, value, written);
    const Kind = VIEWS[name];
    const array = value instanceof Kind || kind.endsWith("&") ? value : Kind.from(value);
    if (!(array instanceof Kind)) throw new TypeError(`expected ${Kind.name}, got ${value?.constructor.name}`);
    const at = this.#take(array.byteLength);
    this.#view(Kind, at, array.length).set(array);
    if (kind.endsWith("&")) written.push([at, array]);
    return at;
  }

  /** A record in memory; one that can grow begins with its size. */
  #put(record, given, written) {
    const values = { size: record.size, ...given };
    const at = this.#take(record.size);
    new Uint8Array(this.#exports.memory.buffer, at, record.size).fill(0);
    for (const [field, [kind, offset]] of Object.entries(record.fields)) {
      const value = this.#lowered(kind, values[field] ?? null, written);
      const view = new DataView(this.#exports.memory.buffer);
      if (kind === "f64") view.setFloat64(at + offset, value, true);
      else view.setUint32(at + offset, value, true);
    }
    return at;
  }

  #take(size) {
    const at = this.#exports.rc_allocate(BigInt(size));
    this.#blocks.push(at);
    return at;
  }

  /** Memory as an array; the next call may move it. */
  #view(Kind, at, length) {
    return new Kind(this.#exports.memory.buffer, at, length);
  }

  #text(at) {
    const bytes = new Uint8Array(this.#exports.memory.buffer);
    return new TextDecoder().decode(bytes.subarray(at, bytes.indexOf(0, at)));
  }
}
