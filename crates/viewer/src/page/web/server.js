// Renderer in the page itself instead of the HTTP server: the same requests, answered by
// WebAssembly on WebGPU.

import { bytesOf } from "./text.js";

/** Sentence of a browser that cannot show the scene in motion. */
const NO_WEBGPU =
  "This browser has no WebGPU, so the scene is a still picture. Use Chrome or Edge 113, Safari 26, Firefox 141, or later versions.";

/** Elements that hold renderer and scene, removed from the page to free the memory of their text. */
const packed = Object.fromEntries(["renderer", "scene"].map((id) => [id, document.getElementById(id)]));
Object.values(packed).forEach((element) => element.remove());

const damaged = () => new Error("the page is damaged or cut short; export it again");

/** Contents of a packed element, or of the file that it names, which `given` replaces. */
async function contents(id, given = null) {
  const { dataset, textContent } = packed[id];
  packed[id].replaceChildren();
  if (!dataset.source) return inflated(bytesOf(textContent, Number(dataset.bytes)));
  const source = given ?? dataset.source;
  const response = await fetch(source).catch(() => null);
  if (!response?.ok) throw new Error(`cannot load ${source}; put it next to this page, on a web server`);
  const bytes = new Uint8Array(await response.arrayBuffer());
  // The server may have decompressed it, and other scenes are not compressed.
  return bytes[0] === 0x1f && bytes[1] === 0x8b ? inflated(bytes) : bytes;
}

/** Bytes that were compressed with gzip. */
async function inflated(bytes) {
  try {
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  } catch {
    throw damaged();
  }
}

/** An error after which a request is not repeated. */
function final(error) {
  const message = error instanceof WebAssembly.RuntimeError ? `the renderer failed (${error.message}); reload the page` : error.message ?? String(error);
  return Object.assign(new Error(message), { isFinal: true });
}

/** Lets the browser show what has changed before the renderer takes its time. */
const breath = () => new Promise((resume) => setTimeout(resume, 20));

export const server = {
  scene: null,
  viewer: null,

  async open() {
    if (!navigator.gpu) throw new Error(NO_WEBGPU);
    await wasm_bindgen({ module_or_path: await contents("renderer") });
    const given = new URLSearchParams(location.search).get("scene");
    if (given && !packed.scene.dataset.source) throw new Error(`a page in one file cannot load files; drop ${given} onto it`);
    this.viewer = await wasm_bindgen.WebViewer.open(given?.split("/").pop() ?? "", await contents("scene", given));
  },

  /** Shows the scene of a .glb instead of this one; keeps this one if the file cannot be read. */
  async replace(file) {
    await breath();
    const viewer = await wasm_bindgen.WebViewer.open(file.name, new Uint8Array(await file.arrayBuffer()));
    this.viewer.free();
    this.viewer = viewer;
    this.onreplaced();
  },

  async get(path, parameters) {
    try {
      return await this.answer(path, new URLSearchParams(parameters).toString(), parameters);
    } catch (error) {
      throw final(error);
    }
  },

  async answer(path, query) {
    if (path === "scene") {
      if (!this.viewer) await this.open();
      return new Response(this.viewer.scene());
    }
    if (path === "point") {
      const { point } = await this.viewer.frame(query);
      return new Response(JSON.stringify({ point: point ? [...point] : null }));
    }
    if (path === "light") return new Response(new Blob([this.viewer.preview(query)], { type: "image/jpeg" }));
    const { picture } = await this.rendered(query);
    const canvas = new OffscreenCanvas(picture.width, picture.height);
    canvas.getContext("2d", { alpha: false }).drawImage(picture, 0, 0);
    picture.close();
    return new Response(await canvas.convertToBlob({ type: "image/png" }));
  },

  /** Adds a light from a file. */
  async post(path, parameters, file) {
    await breath();
    try {
      const bytes = new Uint8Array(await file.arrayBuffer());
      return new Response(this.viewer.add_light(new URLSearchParams(parameters).toString(), bytes));
    } catch (error) {
      throw final(error);
    }
  },

  async picture(parameters, { signal }) {
    signal.throwIfAborted();
    try {
      return await this.rendered(new URLSearchParams(parameters).toString());
    } catch (error) {
      throw final(error);
    }
  },

  async rendered(query) {
    const start = performance.now();
    const shown = await this.viewer.frame(query);
    const { width, height, view } = shown;
    const pixels = new ImageData(new Uint8ClampedArray(shown.rgba.buffer), width, height);
    shown.free();
    const headers = { get: (name) => (name === "x-view" ? view ?? null : null) };
    const picture = await createImageBitmap(pixels);
    return { picture, bytes: 0, headers, render: performance.now() - start };
  },
};
