/**
 * The mesh on the screen: one byte a face, its level, looked up in a palette of 256 colours.
 *
 * Corners are not indexed: face f has vertices 3 f to 3 f + 2, so that a new colour of every face is
 * one write of F bytes. Picking draws the same triangles into one texel.
 */

import { blended, program } from "rastercov/shaders.js";

const TEXELS_A_ROW = 2048;
/** Least factor of the headlight: colours are palette * (least + (1 - least) |cosine|). */
export const SHADE_LEAST = 0.45;
/** Grey of faces without figures. */
const NEUTRAL = 205;
/** Opacity of transparent groups. */
const SEEN_THROUGH = 0.24;
export const MESH_STAGES = ["viewer_mesh.vert", "viewer_mesh.frag"];

/** Bits of a group, as the shader knows them. */
export const GROUP = { hidden: 1, twoSided: 2, transparent: 4, highlighted: 8 };

export class MeshPass {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {Float32Array} soup corners, 9 a face, metres from the origin
   * @param {Uint16Array} faceGroups
   * @param {number} nGroups
   */
  constructor(gl, soup, faceGroups, nGroups) {
    this.gl = gl;
    this.nFaces = soup.length / 9;
    const defines = { TEXELS_A_ROW, SHADE_LEAST: SHADE_LEAST.toFixed(4) };
    this.colours = program(gl, MESH_STAGES, ["position"], defines);
    this.picks = program(gl, MESH_STAGES, ["position"], { ...defines, PICKING: 1 });
    this.parts = program(gl, MESH_STAGES, ["position", "parent", "weights", "level"], { ...defines, PIECES: 1 });
    this.corners = gl.createVertexArray();
    gl.bindVertexArray(this.corners);
    this.soup = gl.createBuffer();
    this.setCorners(soup);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    this.levels = table(gl, this.nFaces, gl.R8UI);
    this.pieces = { corners: gl.createVertexArray(), buffers: [0, 1, 2, 3].map(() => gl.createBuffer()), count: 0 };
    this.faceGroups = table(gl, this.nFaces, gl.R16UI);
    write(gl, this.faceGroups, faceGroups, gl.UNSIGNED_SHORT);
    this.creases = table(gl, this.nFaces, gl.R8UI);
    this.groups = table(gl, Math.max(1, nGroups), gl.R8UI);
    this.palette = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, 256, 1);
    nearest(gl);
    this.setPalette(new Uint8Array(768).fill(NEUTRAL)); // until the first figures come
    this.target = pickTarget(gl);
  }

  /** Corners, as of the constructor. */
  setCorners(soup) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.soup);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, soup, this.gl.STATIC_DRAW);
  }

  /** Level of each face, (F) bytes. */
  setLevels(levels) {
    write(this.gl, this.levels, levels, this.gl.UNSIGNED_BYTE);
  }

  /** Parts of faces that are drawn over them, as `pieces.js` has them; null for none. */
  setPieces(made) {
    const { gl, pieces } = this;
    pieces.count = made ? made.parents.length : 0;
    if (!made || pieces.made === made) return;
    pieces.made = made;
    gl.bindVertexArray(pieces.corners);
    const arrays = [
      new Float32Array(made.positions),
      new Uint32Array(made.parents),
      new Float32Array(made.weights),
      new Uint32Array(made.levels),
    ];
    arrays.forEach((values, at) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, pieces.buffers[at]);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(at);
      if (values instanceof Uint32Array) gl.vertexAttribIPointer(at, 1, gl.UNSIGNED_INT, 0, 0);
      else gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 0, 0);
    });
  }

  /** Bits of the edges of each face that are lines, see `creasesOf`. */
  setCreases(flags) {
    write(this.gl, this.creases, flags, this.gl.UNSIGNED_BYTE);
  }

  /** 256 sRGB colours, 768 bytes, and the legend, whose entries may have a hatch. */
  setPalette(colours, legend = []) {
    const { gl } = this;
    const texels = new Uint8Array(1024);
    for (let row = 0; row < 256; row++) texels.set(colours.subarray(3 * row, 3 * row + 3), 4 * row);
    for (const { level, hatch } of legend) texels[4 * level + 3] = hatch ?? 0;
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, texels);
  }

  /** Bits of `GROUP` for each group. */
  setGroups(flags) {
    write(this.gl, this.groups, flags, this.gl.UNSIGNED_BYTE);
  }

  /**
   * Draws into the framebuffer that is bound.
   *
   * @param {object} look clipFromWorld (relative to the origin), eye, isParallel, section (4 numbers
   *   or null), isCulled, isFlat, hasEdges, accent, hasTransparent
   */
  draw(look) {
    const { gl } = this;
    this.#prepare(this.colours, look);
    gl.disable(gl.BLEND);
    this.#triangles(this.colours, look.hasTransparent ? 1 : 0, 1);
    if (this.pieces.count) this.#drawPieces(look);
    if (!look.hasTransparent) return;
    this.#prepare(this.colours, look);
    blended(gl, () => this.#triangles(this.colours, 2, SEEN_THROUGH));
  }

  #drawPieces(look) {
    const { gl } = this;
    this.#prepare(this.parts, look, this.pieces.corners);
    gl.enable(gl.POLYGON_OFFSET_FILL); // over the face that they lie in
    gl.polygonOffset(-0.05, -4); // corners are rounded to parts of a pixel, depths to units
    this.#triangles(this.parts, look.hasTransparent ? 1 : 0, 1, this.pieces.count);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }

  /**
   * Face and point in a pixel, or null; transparent and hidden groups are looked through.
   *
   * @param {number} x, y pixel of the drawing buffer, from its lower left corner
   * @param {number} width, height size of the drawing buffer
   */
  pick(look, x, y, width, height) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.viewport(-x, -y, width, height); // the texel is the pixel (x, y) of the picture
    gl.clearBufferuiv(gl.COLOR, 0, [0, 0, 0, 0]);
    gl.clearBufferfi(gl.DEPTH_STENCIL, 0, 1, 0);
    this.#prepare(this.picks, look);
    gl.disable(gl.BLEND);
    this.#triangles(this.picks, look.hasTransparent ? 1 : 0, 1);
    const found = new Uint32Array(4);
    gl.readPixels(0, 0, 1, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, found);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    if (found[0] === 0) return null;
    return { face: found[0] - 1, point: [...new Float32Array(found.buffer, 4, 3)] };
  }

  #prepare({ program: used, uniforms }, look, corners = this.corners) {
    const { gl } = this;
    gl.useProgram(used);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.depthMask(true);
    gl.uniformMatrix4fv(uniforms.clip_from_world, true, look.clipFromWorld);
    gl.uniform3fv(uniforms.eye, look.eye);
    gl.uniform4fv(uniforms.section, look.section ?? [0, 0, 0, 0]);
    const flags = { is_parallel: look.isParallel, is_cut: look.section, is_culled: look.isCulled, is_flat: look.isFlat, has_edges: look.hasEdges };
    for (const [name, isOn] of Object.entries(flags)) gl.uniform1i(uniforms[name], isOn ? 1 : 0);
    gl.uniform3fv(uniforms.accent, look.accent);
    const textures = [
      [uniforms.levels, this.levels.texture],
      [uniforms.face_groups, this.faceGroups.texture],
      [uniforms.creases, this.creases.texture],
      [uniforms.groups, this.groups.texture],
      [uniforms.palette, this.palette],
    ];
    textures.forEach(([uniform, texture], at) => {
      gl.activeTexture(gl.TEXTURE0 + at);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.uniform1i(uniform, at);
    });
    gl.activeTexture(gl.TEXTURE0);
    gl.bindVertexArray(corners);
  }

  #triangles({ uniforms }, which, opacity, count = 3 * this.nFaces) {
    this.gl.uniform1i(uniforms.which, which);
    this.gl.uniform1f(uniforms.opacity, opacity);
    this.gl.drawArrays(this.gl.TRIANGLES, 0, count);
  }
}

/** Texture with one texel for each of `n` entries. */
function table(gl, n, format) {
  const rows = Math.max(1, Math.ceil(n / TEXELS_A_ROW));
  if (rows > gl.getParameter(gl.MAX_TEXTURE_SIZE)) {
    throw new Error(
      `this device shows at most ${TEXELS_A_ROW * gl.getParameter(gl.MAX_TEXTURE_SIZE)} faces, not ${n}`,
    );
  }
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, format, TEXELS_A_ROW, rows);
  nearest(gl);
  return { texture, rows };
}

function nearest(gl) {
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
}

/** Writes whole rows and the rest, without a padded copy. */
function write(gl, { texture }, values, type) {
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  const rows = Math.floor(values.length / TEXELS_A_ROW);
  const rest = values.length - rows * TEXELS_A_ROW;
  const put = (y, width, height, part) =>
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, y, width, height, gl.RED_INTEGER, type, part);
  if (rows) put(0, TEXELS_A_ROW, rows, values.subarray(0, rows * TEXELS_A_ROW));
  if (rest) put(rows, rest, 1, values.subarray(rows * TEXELS_A_ROW));
}

/** Framebuffer of one texel: four unsigned words, and a depth. */
function pickTarget(gl) {
  const target = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  const attach = (format, point) => {
    const buffer = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
    gl.renderbufferStorage(gl.RENDERBUFFER, format, 1, 1);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, point, gl.RENDERBUFFER, buffer);
  };
  attach(gl.RGBA32UI, gl.COLOR_ATTACHMENT0);
  attach(gl.DEPTH24_STENCIL8, gl.DEPTH_STENCIL_ATTACHMENT);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  return target;
}
