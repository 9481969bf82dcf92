/** Lines for the user: short ones that pass, the banner of a lost server, and the work in progress. */

import { button, count, element } from "rastercov/dom.js";

const SHOWN_FOR = 6000;
const JOB_EVERY = 400;

/** Messages at the bottom; a fault stays until it is closed. */
export function messages(session) {
  const root = element("div.messages", { "aria-live": "polite" });
  const say = (text, kind, more = []) => {
    for (const old of root.children) if (old.dataset.text === text) old.remove();
    const line = element(
      `div.message.${kind}`,
      { role: kind === "fault" ? "alert" : "status", "data-text": text },
      element("span", text),
      more,
      button("×", () => line.remove(), { kind: "quiet", "aria-label": "close" }),
    );
    root.append(line);
    if (root.children.length > 4) root.firstChild.remove();
    if (kind !== "fault" && !more.length) setTimeout(() => line.remove(), SHOWN_FOR);
    return line;
  };
  session.on("fault", (text) => say(text, "fault"));
  session.on("notice", (text) => say(text, "notice"));
  root.say = say;
  return root;
}

/** Offers a text as a file of the user's. */
export function offerFile(name, content, type = "application/json") {
  const blob = content instanceof Blob ? content : new Blob([content], { type });
  const link = element("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** Banner while the program does not answer; the rig is in the page and can be taken from it. */
export function connectionBanner(session) {
  const words = element("span");
  const root = element(
    "div.banner",
    { role: "alert", hidden: true },
    words,
    button("Download the rig", () => session.attempt(() => offerFile("rig.json", session.rigFile())), { title: "for rastercov view --poses" }),
    button("Try again", () => session.check()),
  );
  session.on("connection", ({ isConnected, words: reason }) => {
    root.hidden = isConnected;
    words.textContent = `${reason || "rastercov does not respond"}. Your rig is kept in this page; figures wait for rastercov.`;
    document.body.classList.toggle("offline", !isConnected);
  });
  return root;
}

/** What an earlier page of this tab kept can be put back. */
export function offerRestart(session, lines) {
  const kept = session.lost();
  if (!kept) return;
  const line = lines.say(
    "rastercov was restarted. This tab still has an unsaved rig.",
    "notice",
    [
      button("Restore the rig", () => {
        line.remove();
        session.restore(kept);
      }),
    ],
  );
}

/** The work that runs in the program: one at a time, with its progress, and a way to end it. */
export class Jobs {
  constructor(session) {
    this.session = session;
    this.bar = element("progress", { max: 1 });
    this.words = element("strong");
    this.times = element("span.soft.times");
    this.root = element(
      "div.job",
      { hidden: true, role: "status" },
      element("div.what", this.words, this.bar, this.times),
      button("Cancel", () => this.#cancel(), { title: "cancel and keep the rig unchanged" }),
    );
  }

  async start(what) {
    if (this.isRunning) {
      this.session.emit("notice", "Another job is running: wait, or cancel it.");
      return;
    }
    await this.#run(() => this.session.server.startJob(what));
  }

  /** Follows work that an earlier page of this program began. */
  async resume() {
    await this.session.server.resume();
    const { status } = await this.session.server.job();
    if (status === "running" && !this.isRunning) await this.#run(() => {});
  }

  async #run(begin) {
    this.isRunning = true;
    this.session.isWorking = true;
    this.session.emit("job");
    await this.session.attempt(async () => {
      await begin();
      await this.#follow();
    });
    this.isRunning = false;
    this.session.isWorking = false;
    this.root.hidden = true;
    this.session.emit("job");
  }

  async #follow() {
    this.root.hidden = false;
    this.words.textContent = "starting…";
    this.times.textContent = "";
    this.bar.removeAttribute("value");
    for (;;) {
      const job = await this.session.server.job();
      if (job.id === null || job.status !== "running") {
        this.isRunning = false; // the next may begin while its result is drawn
        if (job.status === "failed") this.session.emit("fault", job.words);
        else if (job.words) this.session.emit("notice", job.words);
        if (job.status === "done") {
          const known = new Set(this.session.state.stations.map((station) => station.id));
          await this.session.takeOver();
          const added = this.session.state.stations.find((station) => !known.has(station.id));
          if (added) this.session.choose(added.id);
        }
        return;
      }
      const step = job.words || "starting…";
      this.words.textContent = job.kind === "place" ? `Placing cameras: ${step}` : step;
      this.times.textContent = timesOf(job);
      if (job.total) this.bar.value = job.done / job.total;
      else this.bar.removeAttribute("value");
      await new Promise((resolve) => setTimeout(resolve, JOB_EVERY));
    }
  }

  #cancel() {
    this.words.textContent = "cancelling…";
    this.session.attempt(() => this.session.server.cancelJob());
  }
}

/** What is done of a step, and how long the work has taken and its step will take. */
function timesOf({ kind, done, total, seconds, step_seconds: ofStep }) {
  const parts = [];
  if (total) parts.push(`${count(done)} of ${count(total)}${kind === "place" ? "" : " poses"}`);
  if (seconds !== undefined) parts.push(duration(seconds));
  if (total && done && ofStep > 1) parts.push(`about ${duration((ofStep * (total - done)) / done)} left`);
  return parts.join(" · ");
}

function duration(seconds) {
  const whole = Math.round(seconds);
  return whole < 60 ? `${whole} s` : `${Math.floor(whole / 60)} min ${whole % 60} s`;
}
