// Entry point: connects camera, controls, stream, light, path and training.

import { Address, initial } from "./address.js";
import { Camera } from "./camera.js";
import { Controls } from "./controls.js";
import { Handles } from "./handles.js";
import { Lamps } from "./lamps.js";
import { life } from "./life.js";
import { Light } from "./light.js";
import { Materials } from "./materials.js";
import { Path, save } from "./path.js";
import { server } from "./server.js";
import { Stream } from "./stream.js";
import { Training } from "./training.js";
import { Turntable } from "./turntable.js";

const element = (id) => document.getElementById(id);

/** Longer edge of the picture in which the depth under the pointer is looked up, in pixels. */
const FOCUS_EDGE = 640;
/** Shadow rays of a pixel to each lamp during movement; at rest the server's default holds. */
const PREVIEW_RAYS = 4;
/** Explanations, on their buttons, of layers with terse names. */
const HINTS = {
  albedo: "colour of the material without light",
  metallic: "share of metal, white is a metal",
  ambient: "share of the surrounding light that is not blocked, white is open",
  visibility: "share of the distant light along the reflection that is not blocked, white is open",
  indirect: "light of other surfaces along the reflection",
  irradiance: "irradiance of the material, shown as the colour of a white wall",
};
/** Status before the first picture. */
const STARTING = element("status").textContent;
/** Duration of an error message, in milliseconds. */
const MESSAGE_TIME = 8000;

/** Shows a message: errors for a while, those of the stream until the next picture, fatal ones for good. */
function notify(text, kind = "error") {
  const [message, status] = [element("message"), element("status")];
  if (status.textContent === STARTING) status.textContent = "";
  clearTimeout(notify.timer);
  message.textContent = text;
  message.className = kind;
  message.hidden = text === "";
  if (kind === "error") notify.timer = setTimeout(() => (message.hidden = true), MESSAGE_TIME);
}

/** Elements of the page before anything is shown. */
const fresh = pristine();

function pristine() {
  const copy = document.body.cloneNode(true);
  for (const other of copy.querySelectorAll("script, #still")) other.remove();
  return copy.innerHTML;
}

/** Shows the scene that the server has instead of the last one. */
async function restart() {
  life.renew();
  for (const name of Object.keys(initial)) delete initial[name];
  document.body.innerHTML = fresh;
  open();
}

async function start() {
  server.onreplaced = restart;
  server.scene = await (await server.get("scene", {})).json();
  const { scene } = server;
  document.title = `${scene.name} · specula`;
  element("caption").textContent = scene.caption ?? "";
  element("about").hidden = !scene.caption;
  element("name").textContent = scene.name;

  const canvas = element("picture");
  const camera = new Camera(scene);
  camera.restore(initial);
  let layer = "rgb";
  let [light, lamps, materials, handles] = [null, null, null, null];
  const query = () => ({ layer, ...light?.query(), ...lamps?.query(), ...materials?.query() });
  const preview = () => (lamps?.isDark === false ? { rays: PREVIEW_RAYS } : {});
  const pictureQuery = (size, isStill) => ({ ...query(), ...(isStill ? {} : preview()), ...camera.query(size) });
  const stream = new Stream(canvas, pictureQuery, server);
  stream.onshown = (frame) => {
    element("still")?.remove();
    handles?.update();
    if (element("message").className === "stream") notify("");
    showStatus(frame, layer);
  };
  stream.background = () => {
    const { backdrop, ground } = query();
    // Layers and environments are framed in black; ground below a scene on black is white.
    if (layer !== "rgb" || backdrop) return [0, 0, 0];
    return ground && scene.background.every((channel) => channel === 0) ? [1, 1, 1] : scene.background;
  };
  stream.onwait = () => (element("status").textContent = "rendering …");
  stream.onerror = (error) => notify(error.message, "stream");
  const state = () => ({
    ...camera.state(),
    ...light?.state(),
    ...lamps?.state(),
    ...materials?.query(),
    ...(layer === "rgb" ? {} : { layer }),
  });
  const address = new Address(state);
  /** Shows a change of camera or lights, which goes on or is a single step. */
  const changed = (isMoving) => {
    address.changed();
    lamps?.alignDial();
    handles?.update();
    materials?.show();
    stream.change(isMoving);
  };
  const moved = () => {
    showCamera(camera);
    changed(true);
  };
  const jumped = () => {
    showCamera(camera);
    changed(false);
  };
  /** Changes the camera in one step of the undo history. */
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
  addLayerButtons(scene.layers, showLayer);
  addViewOptions(scene.views, (index) => jump(() => camera.showView(index)));
  light = new Light(server, initial, () => changed(true), notify);
  lamps = new Lamps(server, initial, light, camera, changed, notify);
  const suits = () => (lamps.isDark && light.isOwn ? scene.shading : "physical");
  materials = new Materials(scene, initial, suits, () => !lamps.isDark, () => changed(false));
  handles = new Handles(canvas, stream, camera, lamps);
  lamps.onselect = () => handles.update();
  const path = new Path(camera, server, query, moved, notify);
  const training = new Training(server, stream, light, notify);
  const turntable = new Turntable(canvas, camera, moved);

  const togglePanel = () => {
    showPanel(element("panel").hidden);
    light.alignPanorama();
    handles.update();
  };
  const toggleMode = () => {
    camera.mode = camera.mode === "orbit" ? "fly" : "orbit";
    showCamera(camera);
    address.changed();
  };
  const home = () => jump(() => camera.reset());
  const undo = () => camera.undo() && jumped();
  const step = (by) => scene.views.length > 0 && jump(() => camera.showView((camera.view ?? (by > 0 ? -1 : 0)) + by));
  const help = () => element("help").showModal();
  const savePicture = () => downloadPicture(server, scene, camera, stream, query()).catch((error) => notify(error.message));
  const actions = { mode: toggleMode, home, undo, previous: () => step(-1), next: () => step(1) };
  actions["show-panel"] = togglePanel;
  actions["show-help"] = help;
  actions["full-screen"] = toggleFullScreen;
  actions["save-picture"] = savePicture;
  for (const [id, action] of Object.entries(actions)) element(id).addEventListener("click", action);
  element("full-screen").hidden = !document.fullscreenEnabled;
  element("angle").addEventListener("pointerdown", () => camera.remember());
  element("angle").addEventListener("input", () => moved(camera.setAngle(Number(element("angle").value))));

  const keys = { f: toggleMode, o: () => turntable.toggle(), r: home, u: undo, n: actions.next, p: actions.previous, h: togglePanel, "?": help };
  Object.assign(keys, { k: () => path.add(), " ": () => path.play(), t: () => training.toggle() });
  Object.assign(keys, { x: () => showLayer("error"), v: toggleFullScreen, i: savePicture, b: () => light.toggleBackdrop(), g: () => light.toggleGround() });
  Object.assign(keys, { "[": () => light.set({ turn: light.turn - 5 }), "]": () => light.set({ turn: light.turn + 5 }) });
  Object.assign(keys, { ",": () => light.set({ stops: light.stops - 0.25 }), ".": () => light.set({ stops: light.stops + 0.25 }) });
  for (let digit = 0; digit < 10; digit++) keys[digit] = () => showLayer(scene.layers[(digit + 9) % 10]);
  const focus = async (at) => {
    const position = stream.inPicture(at)?.map((fraction) => fraction.toFixed(4)).join(",");
    if (!position) return;
    const size = stream.fullSize();
    const small = size.map((edge) => Math.max(1, Math.round(edge * Math.min(1, FOCUS_EDGE / Math.max(...size)))));
    try {
      const parameters = { ...camera.query(small), size: small.join(","), at: position, client: 0 };
      const { point } = await (await server.get("point", parameters)).json();
      if (point) jump(() => camera.focus(point));
    } catch (error) {
      notify(error.message);
    }
  };
  new Controls(canvas, camera, moved, keys, focus);

  new ResizeObserver(() => changed(false)).observe(canvas);
  showLayer(scene.layers.includes(initial.layer) ? initial.layer : "rgb");
  showCamera(camera);
}

function showPanel(isShown) {
  element("panel").hidden = !isShown;
  document.body.classList.toggle("with-panel", isShown);
  element("show-panel").setAttribute("aria-expanded", isShown);
}

function toggleFullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else if (document.fullscreenEnabled) document.documentElement.requestFullscreen();
}

/** Downloads a lossless picture, at the size of a view of the data set, else of the canvas. */
async function downloadPicture(server, scene, camera, stream, parameters) {
  const size = scene.views[camera.view ?? 0]?.size ?? stream.fullSize();
  const fit = Math.min(1, Math.sqrt(scene.pixels_max / (size[0] * size[1])), 4096 / Math.max(...size));
  const fitting = size.map((edge) => Math.max(1, Math.floor(edge * fit)));
  const query = { ...parameters, ...camera.query(fitting), size: fitting.join(","), format: "png", client: 0 };
  const response = await server.get("frame", query);
  save(await response.blob(), `${scene.name}-${parameters.layer}.png`);
}

/** Adds a button for each layer. */
function addLayerButtons(layers, show) {
  const chip = (name, index) => {
    const button = document.createElement("button");
    button.textContent = name;
    button.dataset.layer = name;
    button.setAttribute("role", "radio");
    const key = name === "error" ? "x" : (index + 1) % 10;
    const hint = name in HINTS ? `${name}: ${HINTS[name]}` : name;
    // There are keys for ten layers.
    const stroke = index < 10 ? ` (${key})` : "";
    button.title = name === "error" ? "Difference from the photograph of the nearest view (x)" : hint + stroke;
    button.addEventListener("click", () => show(name));
    return button;
  };
  element("layers").replaceChildren(...layers.map(chip));
}

/** Fills the list of views; hides it for a scene without views. */
function addViewOptions(views, show) {
  for (const row of document.querySelectorAll(".views-row")) row.hidden = views.length === 0;
  const list = element("views");
  list.add(new Option("a view of the data set …", ""));
  views.forEach(({ name, held_out: isHeldOut }, index) => list.add(new Option(isHeldOut ? `${name} (held out)` : name, index)));
  list.addEventListener("change", () => list.value !== "" && show(Number(list.value)));
}

/** Updates the camera section of the panel. */
function showCamera(camera) {
  element("views").value = camera.view ?? "";
  element("angle").value = camera.angle;
  element("angle-value").value = `${Math.round(camera.angle)}°`;
  element("mode").textContent = camera.mode === "orbit" ? "Orbit" : "Fly";
  element("undo").disabled = camera.history.length === 0;
}

/** Updates the status line with the statistics of a picture. */
function showStatus({ time, render, size, rate, view, psnr, iteration }, layer) {
  const parts = [`${size[0]} × ${size[1]}`, `${Math.round(time)} ms (${Math.round(render)} rendering)`];
  if (rate !== null) parts.push(`${rate.toFixed(0)} per second`);
  if (psnr !== null) parts.unshift(`${layer} of ${view}: PSNR ${psnr} dB`);
  if (iteration !== null) parts.unshift(`iteration ${iteration}`);
  element("status").textContent = parts.join(", ");
}

function open() {
  // Small screens start without the panel.
  showPanel(!window.matchMedia("(max-width: 640px), (max-height: 480px)").matches);
  start().catch((error) => {
    showPanel(false);
    notify(error.message, "fatal");
  });
}

open();
