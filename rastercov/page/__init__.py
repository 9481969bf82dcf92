"""Page in the browser to see a rig, move its cameras, and understand what they cover.

The page edits the rig, keeps its history and computes figures by its engine. Python opens scenes,
keeps what pages store, writes files, and answers what the engine cannot: `Session`, without a
server; `serve`, on this machine. `export_page` writes one file that needs no server.

The page, in `page/`, is plain ES modules without a build step, which import each other by bare
names (`rastercov/maths.js`) through the import map of `index.html`. A static page has them as
functions in one script: imports are one list of names each, declarations are exported where they
are made. Shaders are `shaders/viewer_*.glsl`.

main                      puts the page together
api, session              requests, or the data of a static page; the rig that is shown,
                          one act on its way; what is kept when the program is gone
scene_view, mesh_pass, pieces, creases, sketch_pass, shaders
                          the picture, drawn only when something changed: one byte a face in a
                          texture, a palette of 256 colours, parts of faces at rest, lines over it
view_camera, navigation, maths
                          orbit, pan, zoom, fit, floor plan; mouse, pen, touch; camera axes x right,
                          y down, z forward
live, live_files, live_link, live_jobs
                          the program in the page, its files, links and work
live_rig, live_paint, live_zones
                          edits and undo; colours of faces and dead zones, as Python has them
live_worker, live_solver, live_engine
                          figures beside the page, of rigs by the engine, and the engine's calls
gizmo, frusta, constraints, tools, drawing, time
                          handles; cameras, other devices; places that the plan allows; pick, aim,
                          measure, sections; the drawing under the floor plan; frames and
                          joints of bodies
object_panel, cameras_panel, camera_panel, network_panel, modes, fields, finder, tabs, start_card,
variants                  panels, and their controls from what the program says of each field
why, legend, bars, status, help, dom
                          reasons and dead zones, legend and summary, bars, messages and work, keys
handle                    `window.rastercov`, what tests reach
"""
