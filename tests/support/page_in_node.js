/** Calls of pages of a viewer from lines of JSON, and what they need of a program; behind the modules of a page. */

globalThis.location = { protocol: "about:", hash: "" };
const { Live } = live_js;
const lives = new Map();
let [text, waiting] = ["", []];
const lines = [];
process.stdin.on("data", (data) => {
  text += data;
  const whole = text.split("\n");
  text = whole.pop();
  for (const line of whole) {
    const said = JSON.parse(line);
    if (waiting.length && "answer" in said) waiting.shift()(said);
    else run(said);
  }
});
const say = (what) => process.stdout.write(`${JSON.stringify(what)}\n`);
const packed = (found) => (found?.payload ? { ...found, payload: Buffer.from(found.payload).toString("base64") } : found);
const need = (name, given) => new Promise((resolve, reject) => {
  waiting.push(({ answer, fault, status }) => {
    if (fault !== undefined) reject(new plain_js.Refused(fault, status));
    else resolve(answer?.payload === undefined ? answer : { ...answer, payload: new Uint8Array(Buffer.from(answer.payload, "base64")) });
  });
  say({ need: name, given });
});
const server = new Proxy({}, { get: (_, name) => (given) => need(name, given) });
const calls = {
  start: async (id) => {
    lives.set(id, new Live(await server.open(), server));
    await lives.get(id).scene();
  },
  asked: (id) => lives.get(id).asked(),
  texts: (id, state) => lives.get(id).texts(state ?? undefined),
  step: (id, by) => lives.get(id).history.go(by),
  work: async (id, { isCancelled, edit, ...what }) => {
    const live = lives.get(id);
    const act = (action) => live.act({ revision: live.history.revision, mode: "reason", at: live.asked().at, goal: live.goal, action });
    if (what.isResumed) await live.resume();
    else await live.startJob(what);
    if (edit) await act(edit);
    if (isCancelled) await live.cancelJob();
    for (;;) {
      const said = await live.job();
      if (said.status !== "running") {
        await act({ do: "none" });
        return said;
      }
      await new Promise((resolve) => setTimeout(resolve, 1));
    }
  },
  lens: (id, { camera, changes, models }) => {
    const state = { stations: [], cameras: { own: camera }, task: {}, models };
    return live_rig_js.editState(state, { do: "camera", camera: "own", changes })[0].cameras.own.plain;
  },
};
async function run({ id, call, given }) {
  try {
    const found = call in calls ? await calls[call](id, given) : await lives.get(id)[call](given);
    say({ done: packed(found) ?? null });
  } catch (error) {
    say({ fault: error.message, status: error.status ?? 0, stack: error.stack });
  }
}
