/**
 * Camera of the picture: turns around a target, pans, zooms, flies; a floor plan from above; or the
 * pose of a pinhole.
 *
 * `heading` and `elevation` are radians: the direction in which one looks, from east towards north and
 * above the horizon. `range` is the distance to the target, metres; in a parallel view it sets the scale.
 */

import {
  add,
  anglesOf,
  boxCorners,
  centreOf,
  clamp,
  column,
  cross,
  distance,
  dot,
  forwardOf,
  horizon,
  inCamera,
  mix,
  multiply,
  parallel,
  perspective,
  poseOf,
  radians,
  rigidInverse,
  scale,
  sphereAround,
  subtract,
  unit,
} from "rastercov/maths.js";

const DEFAULT_FIELD = radians(45);
/** Part of the picture that a scene fills at first. */
const FITTED = 0.86;
const FITS = 12;
/** Times the range at which the scene fills the picture, at most, for cameras around it. */
const FARTHEST = 2.6;
const STEEPEST = radians(89.5);

export class ViewCamera {
  /** @param {object} scene its `bounds`, the box without outliers, `frame`, `up`, and the side to look from, `towards` */
  constructor({ bounds, frame, up, towards }) {
    this.bounds = bounds;
    this.frame = frame;
    this.up = unit(up);
    this.field = DEFAULT_FIELD;
    this.isParallel = false;
    this.isPlan = false;
    this.pinned = null;
    if (towards) {
      const [east, north, above] = [...horizon(this.up), this.up].map((axis) => -dot(axis, unit(towards)));
      Object.assign(this, { heading: Math.atan2(north, east), elevation: Math.asin(clamp(above, -1, 1)) });
    }
    this.fit();
  }

  /**
   * Shows the scene from the present direction, and further points, unless it would be small then.
   *
   * @param {number[][]} points world
   * @param {number} aspect width / height
   * @param {number[]} covered parts of the height, from above and from below, that something covers
   */
  fit(points = [], aspect = 1, covered = [0, 0]) {
    if (this.target) this.release();
    this.heading ??= radians(130);
    this.elevation ??= radians(-28);
    const corners = boxCorners(this.frame);
    this.#fill(corners, aspect, covered);
    const farthest = FARTHEST * this.range;
    if (points.length) this.#fill([...corners, ...points], aspect, covered);
    if (this.range > farthest) this.#fill(corners, aspect, covered, farthest);
  }

  /** Fills the picture with points, in its middle; from a range of at least `nearest`. */
  #fill(points, aspect, [top, bottom], nearest = 0) {
    const { centre, radius } = sphereAround(this.frame);
    const slope = Math.tan(this.field / 2);
    Object.assign(this, { target: centre, range: Math.max(1e-6, ...points.map((each) => distance(each, centre))) });
    this.range *= 3 / slope;
    for (let round = 0; round < FITS; round++) {
      const pose = this.pose();
      const places = points.map((point) => {
        const [x, y, z] = inCamera(pose, point);
        const depth = this.isParallel ? this.range : Math.max(z, 1e-3 * radius);
        return [x / depth, y / depth];
      });
      const [[left, right], [above, below]] = [0, 1].map((axis) => {
        const all = places.map((place) => place[axis]);
        return [Math.min(...all), Math.max(...all)];
      });
      const wanted = [(left + right) / 2, (above + below) / 2 - (top - bottom) * slope];
      this.walk([...wanted, 0]);
      const part = Math.max((right - left) / aspect, (below - above) / (1 - top - bottom)) / (2 * FITTED * slope);
      this.range = Math.max(nearest, this.range * part);
    }
  }

  /** Picture of a camera; `field` is its vertical field of view, radians, or of parallel rays `half` its
   * half height, metres. */
  pin(pose, field, half = null) {
    this.pinned = { pose: [...pose], field, half };
    this.isParallel = half !== null;
    this.isPlan = false;
  }

  /** Goes on from the pose that was pinned, upright. */
  release() {
    if (!this.pinned) return;
    const { pose } = this.pinned;
    const { heading, elevation } = anglesOf(pose, this.up);
    this.pinned = null;
    this.isParallel = false;
    const reach = Math.max(
      0.05 * sphereAround(this.frame).radius,
      dot(subtract(sphereAround(this.frame).centre, centreOf(pose)), forwardOf(pose)),
    );
    this.heading = radians(heading);
    this.elevation = clamp(radians(elevation), -STEEPEST, STEEPEST);
    this.range = reach;
    this.target = add(centreOf(pose), scale(this.forward(), reach));
  }

  /** Plan from above, north at the top; or back to what was before. */
  setPlan(isPlan) {
    this.release();
    if (isPlan === this.isPlan) return;
    this.isPlan = isPlan;
    this.isParallel = isPlan;
    if (isPlan) {
      this.before = this.place();
      this.heading = radians(90);
      this.elevation = radians(-90);
    } else {
      Object.assign(this, this.before);
    }
  }

  forward() {
    const [east, north] = horizon(this.up);
    const flat = add(scale(east, Math.cos(this.heading)), scale(north, Math.sin(this.heading)));
    return add(scale(flat, Math.cos(this.elevation)), scale(this.up, Math.sin(this.elevation)));
  }

  /** world_from_camera of the picture. */
  pose() {
    if (this.pinned) return this.pinned.pose;
    const [east, north] = horizon(this.up);
    const right = subtract(scale(east, Math.sin(this.heading)), scale(north, Math.cos(this.heading)));
    const forward = this.forward();
    const eye = subtract(this.target, scale(forward, this.range));
    return poseOf(right, cross(forward, right), forward, eye);
  }

  /** Half height of the picture: of parallel rays in metres, else at depth 1. */
  #half() {
    const { pinned, field, range } = this;
    const slope = Math.tan((pinned?.field ?? field) / 2);
    return this.isParallel ? (pinned?.half ?? range * slope) : slope;
  }

  /**
   * Matrices of a picture of width x height pixels, in which the scene and further points are not cut.
   *
   * @returns clipFromWorld, pose, near (least depth, metres), pixel(depth): metres a pixel there
   */
  look(width, height, points = []) {
    const pose = this.pose();
    const half = this.#half();
    const side = (half * width) / height;
    const depths = [...boxCorners(this.bounds), ...points].map((point) => inCamera(pose, point)[2]);
    const size = sphereAround(this.bounds).radius;
    const slack = 0.2 * size;
    const farthest = Math.max(...depths) + slack;
    if (this.isParallel) {
      const [near, far] = [Math.min(...depths) - size, farthest + size];
      const clip = parallel(side, half, near, far);
      return {
        pose,
        near: 1e-3,
        isParallel: true,
        pixel: () => (2 * half) / height,
        clipFromWorld: multiply(clip, rigidInverse(pose)),
      };
    }
    const far = Math.max(farthest, 1e-3 * size);
    const near = clamp(Math.min(...depths) - slack, 5e-4 * size, 0.5 * far);
    return {
      pose,
      near,
      isParallel: false,
      pixel: (depth) => (2 * depth * half) / height,
      clipFromWorld: multiply(perspective(side, half, near, far), rigidInverse(pose)),
    };
  }

  /** Turns around the target, radians. */
  orbit(right, up) {
    this.release();
    if (this.isPlan) return;
    this.heading -= right;
    this.elevation = clamp(this.elevation + up, -STEEPEST, STEEPEST);
  }

  /** Moves the target across the picture, in parts of its height. */
  pan(right, down) {
    const span = 2 * Math.tan(this.field / 2);
    this.walk([right * span, down * span, 0]);
  }

  /** Nearer (factor < 1) or farther, towards the world point `at` where it is given. */
  zoom(factor, at = null) {
    this.release();
    const size = sphereAround(this.bounds).radius;
    const next = clamp(this.range * factor, 1e-4 * size, 50 * size);
    const used = next / this.range;
    if (at) this.target = mix(at, this.target, used);
    this.range = next;
  }

  /** Steps through the scene along camera axes, in parts of the range: right, down, forward. */
  walk(step) {
    this.release();
    const pose = this.pose();
    const by = [0, 1, 2].map((axis) => scale(column(pose, axis), step[axis] * this.range));
    this.target = by.reduce(add, this.target);
  }

  /** Ray through a point of the picture, given in [-1, 1] rightwards and upwards: {from, along}. */
  ray(x, y, width, height) {
    const pose = this.pose();
    const half = this.#half();
    const [right, down, forward, centre] = [0, 1, 2, 3].map((at) => column(pose, at));
    const across = add(scale(right, (x * half * width) / height), scale(down, -y * half));
    return this.isParallel ? { from: add(centre, across), along: forward } : { from: centre, along: unit(add(forward, across)) };
  }

  /** State to fly from or to. */
  place() {
    const { target, range, heading, elevation } = this;
    return { target, range, heading, elevation };
  }

  /** State part of the way (t from 0 to 1) between two others; turns the short way round. */
  setBetween(from, to, t) {
    const turn = Math.atan2(Math.sin(to.heading - from.heading), Math.cos(to.heading - from.heading));
    this.pinned = null;
    this.target = mix(from.target, to.target, t);
    this.range = from.range * (to.range / from.range) ** t;
    if (this.isPlan) return;
    this.heading = from.heading + t * turn;
    this.elevation = from.elevation + t * (to.elevation - from.elevation);
  }

  /** Place from which a point with a normal is seen well, `range` metres away. */
  placeBefore(point, normal, range) {
    const { heading, elevation } = anglesOf(
      poseOf([1, 0, 0], [0, 1, 0], scale(unit(normal), -1), point),
      this.up,
    );
    const isSteep = Math.abs(elevation) > 75;
    return {
      target: point,
      range,
      heading: isSteep ? this.heading : radians(heading),
      elevation: clamp(radians(elevation), radians(-70), radians(70)),
    };
  }
}
