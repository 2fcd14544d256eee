// Where one looks from: an eye, a direction, what is above; and how it moves.

import { numbers } from "./address.js";

export const add = (a, b) => a.map((x, k) => x + b[k]);
export const sub = (a, b) => a.map((x, k) => x - b[k]);
export const scale = (a, s) => a.map((x) => x * s);
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = (a) => Math.hypot(...a);
export const unit = (a) => scale(a, 1 / (length(a) || 1));

/** v turned about a unit axis (Rodrigues). */
export function turned(v, axis, radians) {
  const [sin, cos] = [Math.sin(radians), Math.cos(radians)];
  return add(add(scale(v, cos), scale(cross(axis, v), sin)), scale(axis, dot(axis, v) * (1 - cos)));
}

/** How far away and how close one may come, in shares of the distance between the start and the middle of the scene. */
const FARTHEST = 4;
const CLOSEST = 1e-3;
/** Steps back that are remembered. */
const STEPS_BACK = 50;
/** How close to straight up and down one may look, in radians. */
const POLE = 0.03;
const degrees = (radians) => (radians * 180) / Math.PI;
const radians = (degrees) => (degrees * Math.PI) / 180;

/** The field of view across, of a picture whose shorter edge has this one; in degrees. */
export function angleAcross(angle, [width, height]) {
  return degrees(2 * Math.atan((Math.tan(radians(angle) / 2) * width) / Math.min(width, height)));
}

/** The field of view of the shorter edge, of a picture with this one across. */
function angleOfShorter(angle, [width, height]) {
  return degrees(2 * Math.atan((Math.tan(radians(angle) / 2) * Math.min(width, height)) / width));
}

export class Camera {
  constructor(scene) {
    this.scene = scene;
    this.mode = "orbit";
    this.before = [];
    const { eye } = scene.first === null ? scene.start : scene.views[scene.first];
    this.reach = Math.max(length(sub(scene.centre, eye)), 1e-6);
    this.reset();
  }

  /** Back to where one began. */
  reset() {
    if (this.scene.first !== null) this.showView(this.scene.first);
    else this.take(this.scene.start, null);
  }

  /** To a view that the scene knows; its picture is shown exactly until one moves. */
  showView(index) {
    const count = this.scene.views.length;
    const view = ((index % count) + count) % count;
    this.take(this.scene.views[view], view);
  }

  take({ eye, look, up, angle, size }, view) {
    this.pose(eye, look, up, angleOfShorter(angle, size));
    this.view = view;
    // What one turns about is on the optical axis, as far away as the middle of the scene.
    const to = sub(this.scene.centre, eye);
    this.distance = Math.max(dot(to, this.look), 0.1 * length(to), CLOSEST * this.reach);
  }

  /** Stands elsewhere. */
  pose(eye, look, up, angle) {
    [this.eye, this.look, this.up, this.angle] = [[...eye], unit(look), unit(up), angle];
    this.view = null;
  }

  /** What holds the pose, to be kept. */
  kept() {
    const { eye, look, up, angle, view, distance } = this;
    return { eye: [...eye], look: [...look], up: [...up], angle, view, distance };
  }

  /** Remembers the pose, before it is changed. */
  remember() {
    this.before.push(this.kept());
    if (this.before.length > STEPS_BACK) this.before.shift();
  }

  /** Back to the pose that was remembered last; false where there is none. */
  undo() {
    const { eye, look, up, angle, view, distance } = this.before.pop() ?? {};
    if (eye === undefined) return false;
    this.pose(eye, look, up, angle);
    [this.view, this.distance] = [view, distance];
    return true;
  }

  /** Turns to a place, and about it from now on. */
  focus(point) {
    const to = sub(point, this.eye);
    if (length(to) < CLOSEST * this.reach) return;
    const right = this.right;
    this.look = unit(to);
    this.distance = length(to);
    const up = cross(right, this.look);
    this.up = length(up) > POLE ? unit(up) : this.up;
    this.level();
    this.view = null;
  }

  /** The words that hold it, for the address. */
  state() {
    if (this.view !== null) return { view: this.view };
    const list = (v) => v.map((x) => +x.toPrecision(6)).join(",");
    const { eye, look, up, angle, distance, mode } = this;
    const words = { eye: list(eye), look: list(look), up: list(up), angle: +angle.toPrecision(5) };
    return { ...words, distance: +distance.toPrecision(6), ...(mode === "fly" ? { mode } : {}) };
  }

  /** Takes what such words hold; leaves what they do not. */
  restore({ view, eye, look, up, angle, distance, mode }) {
    if (mode === "fly") this.mode = mode;
    if (view !== undefined && this.scene.views[view]) return this.showView(Number(view));
    const [at, ahead, above] = [eye, look, up].map((text) => numbers(text, 3));
    const [field, far] = [angle, distance].map(Number);
    if (!at || !ahead || !above || !(field >= 2 && field <= 150) || !(length(cross(ahead, above)) > 1e-6)) return;
    this.pose(at, ahead, above, field);
    this.distance = this.within(far || this.reach);
  }

  /** A distance as far as one may go. */
  within(distance) {
    return Math.min(Math.max(distance, CLOSEST * this.reach), FARTHEST * this.reach);
  }

  get right() {
    return unit(cross(this.look, this.up));
  }

  /** Upright: a photograph may lie on its side, and who turns wants the horizon level. */
  level() {
    const right = cross(this.look, this.scene.up);
    if (length(right) > POLE / 2) this.up = unit(cross(right, this.look));
  }

  /** Looks so many radians further to the right and upwards: in orbit about the target, in flight about the eye. */
  turn(across, upwards) {
    this.level();
    const target = add(this.eye, scale(this.look, this.distance));
    const polar = Math.acos(Math.max(-1, Math.min(1, dot(this.look, this.scene.up))));
    const after = Math.min(Math.max(polar - upwards, POLE), Math.PI - POLE);
    for (const [axis, angle] of [[this.right, polar - after], [this.scene.up, -across]]) {
      this.look = unit(turned(this.look, axis, angle));
      this.up = unit(turned(this.up, axis, angle));
    }
    if (this.mode === "orbit") this.eye = sub(target, scale(this.look, this.distance));
    this.view = null;
  }

  /** Moves sideways, so that what is at the target's distance follows; in shares of the picture's shorter edge. */
  pan(across, down) {
    const reach = 2 * this.distance * Math.tan(radians(this.angle) / 2);
    this.eye = add(this.eye, add(scale(this.right, -across * reach), scale(this.up, down * reach)));
    this.view = null;
  }

  /** Comes closer to the target, or goes away from it. */
  zoom(factor) {
    const target = add(this.eye, scale(this.look, this.distance));
    this.distance = this.within(this.distance * factor);
    this.eye = sub(target, scale(this.look, this.distance));
    this.view = null;
  }

  /** Flies, in shares of the distance. */
  fly(forwards, across, upwards) {
    const steps = [[this.look, forwards], [this.right, across], [this.up, upwards]];
    for (const [direction, step] of steps) this.eye = add(this.eye, scale(direction, step * this.distance));
    this.view = null;
  }

  setAngle(angle) {
    this.angle = angle;
    this.view = null;
  }

  /** The words of a query for a picture of this size. */
  words(size) {
    if (this.view !== null) return { view: this.view };
    const list = (v) => v.map((x) => +x.toPrecision(8)).join(",");
    const angle = angleAcross(this.angle, size).toFixed(5);
    return { eye: list(this.eye), look: list(this.look), up: list(this.up), angle };
  }
}
