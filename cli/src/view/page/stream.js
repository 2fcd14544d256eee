// Pictures from the server, one after the other: small ones while something moves, a whole one when it rests. There is
// one on the way at most, so a slow link gets as many as it can take.

/** Milliseconds that a picture may take while one moves. */
const PACE = 80;
/** Milliseconds without change until one counts as resting. */
const REST = 160;
/** Least and largest share of the pixels along an edge while one moves. */
const SHARES = [0.12, 1];
/** Bytes in a millisecond from which on a link takes exact pictures. */
const FAST_LINK = 1500;
/** Waits between attempts while the server is away, in milliseconds. */
const RETRY = 1000;

export class Stream {
  constructor(canvas, ask, server) {
    Object.assign(this, { canvas, ask, server });
    this.context = canvas.getContext("2d", { alpha: false });
    this.share = 0.5;
    this.isSlow = /2g|3g/.test(navigator.connection?.effectiveType ?? "");
    this.changedAt = 0;
    this.isWanted = false;
    this.hasGround = () => true;
    this.flight = null;
    this.shown = 0;
    this.pace = null;
    this.onshown = () => {};
    this.onerror = () => {};
  }

  /** Something has changed: another picture is wanted. `isMoving` is false where it is a single step. */
  change(isMoving = true) {
    this.changedAt = isMoving ? performance.now() : -REST;
    this.isWanted = true;
    this.canvas.dataset.still = "false";
    // A whole picture takes long; who moves on does not wait for it.
    if (this.flight?.isStill) this.flight.abort.abort();
    this.next();
  }

  /** Whether what is wanted is shown. */
  get isIdle() {
    return !this.flight && !this.isWanted;
  }

  get isResting() {
    return performance.now() - this.changedAt >= REST;
  }

  /** Pixels of the canvas as it is seen, at most as many as the server renders. */
  wholeSize() {
    const density = Math.min(window.devicePixelRatio || 1, 2);
    const size = [this.canvas.clientWidth, this.canvas.clientHeight].map((edge) => Math.max(edge * density, 16));
    const fit = Math.min(1, Math.sqrt(this.server.scene.pixels_max / (size[0] * size[1])), 4096 / Math.max(...size));
    return size.map((edge) => Math.floor(edge * fit));
  }

  async next() {
    if (this.flight || !this.isWanted) return;
    const isStill = this.isResting;
    this.isWanted = !isStill;
    this.flight = { isStill, abort: new AbortController() };
    let wait = 0;
    try {
      await this.fetch(isStill);
    } catch (error) {
      if (error.name !== "AbortError") {
        this.onerror(error);
        wait = error.isFinal ? -1 : RETRY;
      }
    }
    this.flight = null;
    if (wait < 0) this.isWanted = false;
    // Who has just stopped is given a whole picture after a moment.
    else if (wait > 0) setTimeout(() => this.next(), wait, (this.isWanted = true));
    else if (this.isResting) this.next();
    else setTimeout(() => this.next(), this.isMovingOn() ? 0 : REST);
  }

  isMovingOn() {
    return performance.now() - this.changedAt < 0.5 * REST;
  }

  async fetch(isStill) {
    const whole = this.wholeSize();
    const size = isStill ? whole : whole.map((edge) => Math.max(16, Math.round(edge * this.share)));
    const packing = isStill && !this.isSlow
      ? { format: "png" }
      : { format: "jpeg", quality: isStill ? 92 : this.isSlow ? 45 : 75 };
    const start = performance.now();
    const words = { ...this.ask(size), size: size.join(","), ...packing };
    const response = await this.server.get("frame", words, { signal: this.flight.abort.signal });
    const blob = await response.blob();
    const picture = await createImageBitmap(blob);
    const time = performance.now() - start;
    const timing = response.headers.get("server-timing") ?? "";
    const render = [...timing.matchAll(/dur=([\d.]+)/g)].reduce((sum, [, time]) => sum + Number(time), 0);
    this.isSlow = blob.size / Math.max(time - render, 1) < FAST_LINK && time - render > PACE;
    if (!isStill) this.adapt(time);
    const facts = { isStill, time, render, size: [picture.width, picture.height] };
    this.draw(picture, whole);
    picture.close();
    this.tell(response, facts);
  }

  /** The share of the pixels with which the next picture takes as long as it may. */
  adapt(time) {
    const [least, most] = SHARES;
    const change = Math.min(Math.max(Math.sqrt(PACE / time), 0.6), 1.25);
    this.share = Math.min(Math.max(this.share * change, least), most);
  }

  /** A picture in the middle of the canvas, as large as fits; around it is the background. */
  draw(picture, [width, height]) {
    const { canvas, context } = this;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const fit = Math.min(width / picture.width, height / picture.height);
    const [w, h] = [picture.width * fit, picture.height * fit].map(Math.round);
    const [x, y] = [Math.floor((width - w) / 2), Math.floor((height - h) / 2)];
    // Beside a layer, or the light, nothing is as bright as a background may be.
    const ground = this.hasGround() ? this.server.scene.background : [0, 0, 0];
    this.place = { x: x / width, y: y / height, w: w / width, h: h / height };
    context.fillStyle = `rgb(${ground.map((c) => Math.round(255 * c)).join()})`;
    if (w < width || h < height) context.fillRect(0, 0, width, height);
    context.imageSmoothingEnabled = w !== picture.width;
    context.imageSmoothingQuality = "high";
    context.drawImage(picture, x, y, w, h);
  }

  /** A point of the canvas as one of the picture in it, both in shares of their edges; none beside it. */
  inPicture([across, down]) {
    const { x, y, w, h } = this.place ?? { x: 0, y: 0, w: 1, h: 1 };
    const at = [(across - x) / w, (down - y) / h];
    return at.every((share) => share >= 0 && share <= 1) ? at : null;
  }

  tell(response, facts) {
    const now = performance.now();
    if (facts.isStill) this.pace = null;
    else this.pace = { since: this.pace?.since ?? now, count: (this.pace?.count ?? -1) + 1, now };
    const span = this.pace ? this.pace.now - this.pace.since : 0;
    facts.rate = span > 300 ? (1000 * this.pace.count) / span : null;
    for (const name of ["view", "psnr", "iteration"]) facts[name] = response.headers.get(`x-${name}`);
    this.iteration = facts.iteration;
    this.shown += 1;
    // Something may have changed while it was unpacked, when nothing can be aborted any more.
    const still = facts.isStill && !this.isWanted;
    Object.assign(this.canvas.dataset, { shown: this.shown, still, share: this.share.toFixed(2) });
    this.onshown(facts);
  }
}
