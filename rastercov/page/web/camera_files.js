/** Files of cameras that a page opens: rigs of rastercov (JSON), and calibrations of OpenCV and ROS (YAML). */

import { refuse } from "rastercov/api.js";

/** Opens a file: its cameras join those of the rig, and its poses replace those that are there. */
export async function openCameras(session, file) {
  try {
    const text = await file.text();
    const content = text.trim().startsWith("{") ? ofJson(text) : ofYaml(text.toLowerCase());
    const other = ["rule", "rigs", "rig_from_camera", "lamps", "tasks"].find((name) => name in content);
    if (other) refuse(`expected cameras and poses, got ${other}; use rastercov view`);
    const { cameras = [content], world_from_camera: poses = [], camera: of = [], images = [] } = content;
    const named = cameras.map(({ name = file.name, ...plain }) => [name, plain]);
    const stations = poses.map((pose, id) => {
      const [camera] = named[of[id] ?? 0] ?? [of[id]];
      return { id, name: images[id] ?? `camera ${id + 1}`, camera, pose: pose.flat(), is_on: true };
    });
    [[session.typeOfNext]] = named;
    await session.act({ do: "open", cameras: Object.fromEntries(named), stations });
  } catch (error) {
    session.emit("fault", `${file.name}: ${error.message}`);
  }
}

/** JSON, in which Python writes infinity. */
const ofJson = (text) => JSON.parse(text.replace(/("(?:\\.|[^"\\])*")|\bInfinity\b/g, (_, own) => own ?? "1e999"));

/** Camera of a calibration, whose pixels are counted from their centres. */
function ofYaml(text) {
  const after = (name) => text.split(`${name}:`)[1] ?? "";
  const list = (name) => after(name).split("]")[0].split("[")[1]?.split(",").map(Number) ?? [];
  const [fx, skew, cx, , fy, cy] = list("camera_matrix");
  const distortion = list("distortion_coefficients");
  const [law] = after("distortion_model").trim().split(/\s/);
  if (distortion.length === 4 && !law) refuse("expected distortion_model, got none; add plumb_bob or equidistant");
  const model = /equidistant|fisheye/.test(law) ? "opencv_fisheye" : "opencv";
  const [width, height] = ["image_width", "image_height"].map((name) => parseInt(after(name), 10));
  return { model, width, height, fx, fy, cx: cx + 0.5, cy: cy + 0.5, skew, distortion };
}
