// Puts the page together.

import { Address, asked, token } from "./address.js";
import { Camera } from "./camera.js";
import { Controls } from "./controls.js";
import { Light } from "./light.js";
import { Path, save } from "./path.js";
import { Stream } from "./stream.js";
import { Training } from "./training.js";

const element = (id) => document.getElementById(id);

/** Speaks to the server; what it refuses becomes an error with its sentence. */
const server = {
  token,
  client: crypto.getRandomValues(new Uint32Array(1))[0] + 1,
  scene: null,

  async send(path, words, options = {}) {
    const query = new URLSearchParams({ client: this.client, ...words });
    const headers = this.token ? { "x-specula-token": this.token } : {};
    let response;
    try {
      response = await fetch(`${path}?${query}`, { ...options, headers });
    } catch (error) {
      if (error.name === "AbortError") throw error;
      throw new Error("specula does not answer; is it still running?");
    }
    if (response.ok) return response;
    const error = new Error(await response.text());
    error.isFinal = response.status < 500 && response.status !== 409;
    throw error;
  },
  get(path, words, options) {
    return this.send(path, words, options);
  },
  post(path, words, body) {
    return this.send(path, words, { method: "POST", body });
  },
};

/** Pixels along the longer edge of the picture in which a place is looked for. */
const FOCUS_EDGE = 640;
/** How long a sentence stays, in milliseconds. */
const READING_TIME = 8000;

/** Tells something, for a while; of what kind it is says who may take it away again. */
function say(sentence, kind = "error") {
  const message = element("message");
  clearTimeout(say.end);
  message.textContent = sentence;
  message.className = kind;
  message.hidden = sentence === "";
  if (kind === "error") say.end = setTimeout(() => (message.hidden = true), READING_TIME);
}

async function start() {
  server.scene = await (await server.get("scene", {})).json();
  const { scene } = server;
  document.title = `${scene.name} · specula`;
  element("name").textContent = scene.name;

  const canvas = element("picture");
  const camera = new Camera(scene);
  camera.restore(asked);
  let layer = "rgb";
  let light = null;
  const words = () => ({ layer, ...(light ? light.words() : {}) });
  const stream = new Stream(canvas, (size) => ({ ...words(), ...camera.words(size) }), server);
  stream.onshown = (facts) => {
    if (element("message").className === "of-pictures") say("");
    tell(facts, layer);
  };
  stream.hasGround = () => layer === "rgb" && !words().backdrop;
  stream.onerror = (error) => say(error.message, "of-pictures");
  const address = new Address(() => ({ ...camera.state(), ...(light ? light.state() : {}), ...(layer === "rgb" ? {} : { layer }) }));
  const moved = () => {
    follow(camera);
    address.changed();
    stream.change();
  };
  const jumped = () => {
    follow(camera);
    address.changed();
    stream.change(false);
  };
  /** Makes a change of the camera that can be taken back. */
  const jump = (change) => {
    camera.remember();
    change();
    jumped();
  };

  const showLayer = (name) => {
    if (!scene.layers.includes(name)) return;
    layer = name;
    for (const chip of element("layers").children) chip.setAttribute("aria-checked", chip.dataset.layer === name);
    address.changed();
    stream.change(false);
  };
  offerLayers(scene.layers, showLayer);
  offerViews(scene.views, (index) => jump(() => camera.showView(index)));
  light = new Light(server, asked, () => stream.change(address.changed()), say);
  const path = new Path(camera, server, words, moved, say);
  const training = new Training(server, stream, light, say);

  const panel = element("panel");
  const togglePanel = () => {
    panel.hidden = !panel.hidden;
    document.body.classList.toggle("with-panel", !panel.hidden);
    element("show-panel").setAttribute("aria-expanded", !panel.hidden);
    light.place();
  };
  const toggleMode = () => {
    camera.mode = camera.mode === "orbit" ? "fly" : "orbit";
    follow(camera);
    address.changed();
  };
  const home = () => jump(() => camera.reset());
  const undo = () => camera.undo() && jumped();
  const step = (by) => scene.views.length > 0 && jump(() => camera.showView((camera.view ?? (by > 0 ? -1 : 0)) + by));
  const help = () => element("help").showModal();
  const savePicture = () => savePictureOf(server, scene, camera, stream, words()).catch((error) => say(error.message));
  const acts = { mode: toggleMode, home, undo, previous: () => step(-1), next: () => step(1) };
  acts["show-panel"] = togglePanel;
  acts["show-help"] = help;
  acts["full-screen"] = toggleFullScreen;
  acts["save-picture"] = savePicture;
  for (const [id, act] of Object.entries(acts)) element(id).addEventListener("click", act);
  element("full-screen").hidden = !document.fullscreenEnabled;
  element("angle").addEventListener("pointerdown", () => camera.remember());
  element("angle").addEventListener("input", () => moved(camera.setAngle(Number(element("angle").value))));

  const keys = { f: toggleMode, r: home, u: undo, n: acts.next, p: acts.previous, h: togglePanel, "?": help };
  Object.assign(keys, { k: () => path.add(), " ": () => path.play(), t: () => training.toggle() });
  Object.assign(keys, { x: () => showLayer("error"), v: toggleFullScreen, i: savePicture, b: () => light.toggleBackdrop() });
  Object.assign(keys, { "[": () => light.set({ turn: light.turn - 5 }), "]": () => light.set({ turn: light.turn + 5 }) });
  Object.assign(keys, { ",": () => light.set({ stops: light.stops - 0.25 }), ".": () => light.set({ stops: light.stops + 0.25 }) });
  for (let digit = 0; digit < 10; digit++) keys[digit] = () => showLayer(scene.layers[(digit + 9) % 10]);
  const focus = async (at) => {
    const place = stream.inPicture(at)?.map((share) => share.toFixed(4)).join(",");
    if (!place) return;
    const size = stream.wholeSize();
    const small = size.map((edge) => Math.max(1, Math.round(edge * Math.min(1, FOCUS_EDGE / Math.max(...size)))));
    try {
      const words = { ...camera.words(small), size: small.join(","), at: place, client: 0 };
      const { point } = await (await server.get("point", words)).json();
      if (point) jump(() => camera.focus(point));
    } catch (error) {
      say(error.message);
    }
  };
  new Controls(canvas, camera, moved, keys, focus);

  // Where there is little room the picture comes first.
  if (window.matchMedia("(max-width: 640px), (max-height: 480px)").matches) togglePanel();
  new ResizeObserver(() => stream.change(false)).observe(canvas);
  showLayer(scene.layers.includes(asked.layer) ? asked.layer : "rgb");
  follow(camera);
}

function toggleFullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else if (document.fullscreenEnabled) document.documentElement.requestFullscreen();
}

/** Saves what is shown, exactly, at the size of a view of the data set, or else of the window. */
async function savePictureOf(server, scene, camera, stream, words) {
  const size = scene.views[camera.view ?? 0]?.size ?? stream.wholeSize();
  const fit = Math.min(1, Math.sqrt(scene.pixels_max / (size[0] * size[1])), 4096 / Math.max(...size));
  const fitting = size.map((edge) => Math.max(1, Math.floor(edge * fit)));
  const query = { ...words, ...camera.words(fitting), size: fitting.join(","), format: "png", client: 0 };
  const response = await server.get("frame", query);
  save(await response.blob(), `${scene.name}-${words.layer}.png`);
}

/** One button for each layer. */
function offerLayers(layers, show) {
  const chip = (name, index) => {
    const button = document.createElement("button");
    button.textContent = name;
    button.dataset.layer = name;
    button.setAttribute("role", "radio");
    const key = name === "error" ? "x" : (index + 1) % 10;
    button.title = name === "error" ? "Difference from the photograph of the nearest view (x)" : `${name} (${key})`;
    button.addEventListener("click", () => show(name));
    return button;
  };
  element("layers").replaceChildren(...layers.map(chip));
}

function offerViews(views, show) {
  for (const part of document.querySelectorAll(".of-views")) part.hidden = views.length === 0;
  const list = element("views");
  list.add(new Option("a view of the data set …", ""));
  views.forEach(({ name, held_out: isHeldOut }, index) => list.add(new Option(isHeldOut ? `${name} (held out)` : name, index)));
  list.addEventListener("change", () => list.value !== "" && show(Number(list.value)));
}

/** Shows the camera where it is told of. */
function follow(camera) {
  element("views").value = camera.view ?? "";
  element("angle").value = camera.angle;
  element("angle-told").value = `${Math.round(camera.angle)}°`;
  element("mode").textContent = camera.mode === "orbit" ? "Orbit" : "Fly";
  element("undo").disabled = camera.before.length === 0;
}

/** What is known about the picture that is shown. */
function tell({ time, render, size, rate, view, psnr, iteration }, layer) {
  const parts = [`${size[0]} × ${size[1]}`, `${Math.round(time)} ms (${Math.round(render)} rendering)`];
  if (rate !== null) parts.push(`${rate.toFixed(0)} a second`);
  if (psnr !== null) parts.unshift(`${layer} of ${view}: PSNR ${psnr} dB`);
  if (iteration !== null) parts.unshift(`iteration ${iteration}`);
  element("status").textContent = parts.join(", ");
}

start().catch((error) => say(error.message));
