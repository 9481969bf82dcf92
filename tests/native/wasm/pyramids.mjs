// Numbers of lines of the view pyramid of cameras by their names: node pyramids.mjs NAMES prints {name, lines}, and
// {name, length} of all edges. See tests/viewer/test_kept_cameras.py.
const made = () => ({ classList: { toggle() {} }, style: {}, append() {}, addEventListener() {}, setAttribute() {} });
globalThis.document = { createElement: made };
const { Frusta } = await import("rastercov/frusta.js");
const { Sketch } = await import("rastercov/sketch_pass.js");

for (const name of JSON.parse(process.argv[2])) {
  const pose = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
  const border = [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]];
  const session = {
    scene: { frame: [[0, 0, 0], [1, 1, 1]] },
    state: { stations: [{ id: 0, name, is_on: true }] },
    devices: [],
    chosen: null,
    on() {},
    station: () => null,
    shownDevices: () => [],
    poseOf: () => pose,
    cameraOf: () => ({ border }),
  };
  let draw = null;
  const view = { onSketch: (own) => (draw = own), onDrawn() {}, background: () => [1, 1, 1], camera: {}, canvas: {} };
  new Frusta(view, session, { append() {} });
  const sketch = new Sketch([0, 0, 0]);
  draw(sketch, { isParallel: true, pose });
  const ends = [];
  for (let at = 0; at < sketch.lines.length; at += 11) ends.push(sketch.lines.slice(at, at + 6));
  const edges = ends.filter(([, , z0, , , z1]) => Math.abs(z0 - z1) > 1e-9); // from the camera to its image
  const length = edges.reduce((sum, [a, b, c, x, y, z]) => sum + Math.hypot(x - a, y - b, z - c), 0);
  console.log(JSON.stringify({ name, lines: ends.length, length }));
}
