// Light: environment map, rotation and exposure; uploads of opened and dropped files.

import { life } from "./life.js";

/** Attempts to upload a light, and the delay between them in milliseconds. */
const ATTEMPTS = 120;
const RETRY_DELAY = 1000;
/** Largest exposure of the slider, in stops. */
const STOPS_MAX = 4;

export class Light {
  /** `initial` holds the parameters of the URL fragment at page load. */
  constructor(server, initial, changed, notify) {
    Object.assign(this, { server, changed, notify, id: 0, turn: 0, stops: 0 });
    const element = (id) => document.getElementById(id);
    // The slider reaches the exposure that the page starts with.
    this.stopsMax = Math.max(STOPS_MAX, Math.abs(server.scene.setup.stops));
    this.labels = new Map();
    [this.choice, this.panorama, this.file] = ["lights", "panorama", "light-file"].map(element);
    [this.turnInput, this.stopsInput] = ["turn", "stops"].map(element);
    element("light").hidden = !server.scene.shaded;
    [this.stopsInput.min, this.stopsInput.max] = [-this.stopsMax, this.stopsMax];
    server.scene.lights.forEach((light) => this.addOption(light));
    this.choice.addEventListener("change", () => this.choose(this.choice.value));
    element("open-light").addEventListener("click", () => this.file.click());
    this.file.addEventListener("change", () => this.upload([...this.file.files]));
    this.turnInput.addEventListener("input", () => this.set({ turn: Number(this.turnInput.value) }));
    this.stopsInput.addEventListener("input", () => this.set({ stops: Number(this.stopsInput.value) }));
    this.listenForDrags();
    this.listenForDrops();
    [this.backdrop, this.ground] = ["backdrop", "ground"].map(element);
    for (const box of [this.backdrop, this.ground]) box.addEventListener("change", () => this.changed());
    // Only the surface of physical materials casts shadows on it.
    this.ground.parentElement.hidden = !server.scene.physical;
    if (server.scene.shaded && server.scene.lights.length > 0) this.restore(initial);
  }

  /** Restores the selection from parameters of the URL fragment. */
  restore({ backdrop, ...given }) {
    const { lights, setup, physical } = this.server.scene;
    this.ground.checked = physical && (given.ground ?? (setup.ground ? "on" : "off")) === "on";
    const { light, turn, stops } = { ...setup, ...given };
    this.backdrop.checked = backdrop === "env";
    this.set({ turn: Number(turn) || 0, stops: Number(stops) || 0 });
    this.choose(this.labels.has(String(light)) ? light : lights[0].id);
  }

  /** Parameters of the URL fragment: those that differ from zero here or where the page starts. */
  state() {
    const { setup } = this.server.scene;
    const all = { light: this.id, turn: this.turn, stops: this.stops };
    const differs = ([name, value]) => value !== 0 || setup[name] !== 0;
    const changed = Object.fromEntries(Object.entries(all).filter(differs));
    const ground = this.ground.checked === setup.ground ? {} : { ground: this.ground.checked ? "on" : "off" };
    return { ...changed, ...ground, ...(this.backdrop.checked ? { backdrop: "env" } : {}) };
  }

  toggleBackdrop() {
    this.backdrop.click();
  }

  toggleGround() {
    if (!this.ground.parentElement.hidden) this.ground.click();
  }

  /** Query parameters. */
  query() {
    const { id: light, turn, stops } = this;
    const boxes = { ...(this.backdrop.checked && { backdrop: "env" }), ...(this.ground.checked && { ground: "on" }) };
    return { light, turn, stops, ...boxes };
  }

  addOption(label) {
    this.labels.set(String(label.id), label);
    this.choice.add(new Option(label.id === "none" ? "none: darkness" : label.name, label.id));
  }

  /** Label of the selected light. */
  get label() {
    return this.labels.get(String(this.id)) ?? { id: 0 };
  }

  /** Whether the light is that of the training, as it was. */
  get isOwn() {
    return this.id === 0 && this.turn === 0 && this.stops === 0;
  }

  choose(id) {
    this.id = this.labels.get(String(id)).id;
    this.choice.value = this.id;
    this.loadPreview();
    this.set({});
  }

  /** Loads the preview of the selected light. */
  loadPreview() {
    this.server
      .get("light", { light: this.id })
      .then((response) => response.blob())
      .then((blob) => {
        URL.revokeObjectURL(this.url);
        this.url = URL.createObjectURL(blob);
        this.panorama.style.backgroundImage = `url(${this.url})`;
      })
      .catch(() => (this.panorama.style.backgroundImage = "none"));
  }

  /** Sets the rotation in degrees and the exposure in stops. */
  set({ turn = this.turn, stops = this.stops }) {
    this.turn = ((((turn + 180) % 360) + 360) % 360) - 180;
    this.stops = Math.min(Math.max(stops, -this.stopsMax), this.stopsMax);
    this.turnInput.value = this.turn;
    this.stopsInput.value = this.stops;
    document.getElementById("turn-value").value = `${Math.round(this.turn)}°`;
    document.getElementById("stops-value").value = this.stops > 0 ? `+${this.stops}` : this.stops;
    this.panorama.style.filter = `brightness(${2 ** (this.stops / 2.2)})`;
    this.alignPanorama();
    this.changed();
  }

  /** Shifts the panorama by the rotation; its left side is counterclockwise, seen from above. */
  alignPanorama() {
    this.panorama.style.backgroundPositionX = `${(-this.turn / 360) * this.panorama.clientWidth}px`;
  }

  listenForDrags() {
    const { panorama } = this;
    panorama.addEventListener("pointerdown", (event) => panorama.setPointerCapture(event.pointerId));
    panorama.addEventListener("pointermove", (event) => {
      if (!panorama.hasPointerCapture(event.pointerId)) return;
      this.set({ turn: Math.round(this.turn - (360 * event.movementX) / panorama.clientWidth) });
    });
  }

  listenForDrops() {
    const holdsFiles = (event) => event.dataTransfer?.types.includes("Files");
    const mark = (isOver) => document.body.classList.toggle("dropping", isOver);
    window.addEventListener("dragover", (event) => {
      if (!holdsFiles(event)) return;
      event.preventDefault();
      mark(true);
    }, life);
    window.addEventListener("dragleave", (event) => event.relatedTarget === null && mark(false), life);
    window.addEventListener("drop", (event) => {
      event.preventDefault();
      mark(false);
      this.upload([...event.dataTransfer.files]);
    }, life);
  }

  /** Uploads a file as soon as the server reads no other one; notifies while it waits. */
  async send(file, query) {
    for (let attempt = 1; ; attempt++) {
      // A rejected upload may close the connection before the response is read, so ask first.
      const { reading } = await (await this.server.get("scene", {})).json();
      try {
        if (!reading) return await this.server.post("light", query, file);
      } catch (error) {
        if (error.isFinal || attempt === ATTEMPTS) throw error;
      }
      this.notify(`another light is being read; ${file.name} waits for its turn`, "note");
      await new Promise((resume) => setTimeout(resume, RETRY_DELAY));
    }
  }

  /** Uploads files and selects the last one. A page with a renderer of its own opens scenes as well. */
  async upload(files) {
    const scene = files.find(({ name }) => /\.(glb|gltf)$/i.test(name));
    if (scene && this.server.replace) {
      this.notify(`reading ${scene.name} …`, "note");
      return this.server.replace(scene).catch((error) => this.notify(error.message));
    }
    const messages = [];
    for (const file of files) {
      this.notify(`reading ${file.name} …`, "note");
      try {
        const up = document.getElementById("y-up").checked ? "y" : "scene";
        const response = await this.send(file, { name: file.name, up });
        const light = await response.json();
        this.addOption(light);
        this.choose(light.id);
        messages.push(...light.notes);
      } catch (error) {
        messages.push(error.message);
      }
    }
    this.notify(messages.join("; "));
    this.file.value = "";
  }
}
