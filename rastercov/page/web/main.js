/** Puts the page together: server, picture, panels. */

import { Recorded, Server, takeToken } from "rastercov/api.js";
import { fitAll, toolBar, topBar } from "rastercov/bars.js";
import { mayHaveCameras, openCameras } from "rastercov/camera_files.js";
import { cameraPanel, largeImage } from "rastercov/camera_panel.js";
import { camerasPanel } from "rastercov/cameras_panel.js";
import { drawConstraints, hasConstraints } from "rastercov/constraints.js";
import { element, section, side, useUnit } from "rastercov/dom.js";
import { Drawing } from "rastercov/drawing.js";
import { Frusta, fieldOfStation, halfOfStation } from "rastercov/frusta.js";
import { Gizmo } from "rastercov/gizmo.js";
import { testHandle } from "rastercov/handle.js";
import { helpOverlay, listenToKeys } from "rastercov/help.js";
import { legend, summary } from "rastercov/legend.js";
import { Live } from "rastercov/live.js";
import { Navigation } from "rastercov/navigation.js";
import { networkPanel } from "rastercov/network_panel.js";
import { objectPanel } from "rastercov/object_panel.js";
import { followPieces } from "rastercov/pieces.js";
import { withScene } from "rastercov/playground.js";
import { SceneView } from "rastercov/scene_view.js";
import { Session } from "rastercov/session.js";
import { startCard } from "rastercov/start_card.js";
import { Jobs, connectionBanner, messages, offerRestart } from "rastercov/status.js";
import { tabs } from "rastercov/tabs.js";
import { Tools } from "rastercov/tools.js";
import { whyPanel, zonesPanel } from "rastercov/why.js";

async function open() {
  const data = Live.dataOfPage();
  const recorded = data ? null : Recorded.ofPage();
  const server = data || recorded ? null : new Server(takeToken());
  const live = recorded ? null : new Live(server ? await server.open() : await withScene(data), server);
  const session = new Session(recorded ?? live);
  await session.open();
  useUnit(session.scene.unit ?? "m");
  document.title = `${session.scene.title} – rastercov`;
  const canvas = element("canvas.scene", { tabindex: "0", "aria-label": "the scene; press ? for keys" });
  const overlay = element("div.overlay");
  const view = new SceneView(session, canvas);
  const frusta = new Frusta(view, session, overlay);
  const navigation = new Navigation(view);
  navigation.onHover((x, y) => frusta.hover(x, y));
  const gizmo = new Gizmo(view, session, navigation);
  const tools = new Tools(view, session, navigation, frusta, overlay);
  const jobs = new Jobs(session);
  const help = helpOverlay(session.features.flatMap((each) => each.help ?? []), session.canEdit);
  const shown = { constraints: hasConstraints(session.scene.constraints) };
  view.onSketch((sketch) => shown.constraints && drawConstraints(sketch, session.scene.constraints));
  const drawing = recorded ? null : new Drawing(view, session, tools, overlay);
  const bar = toolBar(session, { view, tools, frusta, gizmo, drawing });
  view.lookThrough = (station) => {
    bar.leavePlan();
    const [pose, camera] = [session.poseOf(station), session.cameraOf(station)];
    view.frame(() => view.camera.pin(pose, fieldOfStation(camera, canvas), halfOfStation(camera, canvas)));
  };
  const card = startCard(session, view, jobs);
  const lines = messages(session);
  let isImageShown = () => false;
  const large = largeImage(session);
  const over = element("div.over", bar, drawing?.hint, jobs.root, card);
  const colours = legend(session, view);
  view.keepFree(over, colours);
  const panels = tabs(
    [
      ["Object", objectPanel(session, view, shown)],
      ["Cameras", camerasPanel(session, { view, tools, jobs })],
      ["One camera", cameraPanel(session, view, () => isImageShown(), large)],
      ["All cameras", networkPanel(session)],
    ],
    1,
  );
  const left = side("left", "Panels", ...session.features.map((each) => each.side?.({ view, tools })), panels.root);
  panels.onShow(left.unfold);
  isImageShown = () => panels.isShown("One camera");

  document.body.replaceChildren(
    topBar(session, { summary: summary(session), help }),
    connectionBanner(session),
    element(
      "main",
      element(
        "div.stage",
        canvas,
        overlay,
        colours,
        over,
        lines,
      ),
      left,
      side("right", "Why", section("Why", [whyPanel(session, view)]), zonesPanel(session, tools)),
    ),
    help,
    large,
  );

  if (live && !server) addEventListener("beforeunload", (event) => session.state.is_saved === false && event.preventDefault());
  scrollTo(0, 0);
  document.addEventListener("dragover", (event) => event.preventDefault()); // no browser leaves the page
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    const files = [...event.dataTransfer.files];
    const [file] = files;
    if (file && files.every(({ name }) => mayHaveCameras(name)) && session.canEdit) openCameras(session, files);
    else if (file && drawing) drawing.choose(file);
    else if (file) session.emit("fault", `${file.name}: this page accepts no files`);
  });
  await view.open();
  listenToKeys({ session, view, navigation, gizmo, tools, bar, tabs: panels, help });
  fitAll(session, view);
  window.rastercov = testHandle(session, view, tools, frusta, gizmo);
  await session.refresh();
  if (live?.data.files?.length) {
    await openCameras(session, live.data.files);
    fitAll(session, view);
  }
  followPieces(session, view);
  session.watch();
  if (session.canEdit) jobs.resume();
  offerRestart(session, lines);
  if (recorded || live.data.served?.why) for (const words of session.scene.notes ?? []) session.emit("notice", words);
}

open().catch((error) => {
  console.error(error);
  const wanted =
    error.status === 403
      ? "This address has no valid key. Open the one that rastercov printed: it ends in # and the key."
      : `The page could not be opened: ${error.message}`;
  document.body.replaceChildren(element("p.failed", { role: "alert" }, wanted));
});
