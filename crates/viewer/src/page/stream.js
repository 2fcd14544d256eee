// Picture stream: requests one picture at a time, at reduced resolution during movement and at full
// resolution at rest. With at most one request in flight, the rate adapts to the link. The last
// picture at rest is lossless; on a slow link it follows a compressed draft.

import { life } from "./life.js";

/** Longest time of a picture during movement, from request to display, in milliseconds. */
const FRAME_TIME = 80;
/** Time without a change after which the camera is at rest, in milliseconds. */
const REST_TIME = 160;
/** Bounds of the resolution during movement, relative to the canvas. */
const SCALES = [0.12, 1];
/** Rate in bytes per millisecond below which a compressed draft precedes a lossless picture. */
const FAST_LINK = 1500;
/** Time of a picture after which the page says that it is at work, in milliseconds. */
const PATIENCE = 700;
/** Delay between attempts while the server does not answer, in milliseconds. */
const RETRY_DELAY = 1000;

export class Stream {
  /** `query` returns the parameters of a picture of a given size, at rest or during movement. */
  constructor(canvas, query, server) {
    Object.assign(this, { canvas, query, server });
    this.context = canvas.getContext("2d", { alpha: false });
    this.scale = 0.5;
    this.isSlow = /2g|3g/.test(navigator.connection?.effectiveType ?? "");
    this.changedAt = 0;
    this.isOutdated = false;
    this.hasDraft = false;
    this.background = () => this.server.scene.background;
    this.request = null;
    this.shown = 0;
    this.burst = null;
    this.onshown = () => {};
    this.onwait = () => {};
    this.onerror = () => {};
    document.addEventListener("visibilitychange", () => this.next(), life);
  }

  /** Requests a new picture, at full resolution after a single step (`isMoving` is false). */
  change(isMoving = true) {
    this.changedAt = isMoving ? performance.now() : -REST_TIME;
    this.isOutdated = true;
    this.hasDraft = false;
    this.canvas.dataset.still = "false";
    // A picture at full resolution takes long and would delay the movement.
    if (this.request?.isStill) this.request.abort.abort();
    this.next();
  }

  /** Whether the latest picture is shown. */
  get isIdle() {
    return !this.request && !this.isOutdated;
  }

  /** Whether anybody sees the canvas; else pictures wait until it is shown. */
  get isSeen() {
    return !document.hidden && this.canvas.clientWidth > 0 && this.canvas.clientHeight > 0;
  }

  get isResting() {
    return performance.now() - this.changedAt >= REST_TIME;
  }

  /** Size of the canvas in device pixels, within the limits of the server. */
  fullSize() {
    const density = Math.min(window.devicePixelRatio || 1, 2);
    const size = [this.canvas.clientWidth, this.canvas.clientHeight].map((edge) => Math.max(edge * density, 16));
    const fit = Math.min(1, Math.sqrt(this.server.scene.pixels_max / (size[0] * size[1])), 4096 / Math.max(...size));
    return size.map((edge) => Math.floor(edge * fit));
  }

  async next() {
    if (this.request || !this.isOutdated || !this.isSeen) return;
    const isStill = this.isResting;
    const isDraft = isStill && this.isSlow && !this.hasDraft;
    this.isOutdated = !isStill || isDraft;
    this.request = { isStill, isDraft, abort: new AbortController() };
    let wait = 0;
    const patience = setTimeout(() => this.onwait(), PATIENCE);
    try {
      await this.fetch(this.request);
    } catch (error) {
      if (error.name !== "AbortError") {
        this.onerror(error);
        wait = error.isFinal ? -1 : RETRY_DELAY;
      }
    }
    clearTimeout(patience);
    this.request = null;
    if (wait < 0) this.isOutdated = false;
    else if (wait > 0) setTimeout(() => this.next(), wait, (this.isOutdated = true));
    else if (this.isResting) this.next();
    // After the last movement, the picture at full resolution follows at rest.
    else setTimeout(() => this.next(), this.isStillMoving() ? 0 : REST_TIME);
  }

  isStillMoving() {
    return performance.now() - this.changedAt < 0.5 * REST_TIME;
  }

  async fetch({ isStill, isDraft, abort }) {
    const full = this.fullSize();
    const size = isStill ? full : full.map((edge) => Math.max(16, Math.round(edge * this.scale)));
    const encoding = isStill && !isDraft
      ? { format: "png" }
      : { format: "jpeg", quality: isDraft ? 92 : this.isSlow ? 45 : 75 };
    const start = performance.now();
    const query = { ...this.query(size, isStill), size: size.join(","), ...encoding };
    const { picture, bytes, headers, render } = await this.server.picture(query, { signal: abort.signal });
    const time = performance.now() - start;
    this.isSlow = bytes / Math.max(time - render, 1) < FAST_LINK && time - render > FRAME_TIME;
    if (!isStill) this.adapt(time);
    // A change during decoding comes too late to abort the request.
    this.hasDraft = isDraft && !abort.signal.aborted;
    const frame = { isStill, isFinal: isStill && !isDraft, time, render, size: [picture.width, picture.height] };
    this.draw(picture, full);
    picture.close();
    this.report(headers, frame);
  }

  /** Adapts the resolution during movement to the time that the last picture took. */
  adapt(time) {
    const [least, most] = SCALES;
    const change = Math.min(Math.max(Math.sqrt(FRAME_TIME / time), 0.6), 1.25);
    this.scale = Math.min(Math.max(this.scale * change, least), most);
  }

  /** Draws a picture centred on the canvas, scaled to fit, on the background colour. */
  draw(picture, [width, height]) {
    const { canvas, context } = this;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const fit = Math.min(width / picture.width, height / picture.height);
    const [w, h] = [picture.width * fit, picture.height * fit].map(Math.round);
    const [x, y] = [Math.floor((width - w) / 2), Math.floor((height - h) / 2)];
    this.frame = { x: x / width, y: y / height, w: w / width, h: h / height };
    context.fillStyle = `rgb(${this.background().map((c) => Math.round(255 * c)).join()})`;
    if (w < width || h < height) context.fillRect(0, 0, width, height);
    context.imageSmoothingEnabled = w !== picture.width;
    context.imageSmoothingQuality = "high";
    context.drawImage(picture, x, y, w, h);
  }

  /** Converts a position on the canvas to one in the picture, both as fractions; null outside. */
  inPicture([across, down]) {
    const { x, y, w, h } = this.frame ?? { x: 0, y: 0, w: 1, h: 1 };
    const at = [(across - x) / w, (down - y) / h];
    return at.every((fraction) => fraction >= 0 && fraction <= 1) ? at : null;
  }

  /** Publishes the statistics of a picture that is shown. */
  report(headers, frame) {
    const now = performance.now();
    if (frame.isStill) this.burst = null;
    else this.burst = { since: this.burst?.since ?? now, count: (this.burst?.count ?? -1) + 1, now };
    const span = this.burst ? this.burst.now - this.burst.since : 0;
    frame.rate = span > 300 ? (1000 * this.burst.count) / span : null;
    for (const name of ["view", "psnr", "iteration"]) frame[name] = headers.get(`x-${name}`);
    this.iteration = frame.iteration;
    this.shown += 1;
    // A change during decoding makes the picture outdated.
    const still = frame.isFinal && !this.isOutdated;
    Object.assign(this.canvas.dataset, { shown: this.shown, still, scale: this.scale.toFixed(2) });
    this.onshown(frame);
  }
}
