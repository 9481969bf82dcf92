/**
 * The rig as the server knows it, and what this page asks of it.
 *
 * Acts wait in a queue: one is on its way, and a step of a gesture replaces the one before it that has
 * not left yet. When the server is gone, the queue and the last state are kept, and leave again when it
 * answers.
 *
 * Events: "state" (rig or task), "frame" (levels and figures), "chosen" (station), "face" (picked),
 * "connection", "restarted", "idle", "fault" (one line for the user), "notice" (one line), "mode", "phase".
 */

import { Gone, bytesOf } from "rastercov/api.js";
import { FEATURES } from "rastercov/features.js";
import { centreOf, multiply } from "rastercov/maths.js";

const PING_EVERY = 2000;
const REST = 150; // ms after a step of a drag without another one
/** Name of the rig and the time of a state, which figures are of. */
export const keyOf = ({ revision, at = [], goal = "" }) => `${revision} ${at} ${goal}`;

const KEPT_KEY = "rastercov-kept";
const KEY_IS_OLD = "rastercov was restarted with a new key; open the address that it printed";

/**
 * Features are functions of a session that is open: what each adds there, or null. That may be `side({view, tools})`,
 * a panel above all others; `network()`, one of the panel "Network"; `key(event)`, true for a key that it
 * used; and `help`, sections on keys. One may set `phases` for a scene of several: `at`, numbers that name
 * the one that is shown, and `show(at, bodies)`, by poses of bodies if they are sent.
 */
export class Session {
  #listeners = new Map();
  #queue = [];
  #isSending = false;
  #nAnswers = 0; // to acts
  #rest = 0; // timer of what a drag leaves out

  constructor(server) {
    this.server = server;
    this.isConnected = true;
    this.chosen = null; // id of a station
    this.face = null; // index of the picked face
    this.isWorking = false; // work of this page runs in the program, and will change the rig
    this.reloads = 0; // how often the state of another tab was taken: gestures begun before are void
    this.localPoses = new Map(); // station -> pose that is not the server's yet
    this.options = {}; // mode -> values of its fields
    this.phases = null;
    this.goal = ""; // of the plan, "" for its task
  }

  on(events, listener) {
    for (const event of events.split(" ")) {
      if (!this.#listeners.has(event)) this.#listeners.set(event, []);
      this.#listeners.get(event).push(listener);
    }
  }

  /** Listens, and begins with the present. */
  follow(events, listener) {
    this.on(events, listener);
    listener();
  }

  emit(event, detail) {
    for (const listener of this.#listeners.get(event) ?? []) listener(detail);
  }

  /** Does what may fail, and says why it did. */
  async attempt(act) {
    try {
      await act();
    } catch (error) {
      this.emit("fault", error.message);
    }
  }

  /** Reads the scene and the state; the first frame comes by `act`. */
  async open() {
    const [scene, soup, groups, state] = await Promise.all([
      this.server.scene(),
      this.server.soup(),
      this.server.groups(),
      this.server.state(),
    ]);
    Object.assign(this, { scene, corners: soup.corners, origin: soup.origin, faceGroups: groups, state });
    this.cornersAtRest = soup.corners;
    this.features = FEATURES.map((of) => of(this)).filter(Boolean);
    this.phases?.show(state.at);
    this.goal = state.goal ?? "";
    const modes = scene.modes.filter((mode) => this.server.hasMode?.(mode.id) ?? true);
    scene.modes = modes;
    for (const mode of modes) {
      this.options[mode.id] = Object.fromEntries((mode.options ?? []).map((f) => [f.name, f.default]));
    }
    this.mode = modes[0].id;
    this.chosen = state.stations[0]?.id ?? null;
  }

  get canEdit() {
    return Boolean(this.scene?.can_edit) && !this.server.isRecorded;
  }

  get isIdle() {
    return this.#queue.length === 0 && !this.#isSending;
  }

  station(id = this.chosen) {
    return this.state.stations.find((station) => station.id === id) ?? null;
  }

  /** Devices beside the cameras whose places may be changed. */
  get devices() {
    return this.state.devices.filter((device) => device.pose);
  }

  /** What is chosen: a station, a device, or null. */
  device(id = this.chosen) {
    return this.station(id) ?? this.devices.find((device) => device.id === id) ?? null;
  }

  /** Head of several sensors that a station is of; undefined for a single camera. */
  headOf(id) {
    return this.state.heads?.find(({ ids }) => ids.length > 1 && ids.includes(id));
  }

  /** Puts a camera or a device at a pose. */
  place(device, pose, options = {}) {
    const action = "rides" in device ? { do: "device", device: device.id, pose } : { do: "pose", station: device.id, pose };
    return this.act(action, options);
  }

  cameraOf(station) {
    return this.state.cameras[station.camera];
  }

  /** Colour of a level of the frame. */
  colourOf(level) {
    return [...this.palette.subarray(3 * level, 3 * level + 3)];
  }

  modeOf(id = this.mode) {
    return this.scene.modes.find((mode) => mode.id === id);
  }

  /** Pose of a station as it is shown: that of a drag goes before the server's. */
  poseOf(station) {
    return this.localPoses.get(station.id) ?? station.pose;
  }

  /** Devices as they are shown, {device, pose}: one that rides is on each camera that has it and is on. */
  shownDevices() {
    const on = this.state.stations.filter((station) => station.is_on);
    return this.state.devices.flatMap((device) => {
      if (device.pose) return [{ device, pose: this.poseOf(device) }];
      const carriers = on.filter((station) => device.rides[station.camera]);
      return carriers.map((station) => ({ device, pose: multiply(this.poseOf(station), device.rides[station.camera]) }));
    });
  }

  /** Centres of all cameras as they are shown, world. */
  centres() {
    return this.state.stations.map((station) => centreOf(this.poseOf(station)));
  }

  choose(id) {
    if (id === this.chosen) return;
    this.chosen = id;
    this.emit("chosen", id);
    if (this.modeOf().panel === "camera" && this.station()) this.refresh();
  }

  /** Chooses the next camera of the list, or the one before it. */
  chooseNext(step) {
    const { stations } = this.state;
    if (!stations.length) return;
    const at = stations.findIndex((station) => station.id === this.chosen);
    this.choose(stations[(at + step + stations.length) % stations.length].id);
  }

  setMode(id) {
    if (id === this.mode) return;
    this.mode = id;
    this.emit("mode", id);
    this.refresh();
  }

  /** Numbers that name the phase of the scene that is shown. */
  get at() {
    return this.phases?.at ?? [];
  }

  /** Shows the task, "", or a goal of the plan. */
  setGoal(name) {
    this.goal = name;
    return this.refresh();
  }

  setOption(name, value, isDrag = false) {
    this.options[this.mode] = { ...this.options[this.mode], [name]: value };
    this.act({ do: "none" }, { isDrag });
  }

  /** Figures of the present mode once more. */
  refresh() {
    return this.act({ do: "none" });
  }

  /**
   * Sends an action; the promise ends with its frame, or with null where a later step replaced it.
   *
   * @param {object} action as the server takes it
   * @param {object} options isDrag: a step of a gesture that is not over
   */
  act(action, { isDrag = false } = {}) {
    if (isMove(action)) {
      this.localPoses.set(action.station ?? action.device, action.pose);
      this.emit("poses");
    }
    return new Promise((resolve) => {
      const item = { action, isDrag, resolve, isSent: false };
      const last = this.#queue.at(-1);
      if (last && !last.isSent && replaces(item, last)) this.#queue.pop().resolve(null);
      this.#queue.push(item);
      this.#send();
    });
  }

  async #send() {
    if (this.#isSending || !this.isConnected) return;
    this.#isSending = true;
    this.emit("busy");
    while (this.#queue.length && this.isConnected) {
      const item = this.#queue[0];
      item.isSent = true;
      try {
        const frame = await this.server.act({
          revision: this.state.revision,
          mode: this.mode,
          options: this.options[this.mode],
          station: this.station()?.id ?? null,
          is_drag: item.isDrag,
          at: this.at,
          goal: this.goal,
          action: item.action,
        });
        this.#queue.shift();
        this.#adopt(frame, item.action);
        item.resolve(frame.json);
      } catch (error) {
        item.isSent = false;
        if (error instanceof Gone) {
          this.#setConnected(false);
        } else {
          await this.#refused(error, item);
        }
      }
    }
    this.#isSending = false;
    if (this.isIdle) this.emit("idle");
  }

  async #refused(error, item) {
    if (error.status === 403) {
      this.#setConnected(false, KEY_IS_OLD);
      return;
    }
    this.#queue.shift();
    item.resolve(null);
    this.localPoses.clear();
    if (error.status === 409) {
      for (const other of this.#queue.splice(0)) other.resolve(null);
      await this.reload(
        "Another tab changed the rig, and this page now shows the new rig; your last change was discarded.",
      );
    } else {
      this.emit("fault", error.message);
      this.emit("poses");
      this.emit("state", this.state);
      if (this.figures && this.mode !== this.figures.mode) this.setMode(this.figures.mode); // what is shown
    }
  }

  #adopt({ json, payload }, action) {
    const { state, bodies, notice, ...figures } = json;
    this.#nAnswers += 1;
    const isLater = this.#queue.some((item) => isMove(item.action));
    if (!isLater) this.localPoses.clear();
    const known = new Set(this.state.stations.map((station) => station.id));
    this.state = state;
    if (bodies && String(state.at) === String(this.at)) this.phases.show(state.at, bodies);
    const added = state.stations.find((station) => !known.has(station.id));
    const isChosenGone = this.chosen !== null && !this.device();
    this.figures = figures;
    if (figures.legend.length === 1) figures.legend[0].hatch = 0; // nothing to tell it from
    this.levels = payload;
    this.palette = bytesOf(figures.palette);
    this.#keep();
    clearTimeout(this.#rest);
    if (figures.is_partial) this.#rest = setTimeout(() => this.isIdle && this.refresh(), REST);
    if (added && ["add", "duplicate"].includes(action.do)) {
      this.chosen = added.id;
      this.emit("chosen", added.id);
    } else if (isChosenGone) {
      this.chosen = state.stations[0]?.id ?? null;
      this.emit("chosen", this.chosen);
    }
    this.emit("state", state);
    this.emit("frame", figures);
    if (notice) this.emit("notice", `${this.device()?.name ?? "camera"}: ${notice}.`);
  }

  /** Takes the server's state, whatever this page showed. */
  async reload(words = "") {
    try {
      this.reloads += 1;
      await this.server.load();
      this.state = await this.server.state();
      this.phases?.show(this.state.at);
      this.goal = this.state.goal ?? "";
      this.localPoses.clear();
      if (this.chosen !== null && !this.device()) this.chosen = this.state.stations[0]?.id ?? null;
      this.emit("state", this.state);
      this.emit("chosen", this.chosen);
      if (words) this.emit("notice", words);
      this.refresh();
    } catch (error) {
      if (error instanceof Gone) this.#setConnected(false);
      else this.emit("fault", error.message);
    }
  }

  /** Takes a change of this page's own making, such as that of a job or of saving. */
  async takeOver() {
    this.state = await this.server.state();
    await this.refresh();
  }

  /** [done, total] of the cameras that the program measures now. */
  async measured() {
    return (await this.server.ping?.())?.measured ?? [];
  }

  /** Asks every two seconds whether the server is there and the rig still ours. */
  watch() {
    if (this.server.isRecorded) return;
    setInterval(() => this.check(), PING_EVERY);
    window.addEventListener("hashchange", () => location.reload());
  }

  async check() {
    if (this.#isSending || this.isChecking) return;
    this.isChecking = true;
    const before = this.#nAnswers;
    try {
      const { revision, ...shown } = await this.server.ping();
      const isBack = !this.isConnected;
      if (isBack) this.#setConnected(true);
      if (this.#isSending || before !== this.#nAnswers) return; // an act has overtaken this answer
      if (isBack) await this.#comeBack(revision);
      else if (keyOf({ revision, ...shown }) !== keyOf(this.state) && this.isIdle && !this.isWorking) {
        await this.reload("Another tab changed the rig, and this page now shows the new rig.");
      }
    } catch (error) {
      this.#setConnected(false, error.status === 403 ? KEY_IS_OLD : "");
    } finally {
      this.isChecking = false;
    }
  }

  /** The server answers again: what waits leaves, or what it lost is offered. */
  async #comeBack(revision) {
    const kept = this.state;
    if (revision !== kept.revision) await this.server.load();
    const state = await this.server.state();
    const isSame = state.session === kept.session;
    if (isSame && revision === kept.revision) {
      this.emit("notice", "rastercov responds again; nothing was lost.");
      this.#send();
      if (this.isIdle) this.refresh();
      return;
    }
    if (isSame) {
      // The act on its way when the line broke may have arrived; poses are absolute and leave again.
      const waiting = this.#queue.splice(0);
      this.state = state;
      this.emit("state", state);
      for (const { action, resolve } of waiting) {
        if (["pose", "device", "camera", "task", "switch", "rename"].includes(action.do)) this.act(action);
        resolve(null);
      }
      this.refresh();
      this.emit("notice", "rastercov responds again.");
      return;
    }
    for (const { resolve } of this.#queue.splice(0)) resolve(null);
    const poses = new Map(this.localPoses);
    this.state = state;
    this.localPoses.clear();
    await this.restore({
      ...kept,
      stations: kept.stations.map((s) => ({ ...s, pose: poses.get(s.id) ?? s.pose })),
    });
    this.emit("restarted");
    this.emit("notice", "rastercov was restarted; the rig of this page was restored.");
  }

  /** Puts a state that this page kept in place of the server's, as one step that can be undone. */
  restore(kept) {
    const { stations, cameras, task } = kept;
    return this.act({ do: "restore", rig: { stations, cameras, task } });
  }

  #setConnected(isConnected, words = "") {
    if (isConnected === this.isConnected && !words) return;
    this.isConnected = isConnected;
    this.emit("connection", { isConnected, words });
  }

  /** Keeps the rig for a later page of this tab, in case this one is lost. */
  #keep() {
    if (!this.canEdit || !this.state.can_undo) return; // nothing of this run: leave what another left
    const { stations, cameras, task, session } = this.state;
    const kept = { title: this.scene.title, session, isSaved: this.state.is_saved, stations, cameras, task };
    try {
      sessionStorage.setItem(KEPT_KEY, JSON.stringify(kept));
    } catch {
      // full, or forbidden by the browser: the page itself still has the rig
    }
  }

  /** What an earlier page of this tab kept of the same scene and another run of the program, or null. */
  lost() {
    try {
      const kept = JSON.parse(sessionStorage.getItem(KEPT_KEY));
      const isOther = kept && kept.session !== this.state.session && kept.title === this.scene.title;
      return isOther && !kept.isSaved ? kept : null;
    } catch {
      return null;
    }
  }

  /** The file that "Save rig" writes, with moves that wait for the program. */
  rigFile() {
    const { server, localPoses } = this;
    const { state } = server.history;
    const shown = server.shown(state);
    const stations = shown.stations.map((each) => (localPoses.has(each.id) ? { ...each, pose: this.poseOf(each) } : each));
    return server.texts(server.atRest({ ...state, stations }, shown, state)).rig;
  }
}

/** Whether an act puts a camera or a device at a pose. */
const isMove = (action) => action.do === "pose" || action.do === "device";

/** Whether a newer act makes an older one that has not left pointless. */
function replaces(newer, older) {
  const [a, b] = [newer.action, older.action];
  if (a.do === "none" && b.do === "none") return true;
  if (!older.isDrag || a.do !== b.do || a.station !== b.station) return false;
  if (a.camera !== b.camera || a.device !== b.device) return false;
  const keys = (action) => Object.keys(action.changes ?? {}).join();
  return keys(a) === keys(b);
}
