/**
 * Lines and translucent triangles over the mesh: frusta, planes of focus, handles, measures.
 *
 * A `Sketch` collects them anew for each picture, in world coordinates; `SketchPass` draws it. Colours
 * are [r, g, b, opacity], each from 0 to 1; widths are pixels of the page.
 */

import { add, column, scale, subtract } from "rastercov/maths.js";
import { program } from "rastercov/shaders.js";

export const SKETCH_STAGES = ["viewer_line.vert", "viewer_fill.vert", "viewer_colour.frag"];

/** Opacity of what the mesh hides. */
const HIDDEN = 0.22;

export class Sketch {
  constructor(origin) {
    this.origin = origin;
    this.lines = [];
    this.fills = [];
  }

  line(from, to, colour, width = 1.5) {
    const o = this.origin;
    this.lines.push(
      from[0] - o[0],
      from[1] - o[1],
      from[2] - o[2],
      to[0] - o[0],
      to[1] - o[1],
      to[2] - o[2],
      ...colour,
      width,
    );
  }

  /** Line through points, back to the first where `isClosed`. */
  path(points, colour, width = 1.5, isClosed = false) {
    for (let at = 1; at < points.length; at++) this.line(points[at - 1], points[at], colour, width);
    if (isClosed && points.length > 2) this.line(points.at(-1), points[0], colour, width);
  }

  /** Cross of 12 px at a point. */
  cross(point, look, colour) {
    const size = 6 * look.pixelAt(point);
    for (const at of [0, 1]) {
      const arm = scale(column(look.pose, at), size);
      this.line(subtract(point, arm), add(point, arm), colour, 2.5);
    }
  }

  triangle(a, b, c, colour) {
    for (const point of [a, b, c]) {
      this.fills.push(...point.map((x, axis) => x - this.origin[axis]), ...colour);
    }
  }

  /** Triangles from the first of the points to all others. */
  polygon(points, colour) {
    for (let at = 2; at < points.length; at++) {
      this.triangle(points[0], points[at - 1], points[at], colour);
    }
  }
}

export class SketchPass {
  constructor(gl) {
    this.gl = gl;
    const [line, fill, colour] = SKETCH_STAGES;
    this.lineProgram = program(gl, [line, colour], ["from", "to", "tint", "width"]);
    this.fillProgram = program(gl, [fill, colour], ["position", "tint"]);
    this.lines = arrays(gl, [3, 3, 4, 1], 1);
    this.fills = arrays(gl, [3, 4], 0);
  }

  /**
   * Draws a sketch.
   *
   * @param {Sketch} sketch
   * @param {object} look clipFromWorld (relative to the origin), width, height of the drawing
   *   buffer, density (its pixels a pixel of the page), near (metres)
   * @param {object} options isOnTop: nothing hides it
   */
  draw(sketch, look, { isOnTop = false } = {}) {
    const { gl } = this;
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    const upload = ({ vertices, buffer }, numbers) => {
      gl.bindVertexArray(vertices);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(numbers), gl.DYNAMIC_DRAW);
    };
    const start = ({ program: used, uniforms }) => {
      gl.useProgram(used);
      gl.uniformMatrix4fv(uniforms.clip_from_world, true, look.clipFromWorld);
      return uniforms;
    };
    const each = (uniforms, drawAll) => {
      const paint = (fade) => {
        gl.uniform1f(uniforms.fade, fade);
        drawAll();
      };
      if (isOnTop) {
        gl.disable(gl.DEPTH_TEST);
        paint(1);
        gl.enable(gl.DEPTH_TEST);
        return;
      }
      gl.enable(gl.DEPTH_TEST);
      gl.depthFunc(gl.GREATER);
      paint(HIDDEN);
      gl.depthFunc(gl.LEQUAL);
      paint(1);
    };
    if (sketch.fills.length) {
      const uniforms = start(this.fillProgram);
      gl.uniform1f(uniforms.pull, isOnTop ? 0 : 2e-4);
      upload(this.fills, sketch.fills);
      each(uniforms, () => gl.drawArrays(gl.TRIANGLES, 0, sketch.fills.length / 7));
    }
    if (sketch.lines.length) {
      const uniforms = start(this.lineProgram);
      gl.uniform2f(uniforms.screen, look.width, look.height);
      gl.uniform1f(uniforms.density, look.density);
      gl.uniform1f(uniforms.near, look.near);
      upload(this.lines, sketch.lines);
      each(uniforms, () => gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, sketch.lines.length / 11));
    }
    gl.depthMask(true);
    gl.depthFunc(gl.LEQUAL);
    gl.disable(gl.BLEND);
  }
}

/** Buffer of interleaved float attributes, a step each `divisor` instances. */
function arrays(gl, sizes, divisor) {
  const vertices = gl.createVertexArray();
  const buffer = gl.createBuffer();
  gl.bindVertexArray(vertices);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  const stride = 4 * sizes.reduce((a, b) => a + b);
  let offset = 0;
  sizes.forEach((size, at) => {
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, gl.FLOAT, false, stride, offset);
    gl.vertexAttribDivisor(at, divisor);
    offset += 4 * size;
  });
  return { vertices, buffer };
}
