// Suns and lamps: their list with its inputs, the dial of suns, and files of lights.

import { add, cross, dot, length, scale, sub, unit } from "./camera.js";
import { save } from "./path.js";

/** Sun that is added first, as `relight --sun 30,45` has it. */
const SUN = { strength: 3, width: 0.53, color: "ffffff" };
/** Azimuth of an added sun from the viewer's own, and its elevation, in degrees. */
const SUN_ASIDE = 40;
const SUN_ELEVATION = 45;
/** Exposure of the environment under the first sun, so that white surfaces stay below white. */
const STOPS_UNDER_SUN = -1;
/** Place of an added lamp: nearer than the target, relative to its distance; to the right of the
 *  picture's centre and above it, relative to half of the shorter edge. */
const LAMP_NEARER = 0.25;
const LAMP_ASIDE = [0.4, 0.6];
/** Radius of an added lamp, relative to that distance. */
const LAMP_RADIUS = 0.02;
/** Irradiance of the target by an added lamp. */
const LAMP_IRRADIANCE = 2;
/** Largest radius that the slider reaches, relative to the first camera's distance. */
const RADIUS_MAX = 0.25;
/** Ends of the slider of strengths, in powers of two. */
const STOPS = [-8, 12];
/** Length of the dial's horizon from its centre, in units of its picture. */
const HORIZON = 92;
const SVG = "http://www.w3.org/2000/svg";

const element = (id) => document.getElementById(id);
const degrees = (radians) => (radians * 180) / Math.PI;
const radians = (degrees) => (degrees * Math.PI) / 180;
const clamped = (x, least, most) => Math.min(Math.max(x, least), most);
/** Angle from -180 to 180. */
const wrapped = (angle) => ((((angle + 180) % 360) + 360) % 360) - 180;
const rounded = (x, digits = 4) => +x.toPrecision(digits);
const tenth = (x) => Math.round(10 * x) / 10;

/** Text of a sun or lamp, as options of `relight` and requests have it. */
export function text({ kind, azimuth, elevation, position, strength, width, color }) {
  const place = kind === "sun" ? [azimuth, elevation] : position;
  const colored = color === "ffffff" ? "" : `:${color}`;
  return [...place, strength, width].map((x) => rounded(x, 7)).join(",") + colored;
}

/** Parses a sun or lamp; null where the text is none. */
function parsed(kind, entry) {
  const [, list, color = "ffffff"] = /^([^:]*)(?::#?([0-9a-f]{6}))?$/i.exec(entry) ?? [];
  const numbers = (list ?? "").split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
  const [least, most] = kind === "sun" ? [2, 4] : [4, 5];
  if (numbers.length < least || numbers.length > most || !numbers.every(Number.isFinite)) return null;
  if (kind === "sun") {
    const [azimuth, elevation, strength = SUN.strength, width = SUN.width] = numbers;
    const isValid = Math.abs(elevation) <= 90 && strength >= 0 && width >= 0 && width < 180;
    return isValid ? { kind, azimuth, elevation, strength, width, color } : null;
  }
  const [x, y, z, strength, width = 0] = numbers;
  return strength >= 0 && width >= 0 ? { kind, position: [x, y, z], strength, width, color } : null;
}

export class Lamps {
  /** `changed` is called with whether a change goes on, such as during a drag. */
  constructor(server, initial, light, camera, changed, notify) {
    Object.assign(this, { server, light, camera, notify, items: [], selected: 0 });
    const { scene } = server;
    this.onchange = changed;
    element("lamps-of-materials").hidden = !scene.physical;
    element("no-lamps").hidden = scene.physical;
    this.north = cross(scene.up, scene.azimuth_zero);
    if (!scene.physical) return;
    this.dial = element("dial");
    this.list = element("lamps");
    element("add-sun").addEventListener("click", () => this.addSun());
    element("add-lamp").addEventListener("click", () => this.addLamp());
    element("save-lights").addEventListener("click", () => this.saveFile());
    element("copy-command").addEventListener("click", () => this.copyCommand());
    const { suns = scene.setup.suns, lamps = scene.setup.lamps } = initial;
    const entries = (kind, list) => (list === "" ? [] : list.split(";").map((entry) => parsed(kind, entry)));
    const all = [...entries("sun", suns), ...entries("lamp", lamps)];
    this.items = all.filter((item) => item !== null).slice(0, scene.lamps_max);
    if (this.items.length < all.length) notify("the address has invalid suns or lamps; they are ignored");
    this.build();
  }

  get isDark() {
    return this.items.length === 0;
  }

  of(kind) {
    return this.items.filter((item) => item.kind === kind);
  }

  /** Parameters of requests. */
  query() {
    const [suns, lamps] = ["sun", "lamp"].map((kind) => this.of(kind).map(text).join(";"));
    return { ...(suns && { suns }), ...(lamps && { lamps }) };
  }

  /** Parameters of the URL fragment; empty ones too, where the page would start with others. */
  state() {
    const { setup } = this.server.scene;
    return { ...(setup.suns && { suns: "" }), ...(setup.lamps && { lamps: "" }), ...this.query() };
  }

  /** Azimuth and elevation of a direction in degrees, the turn of the light included. */
  angles(direction) {
    const { up, azimuth_zero: east } = this.server.scene;
    const azimuth = degrees(Math.atan2(dot(direction, this.north), dot(direction, east)));
    return [azimuth, degrees(Math.asin(clamped(dot(unit(direction), up), -1, 1)))];
  }

  /** Azimuth of the view direction; of the upper edge if the camera looks straight up or down. */
  get heading() {
    const { look, up } = this.camera;
    const vertical = this.server.scene.up;
    const level = sub(look, scale(vertical, dot(look, vertical)));
    return this.angles(length(level) > 1e-3 ? level : scale(up, -Math.sign(dot(look, vertical)) || 1))[0];
  }

  addSun() {
    if (this.isDark && this.light.stops === 0) {
      this.dims = true;
      this.light.set({ stops: STOPS_UNDER_SUN });
    }
    const azimuth = Math.round(wrapped(this.heading + 180 - SUN_ASIDE - this.light.turn));
    this.append({ kind: "sun", azimuth, elevation: SUN_ELEVATION, ...SUN });
  }

  addLamp() {
    const { eye, look, right, angle, distance } = this.camera;
    const half = (1 - LAMP_NEARER) * distance * Math.tan(radians(angle) / 2);
    const [aside, above] = LAMP_ASIDE.map((share) => share * half);
    const offset = [[cross(right, look), above], [right, aside], [look, -LAMP_NEARER * distance]];
    const away = offset.reduce((sum, [axis, step]) => add(sum, scale(axis, step)), [0, 0, 0]);
    const position = add(add(eye, scale(look, distance)), away).map((x) => rounded(x));
    const strength = rounded(LAMP_IRRADIANCE * dot(away, away), 3);
    this.append({ kind: "lamp", position, strength, width: rounded(LAMP_RADIUS * distance, 2), color: "ffffff" });
  }

  append(item) {
    const { lamps_max: most } = this.server.scene;
    if (this.items.length >= most) return this.notify(`there are at most ${most} suns and lamps; remove one first`);
    // Suns come first, as in requests; the order determines the noise of shadows.
    const index = item.kind === "sun" ? this.of("sun").length : this.items.length;
    this.items.splice(index, 0, item);
    this.selected = index;
    this.build();
    this.onchange(false);
  }

  remove(item) {
    this.items = this.items.filter((other) => other !== item);
    this.selected = Math.min(this.selected, Math.max(this.items.length - 1, 0));
    // Restores the exposure that the first sun lowered.
    if (this.isDark && this.dims && this.light.stops === STOPS_UNDER_SUN) this.light.set({ stops: 0 });
    this.build();
    this.onchange(false);
  }

  select(item) {
    const index = this.items.indexOf(item);
    if (index === this.selected) return;
    this.selected = index;
    this.build();
    this.onselect?.();
  }

  /** Changes numbers of an item while its inputs stay. */
  set(item, numbers) {
    Object.assign(item, numbers);
    this.rows.get(item)?.();
    this.alignDial();
    this.onchange(true);
  }

  /** Rebuilds the list: a line for each item, and the inputs of the selected one. */
  build() {
    this.rows = new Map();
    const counts = { sun: 0, lamp: 0 };
    this.list.replaceChildren(...this.items.map((item, index) => this.entry(item, index, ++counts[item.kind])));
    const isFull = this.items.length >= this.server.scene.lamps_max;
    for (const id of ["add-sun", "add-lamp"]) element(id).disabled = isFull;
    this.dial.parentElement.hidden = counts.sun === 0;
    element("lights-of-file").hidden = this.isDark;
    this.buildDial();
  }

  entry(item, index, number) {
    const entry = document.createElement("li");
    const isSelected = index === this.selected;
    const name = `${item.kind === "sun" ? "Sun" : "Lamp"} ${number}`;
    const title = button(name, () => this.select(item));
    title.setAttribute("aria-expanded", isSelected);
    const color = input("color", `#${item.color}`, () => this.set(item, { color: color.value.slice(1) }));
    color.setAttribute("aria-label", `Colour of ${name}`);
    const remove = button("×", () => this.remove(item));
    remove.setAttribute("aria-label", `Remove ${name}`);
    const head = document.createElement("div");
    head.className = "row";
    head.append(color, title, remove);
    [color, remove].forEach((child) => child.classList.add("narrow"));
    entry.append(head);
    if (isSelected) entry.append(...(item.kind === "sun" ? this.sunInputs(item) : this.lampInputs(item)));
    return entry;
  }

  sunInputs(item) {
    const plain = (key) => ({ get: () => item[key], set: (x) => this.set(item, { [key]: x }) });
    const fields = [
      field("Azimuth", "°", plain("azimuth"), { min: -180, max: 180, step: 1 }),
      field("Elevation", "°", plain("elevation"), { min: -90, max: 90, step: 1 }),
      this.strength(item),
      field("Diameter", "°", plain("width"), { min: 0, max: 30, step: 0.1, most: 179.9 }),
    ];
    this.rows.set(item, () => fields.forEach((field) => field.show()));
    return fields.map((field) => field.row);
  }

  lampInputs(item) {
    const { reach } = this.camera;
    const place = document.createElement("div");
    place.className = "place";
    const inputs = ["x", "y", "z"].map((name, axis) => {
      const number = input("number", item.position[axis], () => {
        if (number.value === "" || !Number.isFinite(number.valueAsNumber)) return;
        this.set(item, { position: item.position.map((x, k) => (k === axis ? number.valueAsNumber : x)) });
      });
      number.step = 10 ** Math.floor(Math.log10(0.02 * reach));
      number.setAttribute("aria-label", `Position ${name}`);
      return number;
    });
    place.append("Place", ...inputs);
    const radius = { get: () => item.width, set: (x) => this.set(item, { width: x }) };
    const fields = [
      this.strength(item),
      field("Radius", "", radius, { min: 0, max: RADIUS_MAX * reach, step: rounded(0.001 * reach, 1), most: 1e9 }),
    ];
    this.rows.set(item, () => {
      fields.forEach((field) => field.show());
      inputs.forEach((number, axis) => show(number, rounded(item.position[axis])));
    });
    return [place, ...fields.map((field) => field.row)];
  }

  /** Strength: its slider has equal steps for equal ratios. */
  strength(item) {
    const value = { get: () => item.strength, set: (x) => this.set(item, { strength: x }) };
    const [min, max] = STOPS;
    const onSlider = (strength) => Math.log2(Math.max(strength, 2 ** min));
    return field("Strength", "", value, { min, max, step: 0.1, least: 0, most: 1e9, onSlider, ofSlider: (x) => rounded(2 ** x, 3) });
  }

  /** Builds the dial: the sky from above, with the viewing direction at its upper edge. */
  buildDial() {
    this.handles = new Map();
    const suns = this.of("sun").map((item) => {
      const handle = document.createElementNS(SVG, "circle");
      handle.setAttribute("r", 11);
      handle.addEventListener("pointerdown", (event) => {
        event.preventDefault();
        this.dial.setPointerCapture(event.pointerId);
        this.dragged = item;
        this.select(item);
      });
      this.handles.set(item, handle);
      return handle;
    });
    element("suns-of-dial").replaceChildren(...suns);
    if (!this.isDialHeard) this.listenToDial();
    this.alignDial();
  }

  listenToDial() {
    this.isDialHeard = true;
    this.dial.addEventListener("pointermove", (event) => {
      if (!this.dragged || !this.dial.hasPointerCapture(event.pointerId)) return;
      const { left, top, width } = this.dial.getBoundingClientRect();
      const [x, y] = [event.clientX - left, event.clientY - top].map((at) => (200 * at) / width - 100);
      const off = Math.min(Math.hypot(x, y) / HORIZON, 1);
      const azimuth = wrapped(this.heading + degrees(Math.atan2(-x, -y)) - this.light.turn);
      this.set(this.dragged, { azimuth: tenth(azimuth), elevation: tenth(90 * (1 - off)) });
    });
    for (const name of ["pointerup", "pointercancel"]) this.dial.addEventListener(name, () => (this.dragged = null));
  }

  /** Places the suns on the dial, for the camera and the turn of the light. */
  alignDial() {
    if (!this.handles) return;
    const { heading } = this;
    for (const [item, handle] of this.handles) {
      const angle = radians(item.azimuth + this.light.turn - heading);
      const off = HORIZON * clamped((90 - item.elevation) / 90, 0, 1);
      handle.setAttribute("cx", -off * Math.sin(angle));
      handle.setAttribute("cy", -off * Math.cos(angle));
      handle.style.fill = item.elevation < 0 ? "transparent" : `#${item.color}`;
      handle.classList.toggle("selected", item === this.items[this.selected]);
    }
  }

  /** Environment as `relight` reads it: its file, and a remark on where that is. */
  environment() {
    const { name } = this.server.scene;
    const { id, file, up } = this.light.label;
    if (id === "none") return null;
    if (file) return { file, up, remark: "next to this file" };
    const exported = `${name}-light.exr`;
    return { file: exported, up: "z", remark: `the light of the training: specula export ${quoted(name)} -o ${quoted(exported)}` };
  }

  /** File of lights. */
  file() {
    const { name } = this.server.scene;
    const environment = this.environment();
    const lines = [`# Lights of ${JSON.stringify(name)}, for relight --lights and view --lights of specula.`];
    if (environment) {
      lines.push(`env = ${JSON.stringify(environment.file)}  # ${environment.remark}`);
      if (environment.up !== "scene") lines.push(`env-up = ${JSON.stringify(environment.up)}`);
    }
    if (environment && this.light.stops !== 0) lines.push(`exposure = ${this.light.stops}`);
    if (this.light.turn !== 0) lines.push(`turn = ${this.light.turn}`);
    if (this.light.ground.checked) lines.push("ground = true");
    for (const kind of ["sun", "lamp"]) {
      if (this.of(kind).length > 0) lines.push(`${kind} = ${JSON.stringify(this.of(kind).map(text))}`);
    }
    return `${lines.join("\n")}\n`;
  }

  /** Command line with the same lights. */
  command() {
    const environment = this.environment();
    const words = ["specula", "relight", quoted(this.server.scene.name)];
    if (environment) words.push("--env", quoted(environment.file));
    if (environment && environment.up !== "scene") words.push("--env-up", environment.up);
    if (environment && this.light.stops !== 0) words.push("--exposure", this.light.stops);
    if (this.light.turn !== 0) words.push("--turn", this.light.turn);
    if (this.light.ground.checked) words.push("--ground");
    for (const item of this.items) words.push(`--${item.kind}`, text(item));
    return words.join(" ");
  }

  saveFile() {
    save(new Blob([this.file()], { type: "application/toml" }), `${this.server.scene.name}-lights.toml`);
    this.tell("saved");
  }

  async copyCommand() {
    const command = this.command();
    try {
      await navigator.clipboard.writeText(command);
      this.tell("copied");
    } catch {
      // Pages from other machines have no clipboard.
      this.notify(command, "note");
    }
  }

  /** Says what was done, and which file the lights need. */
  tell(done) {
    const environment = this.environment();
    const missing = environment && !this.light.label.file ? `; it needs ${environment.remark}` : "";
    this.notify(done + missing, "note");
    setTimeout(() => this.notify(""), 6000);
  }
}

/** Word of a shell. */
function quoted(word) {
  return /^[\w.,:/=+-]+$/.test(word) ? word : `'${word.replaceAll("'", `'\\''`)}'`;
}

function button(label, act) {
  const element = document.createElement("button");
  element.textContent = label;
  element.addEventListener("click", act);
  return element;
}

function input(type, value, act) {
  const element = document.createElement("input");
  Object.assign(element, { type, value });
  element.addEventListener("input", act);
  return element;
}

/** Shows a number, unless it is being typed. */
function show(input, value) {
  if (document.activeElement !== input || input.type === "range") input.value = value;
}

/** Line of a slider and a number of the same value, which `value` reads and writes. */
function field(label, suffix, value, { min, max, step, least = min, most = max, onSlider = (x) => x, ofSlider = (x) => x }) {
  const row = document.createElement("div");
  row.className = "field";
  const name = document.createElement("span");
  name.textContent = suffix ? `${label}, ${suffix}` : label;
  const slider = input("range", 0, () => value.set(ofSlider(slider.valueAsNumber)));
  Object.assign(slider, { min, max, step });
  const number = input("number", 0, () => {
    const typed = number.valueAsNumber;
    if (Number.isFinite(typed)) value.set(clamped(typed, least, most));
  });
  Object.assign(number, { min: least, max: most, step: "any" });
  slider.setAttribute("aria-label", label);
  number.setAttribute("aria-label", label);
  const field = { row, show: () => [show(slider, onSlider(value.get())), show(number, rounded(value.get()))] };
  row.append(name, slider, number);
  field.show();
  return field;
}
