/**
 * A rig in the address of a page: names, cameras that were changed, thresholds, and poses to their last bit,
 * as base64 of zlib. Ten cameras have less than 2 kB. Nothing is sent: a fragment stays in the browser.
 */

import { base64Of, bytesOf } from "rastercov/api.js";

const MARK = "#rig=";

/** Fragment of a state; `first` is that of the file. */
export async function fragmentOf({ stations, cameras, task, needed }, first) {
  const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
  const changed = Object.entries(cameras).filter(([name, each]) => !same(each, first.cameras[name]));
  const limits = Object.entries(task).filter(([name, value]) => !same(value, first.task[name]));
  const names = Object.keys(cameras);
  const head = {
    stations: stations.map(({ name, camera, is_on: isOn }) => [name, names.indexOf(camera), Number(isOn)]),
    names,
    cameras: Object.fromEntries(changed),
    task: Object.fromEntries(limits),
    needed,
  };
  const text = new TextEncoder().encode(JSON.stringify(head));
  const poses = Float64Array.from(stations.flatMap(({ pose }) => pose.slice(0, 12)));
  const bytes = new Blob([Uint32Array.of(text.length), text, poses]);
  return MARK + base64Of(await through(bytes, new CompressionStream("deflate"))).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

/** The rig of a fragment, as the edit "restore" takes it; null where there is none. */
export async function rigOfFragment(hash, first) {
  if (!hash.startsWith(MARK)) return null;
  const packed = bytesOf(hash.slice(MARK.length).replaceAll("-", "+").replaceAll("_", "/"));
  const bytes = await through(packed, new DecompressionStream("deflate"));
  const end = 4 + new Uint32Array(bytes.slice(0, 4).buffer)[0];
  const poses = new Float64Array(bytes.slice(end).buffer);
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(4, end)));
  const stations = head.stations.map(([name, camera, isOn], row) => ({
    id: row,
    name: String(name),
    camera: head.names[camera],
    is_on: Boolean(isOn),
    place: "allowed",
    pose: [...poses.subarray(12 * row, 12 * row + 12), 0, 0, 0, 1],
  }));
  return { stations, cameras: { ...first.cameras, ...head.cameras }, task: { ...first.task, ...head.task }, needed: head.needed };
}

/** Bytes that a stream makes of others. */
export const through = async (bytes, stream) => new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(stream)).arrayBuffer());
