/**
 * Files of a page that computes: the rig, the plan and its surfaces, which `rastercov check` takes, with the
 * figures of the page.
 */

/** The rig, as JSON. */
export function rigFile({ stations, cameras }, hasUnit) {
  const names = Object.keys(cameras).filter((name) => stations.some((each) => each.camera === name));
  const tasks = Object.fromEntries(names.filter((name) => cameras[name].task).map((name) => [name, cameras[name].task]));
  const content = {
    ...(hasUnit ? {} : { has_unit: false }),
    cameras: names.map((name) => ({ name, ...cameras[name].plain })),
    ...(Object.keys(tasks).length ? { tasks } : {}),
    world_from_camera: stations.map(({ pose }) => [0, 4, 8, 12].map((row) => pose.slice(row, row + 4))),
    camera: stations.map((each) => names.indexOf(each.camera)),
    images: stations.map((each) => each.name),
  };
  return `${JSON.stringify(content)}\n`;
}

/** Surfaces as OBJ, [{name, text, role, groups, twoSided}]: the task with what hides, and targets. */
export function surfaceFiles({ groups }, { vertices, faces, groupOf }) {
  const isTarget = groups.map(({ role }) => role === "target");
  const parts = [
    ["scene.obj", "occluder", (group) => !isTarget[group]],
    ["targets.obj", "target", (group) => isTarget[group]],
  ];
  return parts.flatMap(([name, role, isIn]) => {
    const own = groups.map((each, row) => ({ ...each, row })).filter(({ row }) => isIn(row) && groupOf.includes(row));
    if (!own.length) return [];
    const hiding = role === "target" ? own : own.filter((each) => each.role === "occluder");
    const text = objOf(vertices, faces, groupOf, groups, isIn);
    return { name, text, role: hiding.length ? role : "task", groups: hiding.map(nameOf), twoSided: own.filter((each) => each.is_two_sided).map(nameOf) };
  });
}

const nameOf = ({ name }) => name.replace(/\p{Cc}/gu, " ");

/** Vertices with all their digits, and faces by group, in their order. */
function objOf(vertices, faces, groupOf, groups, isIn) {
  const lines = [];
  for (let v = 0; v < vertices.length; v += 3) lines.push(`v ${vertices[v]} ${vertices[v + 1]} ${vertices[v + 2]}`);
  let last = -1;
  groupOf.forEach((group, face) => {
    if (!isIn(group)) return;
    if (group !== last) lines.push(`g ${nameOf(groups[group])}`);
    last = group;
    lines.push(`f ${faces[3 * face] + 1} ${faces[3 * face + 1] + 1} ${faces[3 * face + 2] + 1}`);
  });
  return `${lines.join("\n")}\n`;
}

/** Plan of the surfaces with the thresholds of a state, as TOML; `defaults` are those of a task. */
export function planFile({ task, needed }, surfaces, defaults) {
  const lines = [];
  for (const { name, role, groups, twoSided } of surfaces) {
    lines.push("[[meshes]]", `path = ${toml(name)}`, `role = ${toml(role)}`);
    if (groups.length) lines.push(`groups = ${toml(groups)}`);
    if (twoSided.length) lines.push(`two_sided = ${toml(twoSided)}`);
  }
  lines.push("[task]");
  for (const [name, value] of Object.entries(task)) {
    if (value !== null && value !== defaults[name] && !(needed && name === "views")) lines.push(`${name} = ${toml(value)}`);
  }
  const views = Object.entries(needed ?? {}).map(([name, value]) => `${toml(name)} = ${value}`);
  if (views.length) lines.push(`views = { ${views.join(", ")} }`);
  return `${lines.join("\n")}\n`;
}

/** A text, number, truth value or list of them as TOML, which has them as JSON does, DEL apart. */
const toml = (value) => JSON.stringify(value).replaceAll("\x7f", "\\u007f");
