// Figures of the engine as WebAssembly: node bits.mjs ENGINE CASES prints one line of JSON a case, hashes
// of the arrays that each function of rastercov.h writes. See tests/native/test_wasm.py.
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { Engine } from "rastercov/live_engine.js";

const [, , module, cases] = process.argv;
const engine = await Engine.of(readFileSync(module));
const call = engine.call.bind(engine);

const hash = (...arrays) => {
  const sum = createHash("sha256");
  for (const each of arrays) sum.update(new Uint8Array(each.buffer, each.byteOffset, each.byteLength));
  return sum.digest("hex");
};

for (const { vertices, faces, roles, poses, camera, lens, task, gate, isRig, points, spots } of JSON.parse(readFileSync(cases))) {
  const n = roles.length;
  const nPoses = poses.length / 16;
  const own = () => new Float64Array(n);
  const surface = call("rc_surface_create", vertices, vertices.length / 3, faces, n, Uint8Array.from(roles));
  const solver = call("rc_solver_create", surface, engine.constants.RC_CERTIFIED, 1);
  const numbers = lens && new Float64Array(Uint8Array.from(Buffer.from(lens, "base64")).buffer);
  const by = { ...camera, lens: lens && call("rc_lens_create", numbers, numbers.length) };
  const limits = { ...task, max_depth: task.max_depth ?? Infinity };
  const each = Array.from({ length: nPoses }, (_, pose) => poses.slice(16 * pose, 16 * pose + 16));
  const [network, rig] = [0, 1].map(() => call("rc_network_create", surface, 1));
  for (const made of [network, rig]) for (const pose of each) call("rc_network_add", made, by, limits, pose);
  call("rc_network_join", rig, gate, nPoses);
  const regions = [...each.map((_, pose) => call("rc_network_regions", network, pose)), call("rc_network_regions", rig, 0)];
  const areas = regions.map((of) => {
    const [area, bound] = [own(), own()];
    call("rc_regions_areas", of, 0, 1, n, area, bound);
    return [area, bound];
  });
  const measured = areas.pop();
  const union = call("rc_network_unite", network, 2);
  const views = [1, 2].map((level) => {
    const [area, bound] = [own(), own()];
    call("rc_union_areas", union, level, n, area, bound);
    return [area, bound];
  });
  const sums = new Float64Array(2 * 5);
  call("rc_union_sums", union, n, Int32Array.from({ length: n }, (_, f) => (f % 3) - 1), 2, [1, 2], sums);
  const zones = call("rc_find_zones", isRig ? rig : network, n, new Int32Array(n).fill(2), null, null);
  const [, nParts, nCorners] = call("rc_zones_size", zones);
  const columns = ["faces", "counts", "views", "zones", "reasons"].map((name) => [name, new Int32Array(nParts)]);
  const parts = { ...Object.fromEntries(columns), areas: new Float64Array(nParts), corners: new Float64Array(3 * nCorners) };
  call("rc_zones_read", zones, nParts, nCorners, parts);
  const alone = new Float64Array(nPoses);
  for (let pose = 0; pose < nPoses; pose++) {
    const one = new Float64Array(1);
    call("rc_union_alone", union, 1, regions[pose], 0, one);
    [alone[pose]] = one;
  }
  const judged = { reasons: new Uint8Array(n), coverage: own(), densities: own(), facing: own() };
  call("rc_judge_faces", solver, by, limits, poses.slice(0, 16), n, judged);
  const failures = { reasons: new Uint8Array(spots.length), hiders: new Int32Array(spots.length) };
  call("rc_judge_points", surface, by, limits, poses.slice(0, 16), spots.length, points, spots, failures);
  const clear = new Uint8Array(spots.length);
  call("rc_clear_places", surface, clear.length, points.map((x) => 1.5 * x), 0.1, clear);
  const lines = {
    regions: hash(...areas.flat()),
    together: hash(...measured),
    union: hash(...views.flat(), sums),
    zones: hash(...Object.values(parts).slice(0, 5)), // corners of circles differ by the rounding of sines
    alone: hash(alone),
    faces: hash(...Object.values(judged)),
    points: hash(...Object.values(failures)),
    clear: hash(clear),
    n_figures: 4 * nPoses * n + 2 * nPoses * n + 4 * n + 5 * nParts + nPoses + 4 * n + 2 * spots.length,
  };
  console.log(JSON.stringify(lines));
  for (const of of regions) call("rc_regions_free", of);
  for (const [kind, handle] of [["zones", zones], ["network", network], ["network", rig], ["union", union], ["solver", solver], ["surface", surface]]) {
    call(`rc_${kind}_free`, handle);
  }
}
console.log(JSON.stringify({ handles: call("rc_count_handles") }));
