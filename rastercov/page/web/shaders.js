/** Programs of WebGL2 from the GLSL files of the project; a static export holds their text itself. */

const texts = new Map();

/** Text of one stage, such as "viewer_mesh.vert". */
async function source(name) {
  if (!texts.has(name)) texts.set(name, embeddedText(name) ?? (await fetchText(name)));
  return texts.get(name);
}

/** Text in the export's JSON of shaders, or null. */
function embeddedText(name) {
  const holder = document.getElementById("shaders");
  return holder ? JSON.parse(holder.textContent)[name] : null;
}

async function fetchText(name) {
  const response = await fetch(`/static/shaders/${name}.glsl`);
  if (!response.ok) throw new Error(`shader ${name}.glsl is missing; reinstall rastercov`);
  return response.text();
}

/** Reads all stages, before the first program is made. */
export const loadShaders = (names) => Promise.all(names.map(source));

/**
 * Linked program, with its uniforms by name and its attributes at the places in `attributes`.
 *
 * @param {WebGL2RenderingContext} gl
 * @param {[string, string]} stages names of vertex and fragment stage, loaded by `loadShaders`
 * @param {string[]} attributes names, in the order of their locations
 * @param {object} defines written as `#define NAME value`
 */
export function program(gl, stages, attributes, defines = {}) {
  const made = gl.createProgram();
  const kinds = [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER];
  stages.forEach((name, at) => gl.attachShader(made, compile(gl, kinds[at], name, defines)));
  attributes.forEach((name, at) => gl.bindAttribLocation(made, at, name));
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`${stages.join(" and ")} do not link: ${gl.getProgramInfoLog(made)}`);
  }
  const uniforms = {};
  const n = gl.isContextLost() ? 0 : gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS);
  for (let at = 0; at < n; at++) {
    const { name } = gl.getActiveUniform(made, at);
    uniforms[name] = gl.getUniformLocation(made, name);
  }
  return { program: made, uniforms };
}

/** Draws over what is there, in premultiplied colours, without a change of depths. */
export function blended(gl, draw) {
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  gl.depthMask(false);
  draw();
  gl.depthMask(true);
  gl.disable(gl.BLEND);
}

function compile(gl, kind, name, defines) {
  const head = ["#version 300 es", "precision highp float;", "precision highp int;"];
  for (const [key, value] of Object.entries(defines)) head.push(`#define ${key} ${value}`);
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, `${head.join("\n")}\n#line 1\n${texts.get(name)}`);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
    throw new Error(`${name}.glsl does not compile: ${gl.getShaderInfoLog(shader)}`);
  }
  return shader;
}
