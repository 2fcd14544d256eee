// Camera: position, viewing direction, up vector and field of view; orbit and flight.

import { numbers } from "./address.js";

export const add = (a, b) => a.map((x, k) => x + b[k]);
export const sub = (a, b) => a.map((x, k) => x - b[k]);
export const scale = (a, s) => a.map((x) => x * s);
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = (a) => Math.hypot(...a);
export const unit = (a) => scale(a, 1 / (length(a) || 1));

/** Rotates `v` about a unit axis (Rodrigues). */
export function rotated(v, axis, radians) {
  const [sin, cos] = [Math.sin(radians), Math.cos(radians)];
  return add(add(scale(v, cos), scale(cross(axis, v), sin)), scale(axis, dot(axis, v) * (1 - cos)));
}

/** Bounds of the orbit's radius, relative to the first camera's distance from the centre. */
const RADIUS_MAX = 4;
const RADIUS_MIN = 1e-3;
/** Length of the undo history. */
const HISTORY_MAX = 50;
/** Least angle between the viewing direction and the vertical, in radians. */
const POLE_ANGLE = 0.03;
const degrees = (radians) => (radians * 180) / Math.PI;
const radians = (degrees) => (degrees * Math.PI) / 180;
/** Eight significant digits: the precision of the URL fragment, of requests and of saved paths. */
const rounded = (x) => +x.toPrecision(8);
export const list = (v) => v.map(rounded).join(",");
/** Unit vector; one of length 1 within rounding is kept, so that a restored pose has the same digits. */
const direction = (v) => (Math.abs(length(v) - 1) < 1e-6 ? [...v] : unit(v));

/** Horizontal field of view in degrees, from that of the shorter edge. */
export function horizontalAngle(angle, [width, height]) {
  return degrees(2 * Math.atan((Math.tan(radians(angle) / 2) * width) / Math.min(width, height)));
}

/** Field of view of the shorter edge in degrees, from the horizontal one. */
function shorterEdgeAngle(angle, [width, height]) {
  return degrees(2 * Math.atan((Math.tan(radians(angle) / 2) * Math.min(width, height)) / width));
}

export class Camera {
  constructor(scene) {
    this.scene = scene;
    this.mode = "orbit";
    this.history = [];
    const { eye } = scene.first === null ? scene.start : scene.views[scene.first];
    this.reach = Math.max(length(sub(scene.centre, eye)), 1e-6);
    this.reset();
  }

  /** Returns to the first view, or to the default camera where the scene has no upright view. */
  reset() {
    if (this.scene.first !== null) this.showView(this.scene.first);
    else this.setFrom(this.scene.start, null);
  }

  /** Shows a view of the data set, by its exact camera until the next movement. */
  showView(index) {
    const count = this.scene.views.length;
    const view = ((index % count) + count) % count;
    this.setFrom(this.scene.views[view], view);
  }

  setFrom({ eye, look, up, angle, size }, view) {
    this.setPose(eye, look, up, shorterEdgeAngle(angle, size));
    this.view = view;
    // The orbit's target is on the optical axis, at the depth of the scene's centre.
    const toCentre = sub(this.scene.centre, eye);
    this.distance = Math.max(dot(toCentre, this.look), 0.1 * length(toCentre), RADIUS_MIN * this.reach);
  }

  /** Sets position, direction, up vector and field of view of the shorter edge in degrees. */
  setPose(eye, look, up, angle) {
    [this.eye, this.look, this.up, this.angle] = [[...eye], direction(look), direction(up), angle];
    this.view = null;
  }

  /** Copy of the pose. */
  snapshot() {
    const { eye, look, up, angle, view, distance } = this;
    return { eye: [...eye], look: [...look], up: [...up], angle, view, distance };
  }

  /** Appends the pose to the undo history; called before a change. */
  remember() {
    this.history.push(this.snapshot());
    if (this.history.length > HISTORY_MAX) this.history.shift();
  }

  /** Returns to the last pose of the undo history; false if it is empty. */
  undo() {
    const { eye, look, up, angle, view, distance } = this.history.pop() ?? {};
    if (eye === undefined) return false;
    this.setPose(eye, look, up, angle);
    [this.view, this.distance] = [view, distance];
    return true;
  }

  /** Turns towards a point of the scene and makes it the orbit's target. */
  focus(point) {
    const toPoint = sub(point, this.eye);
    if (length(toPoint) < RADIUS_MIN * this.reach) return;
    const right = this.right;
    this.look = unit(toPoint);
    this.distance = length(toPoint);
    const up = cross(right, this.look);
    this.up = length(up) > POLE_ANGLE ? unit(up) : this.up;
    this.level();
    this.view = null;
  }

  /** Parameters of the URL fragment. */
  state() {
    if (this.view !== null) return { view: this.view };
    const { eye, look, up, angle, distance, mode } = this;
    const pose = { eye: list(eye), look: list(look), up: list(up), angle: rounded(angle) };
    return { ...pose, distance: rounded(distance), ...(mode === "fly" ? { mode } : {}) };
  }

  /** Restores the pose from parameters of the URL fragment; invalid ones change nothing. */
  restore({ view, eye, look, up, angle, distance, mode }) {
    if (mode === "fly") this.mode = mode;
    if (view !== undefined && this.scene.views[view]) return this.showView(Number(view));
    const [position, forward, upward] = [eye, look, up].map((text) => numbers(text, 3));
    const [degrees, radius] = [angle, distance].map(Number);
    if (!position || !forward || !upward || !(degrees >= 2 && degrees <= 150)) return;
    if (!(length(cross(forward, upward)) > 1e-6)) return;
    this.setPose(position, forward, upward, degrees);
    this.distance = this.clampedRadius(radius || this.reach);
  }

  /** Radius of the orbit, clamped to its bounds. */
  clampedRadius(radius) {
    return Math.min(Math.max(radius, RADIUS_MIN * this.reach), RADIUS_MAX * this.reach);
  }

  get right() {
    return unit(cross(this.look, this.up));
  }

  /** Levels the horizon: photographs may be rolled, and rotation by hand starts upright. */
  level() {
    const right = cross(this.look, this.scene.up);
    if (length(right) > POLE_ANGLE / 2) this.up = unit(cross(right, this.look));
  }

  /** Rotates right and up, in radians: about the target in orbit, about the eye in flight. */
  turn(across, upwards) {
    this.level();
    const target = add(this.eye, scale(this.look, this.distance));
    const polar = Math.acos(Math.max(-1, Math.min(1, dot(this.look, this.scene.up))));
    const after = Math.min(Math.max(polar - upwards, POLE_ANGLE), Math.PI - POLE_ANGLE);
    for (const [axis, angle] of [[this.right, polar - after], [this.scene.up, -across]]) {
      this.look = unit(rotated(this.look, axis, angle));
      this.up = unit(rotated(this.up, axis, angle));
    }
    if (this.mode === "orbit") this.eye = sub(target, scale(this.look, this.distance));
    this.view = null;
  }

  /** Moves sideways, in units of the picture's shorter edge at the depth of the target. */
  pan(across, down) {
    const edge = 2 * this.distance * Math.tan(radians(this.angle) / 2);
    this.eye = add(this.eye, add(scale(this.right, -across * edge), scale(this.up, down * edge)));
    this.view = null;
  }

  /** Scales the distance to the target. */
  zoom(factor) {
    const target = add(this.eye, scale(this.look, this.distance));
    this.distance = this.clampedRadius(this.distance * factor);
    this.eye = sub(target, scale(this.look, this.distance));
    this.view = null;
  }

  /** Translates along the camera's axes, in units of the distance to the target. */
  fly(forwards, across, upwards) {
    const steps = [[this.look, forwards], [this.right, across], [this.up, upwards]];
    for (const [axis, step] of steps) this.eye = add(this.eye, scale(axis, step * this.distance));
    this.view = null;
  }

  setAngle(angle) {
    this.angle = angle;
    this.view = null;
  }

  /** Query parameters for a picture of this size. */
  query(size) {
    if (this.view !== null) return { view: this.view };
    const angle = horizontalAngle(rounded(this.angle), size).toFixed(5);
    return { eye: list(this.eye), look: list(this.look), up: list(this.up), angle };
  }
}
