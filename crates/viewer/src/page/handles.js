// Handles of lamps over the picture: dragged in the plane that faces the camera.

import { add, cross, dot, horizontalAngle, scale, sub, unit } from "./camera.js";

/** Step of an arrow key, relative to the shorter edge of the canvas. */
const KEY_STEP = 0.02;
/** Change of the distance for a drag along the whole canvas while shift is held, as a logarithm. */
const DEPTH_PER_DRAG = 2;

const rounded = (x) => +x.toPrecision(5);

export class Handles {
  constructor(canvas, stream, camera, lamps) {
    Object.assign(this, { canvas, stream, camera, lamps, buttons: new Map() });
    this.layer = document.getElementById("handles");
  }

  /** Pinhole of the picture on the page: focal lengths and centre in pixels, and its axes. */
  pinhole() {
    const { clientWidth, clientHeight } = this.canvas;
    const { camera } = this;
    const view = camera.view === null ? null : camera.scene.views[camera.view];
    const { x, y, w, h } = (view && this.stream.frame) ?? { x: 0, y: 0, w: 1, h: 1 };
    const size = [w * clientWidth, h * clientHeight];
    const slope = Math.tan((horizontalAngle(camera.angle, size) * Math.PI) / 360);
    const focal = view ? [0, 1].map((k) => view.focal[k] * size[k]) : Array(2).fill(size[0] / (2 * slope));
    const principal = view?.principal ?? [0.5, 0.5];
    const centre = [x * clientWidth + principal[0] * size[0], y * clientHeight + principal[1] * size[1]];
    const right = unit(cross(camera.look, camera.up));
    return { focal, centre, eye: camera.eye, look: camera.look, right, up: cross(right, camera.look) };
  }

  /** Adds and removes handles as lamps come and go, and places them. */
  update() {
    const lamps = this.lamps.of("lamp");
    for (const [item, button] of this.buttons) {
      if (lamps.includes(item)) continue;
      button.remove();
      this.buttons.delete(item);
    }
    const pinhole = this.pinhole();
    lamps.forEach((item, index) => {
      if (!this.buttons.has(item)) this.create(item);
      this.place(item, this.buttons.get(item), pinhole, index + 1);
    });
  }

  create(item) {
    const button = document.createElement("button");
    button.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      button.focus({ preventScroll: true });
      button.setPointerCapture(event.pointerId);
      this.from = [event.clientX, event.clientY];
      this.lamps.select(item);
    });
    button.addEventListener("pointermove", (event) => {
      if (!button.hasPointerCapture(event.pointerId)) return;
      const to = [event.clientX, event.clientY];
      this.move(item, [to[0] - this.from[0], to[1] - this.from[1]], event.shiftKey);
      this.from = to;
    });
    button.addEventListener("focus", () => this.lamps.select(item));
    button.addEventListener("keydown", (event) => {
      const step = KEY_STEP * Math.min(this.canvas.clientWidth, this.canvas.clientHeight);
      const steps = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
      const isRemoved = event.key === "Delete" || event.key === "Backspace";
      if (!(event.key in steps) && !isRemoved) return;
      event.preventDefault();
      event.stopPropagation();
      if (isRemoved) this.lamps.remove(item);
      else this.move(item, steps[event.key], event.shiftKey);
    });
    this.buttons.set(item, button);
    this.layer.append(button);
  }

  place(item, button, { focal, centre, eye, look, right, up }, number) {
    const away = sub(item.position, eye);
    const depth = dot(away, look);
    const at = [centre[0] + (focal[0] * dot(away, right)) / depth, centre[1] - (focal[1] * dot(away, up)) / depth];
    const { clientWidth, clientHeight } = this.canvas;
    button.hidden = !(depth > 0 && at[0] >= 0 && at[0] <= clientWidth && at[1] >= 0 && at[1] <= clientHeight);
    button.style.left = `${at[0]}px`;
    button.style.top = `${at[1]}px`;
    button.style.setProperty("--color", `#${item.color}`);
    button.classList.toggle("selected", item === this.lamps.items[this.lamps.selected]);
    button.title = `Lamp ${number}: drag it, with shift nearer or farther`;
    button.setAttribute("aria-label", `Lamp ${number}. Arrow keys move it, with shift nearer or farther.`);
  }

  /** Moves a lamp by pixels of the page: in the plane that faces the camera, or along its ray. */
  move(item, [across, down], isAlong) {
    const { focal, eye, look, right, up } = this.pinhole();
    const away = sub(item.position, eye);
    const depth = Math.max(dot(away, look), 1e-6);
    const steps = [[right, (across * depth) / focal[0]], [up, (-down * depth) / focal[1]]];
    const aside = steps.reduce((sum, [axis, step]) => add(sum, scale(axis, step)), item.position);
    const farther = Math.exp((-DEPTH_PER_DRAG * down) / this.canvas.clientHeight);
    const position = isAlong ? add(eye, scale(away, farther)) : aside;
    this.lamps.set(item, { position: position.map(rounded) });
  }
}
