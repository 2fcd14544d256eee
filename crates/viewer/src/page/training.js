// Live training: progress, curves, pause and single steps.

/** Polling intervals of the progress and of the light's preview, in milliseconds. */
const POLL_INTERVAL = 700;
const PREVIEW_INTERVAL = 5000;
/** Consecutive failures after which the training counts as ended. */
const FAILURES_MAX = 3;

export class Training {
  constructor(server, stream, light, notify) {
    Object.assign(this, { server, stream, light, notify, previewedAt: 0, failures: 0 });
    const element = (id) => document.getElementById(id);
    [this.section, this.progress, this.curve, this.button] = ["training", "progress", "curve", "pause"].map(element);
    this.steering = element("steering");
    if (!server.scene.live) return;
    this.section.hidden = false;
    this.button.addEventListener("click", () => this.toggle());
    for (const button of this.section.querySelectorAll("[data-steps]")) {
      button.addEventListener("click", () => this.steer({ do: "step", steps: button.dataset.steps }));
    }
    this.poll();
  }

  toggle() {
    if (this.server.scene.live && !this.steering.hidden) this.steer({ do: this.isPaused ? "go" : "pause" });
  }

  async steer(query) {
    try {
      this.show(await (await this.server.post("training", query)).json());
    } catch (error) {
      this.notify(error.message);
    }
  }

  async poll() {
    try {
      this.show(await (await this.server.get("training", {})).json());
      this.failures = 0;
    } catch {
      this.failures += 1;
    }
    if (this.failures >= FAILURES_MAX) {
      this.steering.hidden = true;
      this.progress.textContent = "The training has ended or was stopped; specula view shows its result.";
    }
    if (!this.isShown) setTimeout(() => this.poll(), POLL_INTERVAL);
  }

  show(report) {
    const { iteration, iterations, seconds, psnr, gaussians, finished, paused, curve } = report;
    this.isPaused = paused;
    this.steering.hidden = finished;
    this.button.textContent = paused ? "Resume" : "Pause";
    this.button.classList.toggle("on", paused);
    const quality = psnr === null ? "" : `, PSNR ${psnr.toFixed(2)} dB`;
    const head = finished ? "Training finished: " : "";
    this.progress.textContent =
      `${head}${iteration} of ${iterations}, ${Math.round(seconds)} s${quality}, ${gaussians.toLocaleString("en").replaceAll(",", " ")} Gaussians`;
    this.progress.dataset.iteration = iteration;
    this.draw(curve, iterations);
    // A picture in flight may still show an earlier iteration.
    const isLatest = Number(this.stream.iteration) === iteration;
    this.isShown = finished && isLatest && this.stream.isIdle;
    if (this.isShown && this.server.scene.shaded) this.light.loadPreview();
    if (isLatest || !this.stream.isIdle) return;
    this.stream.change(false);
    const now = performance.now();
    if (now - this.previewedAt < PREVIEW_INTERVAL || !this.server.scene.shaded) return;
    this.previewedAt = now;
    this.light.loadPreview();
  }

  /** Plots PSNR and the number of Gaussians over the iterations, each scaled to its range. */
  draw(curve, iterations) {
    const { curve: canvas } = this;
    const density = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [canvas.clientWidth * density, canvas.clientHeight * density];
    [canvas.width, canvas.height] = [width, height];
    const context = canvas.getContext("2d");
    context.font = `${11 * density}px system-ui, sans-serif`;
    const rows = [
      { values: curve.psnr, color: "#e0a458", unit: " dB", digits: 1 },
      { values: curve.gaussians, color: "#7fa8c9", unit: " Gaussians", digits: 0 },
    ];
    const margin = 16 * density;
    rows.forEach(({ values, color, unit, digits }, row) => {
      const known = values.filter((value) => value !== null);
      if (known.length === 0) return;
      const [least, most] = [Math.min(...known), Math.max(...known)];
      const y = (value) => height - 2 - (height - margin - 4) * ((value - least) / (most - least || 1));
      [context.strokeStyle, context.fillStyle, context.lineWidth] = [color, color, 1.5 * density];
      context.beginPath();
      values.forEach((value, k) => value !== null && context.lineTo((width * curve.iteration[k]) / iterations, y(value)));
      context.stroke();
      context.textAlign = row === 0 ? "left" : "right";
      const range = [least, most].map((value) => value.toFixed(digits)).join(" – ");
      context.fillText(range + unit, row === 0 ? 0 : width, margin - 5 * density);
    });
  }
}
