// Camera path: stops, interpolation, and export of its frames and cameras.

import { horizontalAngle, cross, list, unit } from "./camera.js";

/** Time between two stops when the path is played, in seconds. */
const SECONDS_PER_STOP = 2;

export class Path {
  /** `query` returns the query parameters of the layer and the light. */
  constructor(camera, server, query, moved, notify) {
    Object.assign(this, { camera, server, query, moved, notify, stops: [] });
    this.list = document.getElementById("stops-of-path");
    const click = (id, act) => document.getElementById(id).addEventListener("click", act);
    click("add-stop", () => this.add());
    click("clear-path", () => this.set([]));
    click("play", () => this.play());
    click("save-frames", () => this.saveFrames());
    click("save-path", () => this.savePath());
    this.set([]);
  }

  add() {
    this.set([...this.stops, this.camera.snapshot()]);
  }

  set(stops) {
    this.stops = stops;
    const items = stops.map((stop, index) => {
      const item = document.createElement("li");
      const [go, remove] = ["show", "remove"].map((word) => {
        const button = document.createElement("button");
        button.textContent = word;
        item.append(button);
        return button;
      });
      go.addEventListener("click", () => this.showPose(stop));
      remove.addEventListener("click", () => this.set(this.stops.filter((_, other) => other !== index)));
      return item;
    });
    this.list.replaceChildren(...items);
    for (const id of ["play", "save-frames", "save-path"]) document.getElementById(id).disabled = stops.length < 2;
  }

  showPose({ eye, look, up, angle }) {
    this.camera.setPose(eye, look, up, angle);
    this.moved();
  }

  /** Pose at a fraction of the path: a Catmull-Rom spline through all stops. */
  at(fraction) {
    const { stops } = this;
    const position = Math.min(Math.max(fraction, 0), 1) * (stops.length - 1);
    const from = Math.min(Math.floor(position), stops.length - 2);
    const t = position - from;
    const stop = (k) => stops[Math.min(Math.max(k, 0), stops.length - 1)];
    const [a, b, c, d] = [-1, 0, 1, 2].map((k) => stop(from + k));
    const curve = (p, q, r, s) =>
      0.5 * (2 * q + (r - p) * t + (2 * p - 5 * q + 4 * r - s) * t * t + (3 * q - p - 3 * r + s) * t * t * t);
    const vector = (name) => [0, 1, 2].map((k) => curve(a[name][k], b[name][k], c[name][k], d[name][k]));
    const angle = Math.min(Math.max(curve(a.angle, b.angle, c.angle, d.angle), 2), 150);
    const look = unit(vector("look"));
    const right = unit(cross(look, vector("up")));
    return { eye: vector("eye"), look, up: cross(right, look), angle };
  }

  play() {
    if (this.stops.length < 2) return;
    if (this.playing) return this.stop();
    const button = document.getElementById("play");
    button.textContent = "Stop";
    const start = performance.now();
    this.playing = true;
    const tick = (now) => {
      if (!this.playing) return;
      const fraction = (now - start) / (1000 * SECONDS_PER_STOP * (this.stops.length - 1));
      this.showPose(this.at(fraction));
      if (fraction >= 1) this.stop();
      else requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  stop() {
    this.playing = false;
    document.getElementById("play").textContent = "Play";
  }

  /** Poses of all frames, evenly spaced in time. */
  cameras() {
    const count = Math.min(Math.max(Math.round(Number(document.getElementById("frames").value)) || 2, 2), 3600);
    return Array.from({ length: count }, (_, k) => this.at(k / (count - 1)));
  }

  size() {
    const numbers = document.getElementById("frame-size").value.match(/\d+/g)?.map(Number) ?? [];
    return numbers.length === 2 && numbers.every((edge) => edge > 0) ? numbers : null;
  }

  /** Saves cameras for `specula render --cameras`: world from camera, y up, −z forward. */
  savePath() {
    const size = this.size() ?? [800, 600];
    const frames = this.cameras().map(({ eye, look, up, angle }, index) => {
      const right = unit(cross(look, up));
      const rows = [0, 1, 2].map((k) => [right[k], up[k], -look[k], eye[k]]);
      const horizontal = (horizontalAngle(angle, size) * Math.PI) / 180;
      return { file_path: name(index), camera_angle_x: horizontal, transform_matrix: [...rows, [0, 0, 0, 1]] };
    });
    const [w, h] = size;
    const { origin } = this.server.scene;
    save(new Blob([JSON.stringify({ w, h, origin, frames }, null, 1)], { type: "application/json" }), "path.json");
  }

  /** Renders all frames, lossless, and saves them as one ZIP file. */
  async saveFrames() {
    const size = this.size();
    if (!size) return this.notify("a size is two numbers, such as 800×600");
    const [bar, button] = ["saving", "save-frames"].map((id) => document.getElementById(id));
    if (this.saving) return (this.saving = false);
    [this.saving, bar.hidden, button.textContent] = [true, false, "Stop"];
    const cameras = this.cameras();
    const files = [];
    try {
      for (const [index, camera] of cameras.entries()) {
        if (!this.saving) break;
        const { eye, look, up, angle } = camera;
        const pose = { eye: list(eye), look: list(look), up: list(up), angle: horizontalAngle(angle, size).toFixed(5) };
        // Client 0: other requests of this page do not cancel the frame.
        const query = { ...this.query(), ...pose, size: size.join(","), format: "png", client: 0 };
        const response = await this.server.get("frame", query);
        files.push([`${name(index)}.png`, new Uint8Array(await response.arrayBuffer())]);
        bar.value = (index + 1) / cameras.length;
      }
      if (this.saving) save(zip(files), "frames.zip");
    } catch (error) {
      this.notify(error.message);
    }
    [this.saving, bar.hidden, button.textContent] = [false, true, "Save frames"];
  }
}

const name = (index) => String(index).padStart(5, "0");

/** Downloads a blob as a file. */
export function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

const CRC_TABLE = Uint32Array.from({ length: 256 }, (_, byte) => {
  for (let bit = 0; bit < 8; bit++) byte = byte & 1 ? 0xedb88320 ^ (byte >>> 1) : byte >>> 1;
  return byte;
});

function crc32(bytes) {
  let crc = 0xffffffff;
  for (const byte of bytes) crc = CRC_TABLE[(crc ^ byte) & 0xff] ^ (crc >>> 8);
  return (crc ^ 0xffffffff) >>> 0;
}

/** ZIP archive of files, stored without compression: PNGs are compressed already. */
export function zip(files) {
  const [parts, directory] = [[], []];
  let offset = 0;
  const numbers = (...list) => {
    const view = new DataView(new ArrayBuffer(list.reduce((sum, [, size]) => sum + size, 0)));
    let at = 0;
    for (const [value, size] of list) {
      if (size === 4) view.setUint32(at, value, true);
      else view.setUint16(at, value, true);
      at += size;
    }
    return view.buffer;
  };
  for (const [name, bytes] of files) {
    const label = new TextEncoder().encode(name);
    // Version, flags, method (stored), time, date (1 January 1980), CRC, sizes, lengths.
    const header = [[10, 2], [0, 2], [0, 2], [0, 2], [33, 2], [crc32(bytes), 4], [bytes.length, 4], [bytes.length, 4], [label.length, 2], [0, 2]];
    parts.push(numbers([0x04034b50, 4], ...header), label, bytes);
    directory.push(numbers([0x02014b50, 4], [10, 2], ...header, [0, 2], [0, 2], [0, 2], [0, 4], [offset, 4]), label);
    offset += 30 + label.length + bytes.length;
  }
  const size = directory.reduce((sum, part) => sum + part.byteLength, 0);
  const count = files.length;
  const end = numbers([0x06054b50, 4], [0, 2], [0, 2], [count, 2], [count, 2], [size, 4], [offset, 4], [0, 2]);
  return new Blob([...parts, ...directory, end], { type: "application/zip" });
}
