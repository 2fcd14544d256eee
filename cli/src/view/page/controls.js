// Fingers, mouse and keys move the camera.

/** Radians for a drag along the shorter edge, about the target and about the eye. */
const DRAG = 3.5;
const LOOK = 1.0;
/** Share of the distance that one comes closer with a key. */
const STEP = 0.05;
/** Shares of the distance that one flies in a second, and radians that keys turn. */
const SPEED = 0.8;
const TURN = 1.4;

/** Milliseconds of rest between two turns of the wheel. */
const REST = 500;

const HELD = new Set(["w", "a", "s", "d", "q", "e", "arrowleft", "arrowright", "arrowup", "arrowdown"]);

export class Controls {
  /**
   * `moved` is told of every change, `keys` are what is done at a key that moves nothing, and `focus` is told of double
   * clicks, in shares of the picture.
   */
  constructor(canvas, camera, moved, keys, focus) {
    Object.assign(this, { canvas, camera, moved, keys, wheeledAt: 0 });
    canvas.addEventListener("dblclick", (event) => {
      focus([event.offsetX / canvas.clientWidth, event.offsetY / canvas.clientHeight]);
    });
    this.pointers = new Map();
    this.held = new Set();
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => this.up(event));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    window.addEventListener("keydown", (event) => this.key(event));
    window.addEventListener("keyup", (event) => this.held.delete(event.key.toLowerCase()));
    window.addEventListener("blur", () => this.held.clear());
  }

  get edge() {
    return Math.min(this.canvas.clientWidth, this.canvas.clientHeight);
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    if (this.pointers.size === 0) this.isFresh = true;
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.isPanning = event.button !== 0 || event.shiftKey;
    this.canvas.classList.add("held");
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    if (this.pointers.size === 0) this.canvas.classList.remove("held");
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [across, down] = [0, 1].map((k) => (now[k] - before[k]) / this.edge);
    if (across === 0 && down === 0) return;
    // A drag is one step that can be taken back.
    if (this.isFresh) this.camera.remember();
    this.isFresh = false;
    if (this.pointers.size === 2) this.pinch(event.pointerId, before, now);
    else if (this.isPanning) this.camera.pan(across, down);
    // What is under the finger follows it.
    else if (this.camera.mode === "orbit") this.camera.turn(DRAG * across, -DRAG * down);
    else this.camera.turn(-LOOK * across, LOOK * down);
    this.pointers.set(event.pointerId, now);
    this.moved();
  }

  /** Two fingers: their middle moves the picture, their distance brings it closer. */
  pinch(id, before, now) {
    const [, other] = [...this.pointers].find(([key]) => key !== id);
    const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
    this.camera.zoom(Math.max(apart(before), 1) / Math.max(apart(now), 1));
    this.camera.pan((0.5 * (now[0] - before[0])) / this.edge, (0.5 * (now[1] - before[1])) / this.edge);
  }

  wheel(event) {
    event.preventDefault();
    // So is what the wheel does without a rest.
    if (event.timeStamp - this.wheeledAt > REST) this.camera.remember();
    this.wheeledAt = event.timeStamp;
    const lines = event.deltaMode === 1 ? 30 : event.deltaMode === 2 ? 300 : 1;
    const amount = Math.max(-240, Math.min(240, event.deltaY * lines));
    if (this.camera.mode === "orbit") this.camera.zoom(Math.exp(0.0015 * amount));
    else this.camera.fly(-0.001 * amount, 0, 0);
    this.moved();
  }

  key(event) {
    const isTyping = event.target.closest("input:not([type=range]), select, dialog");
    if (isTyping || event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.toLowerCase();
    if (HELD.has(key) && !event.target.closest("input")) {
      event.preventDefault();
      if (this.held.size === 0) this.run(this.camera.remember());
      this.held.add(key);
    } else if (key === "+" || key === "=") this.step(() => this.camera.zoom(1 - STEP));
    else if (key === "-") this.step(() => this.camera.zoom(1 + STEP));
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

  /** Moves for as long as keys are held. */
  run() {
    let last = performance.now();
    const tick = (now) => {
      if (this.held.size === 0) return;
      const seconds = Math.min((now - last) / 1000, 0.1);
      last = now;
      const pull = (plus, minus) => (this.held.has(plus) - this.held.has(minus)) * seconds;
      const { camera } = this;
      // In orbit it is the eye that goes to the right and up.
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
