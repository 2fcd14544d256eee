// Camera controls: pointers, wheel and keys.

import { life } from "./life.js";

/** Rotation for a drag along the shorter edge, in radians: in orbit and in flight. */
const ORBIT_PER_DRAG = 3.5;
const LOOK_PER_DRAG = 1.0;
/** Change of the distance to the target for a key press, as a fraction. */
const ZOOM_STEP = 0.05;
/** Flight in a second, in units of the distance to the target, and rotation by keys, in radians. */
const SPEED = 0.8;
const TURN = 1.4;

/** Pause in milliseconds after which a turn of the wheel is a new step of the undo history. */
const WHEEL_PAUSE = 500;

const MOVEMENT_KEYS = new Set(["w", "a", "s", "d", "q", "e", "arrowleft", "arrowright", "arrowup", "arrowdown"]);

export class Controls {
  /**
   * Calls `moved` after every change, the action of `keys` for other keys, and `focus` after a
   * double click, with its position as fractions of the canvas.
   */
  constructor(canvas, camera, moved, keys, focus) {
    Object.assign(this, { canvas, camera, moved, keys, wheeledAt: 0 });
    canvas.addEventListener("dblclick", (event) => {
      focus([event.offsetX / canvas.clientWidth, event.offsetY / canvas.clientHeight]);
    });
    this.pointers = new Map();
    this.held = new Set();
    canvas.addEventListener("pointerdown", (event) => this.pointerDown(event));
    canvas.addEventListener("pointermove", (event) => this.pointerMove(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => this.pointerUp(event));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    window.addEventListener("keydown", (event) => this.keyDown(event), life);
    window.addEventListener("keyup", (event) => this.held.delete(event.key.toLowerCase()), life);
    window.addEventListener("blur", () => this.held.clear(), life);
  }

  get edge() {
    return Math.min(this.canvas.clientWidth, this.canvas.clientHeight);
  }

  pointerDown(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    if (this.pointers.size === 0) this.isDragStart = true;
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.isPanning = event.button !== 0 || event.shiftKey;
    this.canvas.classList.add("held");
  }

  pointerUp(event) {
    this.pointers.delete(event.pointerId);
    if (this.pointers.size === 0) this.canvas.classList.remove("held");
  }

  pointerMove(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [across, down] = [0, 1].map((k) => (now[k] - before[k]) / this.edge);
    if (across === 0 && down === 0) return;
    // A drag is one step of the undo history.
    if (this.isDragStart) this.camera.remember();
    this.isDragStart = false;
    if (this.pointers.size === 2) this.pinch(event.pointerId, before, now);
    else if (this.isPanning) this.camera.pan(across, down);
    // The surface under the pointer follows it.
    else if (this.camera.mode === "orbit") this.camera.turn(ORBIT_PER_DRAG * across, -ORBIT_PER_DRAG * down);
    else this.camera.turn(-LOOK_PER_DRAG * across, LOOK_PER_DRAG * down);
    this.pointers.set(event.pointerId, now);
    this.moved();
  }

  /** Two pointers: their centre pans, their distance zooms. */
  pinch(id, before, now) {
    const [, other] = [...this.pointers].find(([key]) => key !== id);
    const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
    this.camera.zoom(Math.max(apart(before), 1) / Math.max(apart(now), 1));
    this.camera.pan((0.5 * (now[0] - before[0])) / this.edge, (0.5 * (now[1] - before[1])) / this.edge);
  }

  wheel(event) {
    event.preventDefault();
    // Turns of the wheel without a pause are one step of the undo history.
    if (event.timeStamp - this.wheeledAt > WHEEL_PAUSE) this.camera.remember();
    this.wheeledAt = event.timeStamp;
    const lines = event.deltaMode === 1 ? 30 : event.deltaMode === 2 ? 300 : 1;
    const amount = Math.max(-240, Math.min(240, event.deltaY * lines));
    if (this.camera.mode === "orbit") this.camera.zoom(Math.exp(0.0015 * amount));
    else this.camera.fly(-0.001 * amount, 0, 0);
    this.moved();
  }

  keyDown(event) {
    const isTyping = event.target.closest("input:not([type=range]), select, dialog");
    if (isTyping || event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.toLowerCase();
    if (MOVEMENT_KEYS.has(key) && !event.target.closest("input")) {
      event.preventDefault();
      if (this.held.size === 0) this.moveWhileHeld(this.camera.remember());
      this.held.add(key);
    } else if (key === "+" || key === "=") this.step(() => this.camera.zoom(1 - ZOOM_STEP));
    else if (key === "-") this.step(() => this.camera.zoom(1 + ZOOM_STEP));
    else if (key in this.keys && !(key === " " && event.target.closest("button"))) {
      event.preventDefault();
      this.keys[key]();
    }
  }

  step(change) {
    this.camera.remember();
    change();
    this.moved();
  }

  /** Moves the camera in every animation frame while movement keys are held. */
  moveWhileHeld() {
    let last = performance.now();
    const tick = (now) => {
      if (this.held.size === 0) return;
      const seconds = Math.min((now - last) / 1000, 0.1);
      last = now;
      const pull = (plus, minus) => (this.held.has(plus) - this.held.has(minus)) * seconds;
      const { camera } = this;
      // In orbit the keys move the eye, so the rotation has the opposite sign.
      const turn = camera.mode === "orbit" ? -TURN : TURN;
      const [across, upwards] = [pull("arrowright", "arrowleft"), pull("arrowup", "arrowdown")];
      if (across !== 0 || upwards !== 0) camera.turn(turn * across, turn * upwards);
      const flight = [pull("w", "s"), pull("d", "a"), pull("e", "q")];
      if (flight.some((step) => step !== 0)) camera.fly(...flight.map((step) => SPEED * step));
      this.moved();
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }
}
