/**
 * What tests, and the curious at the console, reach as `window.rastercov`. Places are pixels of the page
 * from the top left corner of the picture; a pixel (column, row) has its middle at (column + 0.5, row + 0.5).
 *
 * pick(x, y)                  {face, point} or null
 * readPixel(x, y, isWhole)    [r, g, b] of the mesh, or with `isWhole` of all that is drawn
 * levels()                    level of each face, an array
 * state(), summary()          as the server gave them last
 * setView(pose, field)        picture of a pinhole: world_from_camera of 16 numbers, row by row, and the
 *                             vertical field of view, degrees; its principal point is the middle
 * setOption(name, value)      isFlat, hasEdges, isCulled, isTransparent, section (4 numbers or null)
 * screenOf(point)             [x, y, depth] of a world point in the picture, or null
 * palette(level)              [r, g, b]
 * shadeLeast                  least factor of the headlight
 * whenIdle()                  ends when no answer and no picture is due
 * session, view, tools, frusta, gizmo   the objects of the page themselves
 */

import { SHADE_LEAST } from "rastercov/mesh_pass.js";
import { radians } from "rastercov/maths.js";

export function testHandle(session, view, tools, frusta, gizmo) {
  const whenIdle = async () => {
    do {
      if (!session.isIdle && session.isConnected)
        await new Promise((resolve) => session.on("idle connection", resolve));
      await new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))); // in between, observers of sizes frame the view anew
      await view.whenDrawn();
    } while (!session.isIdle && session.isConnected);
  };
  return {
    session,
    view,
    tools,
    frusta,
    gizmo,
    whenIdle,
    pick: (x, y) => view.pick(x, y),
    readPixel: (x, y, isWhole = false) => view.readPixel(x, y, isWhole),
    levels: () => [...session.levels],
    state: () => session.state,
    summary: () => session.figures.summary,
    figures: () => session.figures,
    palette: (level) => session.colourOf(level),
    shadeLeast: SHADE_LEAST,
    setView: (pose, field) => view.frame(() => view.camera.pin(pose, radians(field))),
    setOption: (name, value) => view.setOption(name, value),
    screenOf: (point) => view.look().toScreen(point),
  };
}
