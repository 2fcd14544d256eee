// Turntable: the camera goes around the scene until the user moves it.

/** Time of a turn, in seconds. */
const TURN_TIME = 16;

export class Turntable {
  /** Calls `moved` after every step. */
  constructor(canvas, camera, moved) {
    Object.assign(this, { camera, moved, isTurning: false });
    this.button = document.getElementById("turntable");
    this.button.addEventListener("click", () => this.toggle());
    for (const name of ["pointerdown", "wheel"]) canvas.addEventListener(name, () => this.stop());
  }

  toggle() {
    if (this.isTurning) return this.stop();
    this.camera.remember();
    this.set(true);
    let last = performance.now();
    const tick = (now) => {
      if (!this.isTurning) return;
      // A hidden page gets no frames; the turntable then continues from its position.
      const seconds = Math.min((now - last) / 1000, 0.1);
      last = now;
      this.camera.turn((2 * Math.PI * seconds) / TURN_TIME, 0);
      this.moved();
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  stop() {
    this.set(false);
  }

  set(isTurning) {
    this.isTurning = isTurning;
    this.button.classList.toggle("on", isTurning);
    this.button.setAttribute("aria-pressed", isTurning);
  }
}
