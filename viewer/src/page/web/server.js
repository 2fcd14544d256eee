// The renderer in the page itself, in the place of the HTTP server: the same requests, answered by
// WebAssembly on WebGPU.

import { bytesOf } from "./text.js";

/** Sentence of a browser that cannot show the scene in motion. */
const NO_WEBGPU =
  "This browser has no WebGPU, so the scene stands still. Chrome and Edge 113, Safari 26 and Firefox 141, or later ones, show it in motion.";

/** Contents of a packed element, or of the file that it names. */
async function contents(id) {
  const element = document.getElementById(id);
  const { source, bytes } = element.dataset;
  if (!source) return inflated(new Blob([bytesOf(element.textContent, Number(bytes))]));
  const response = await fetch(source).catch(() => null);
  if (!response?.ok) throw new Error(`${source} cannot be loaded; it belongs beside this page, on a web server`);
  return inflated(await response.blob());
}

/** Bytes of a blob that is compressed with gzip. */
async function inflated(blob) {
  try {
    const stream = blob.stream().pipeThrough(new DecompressionStream("gzip"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  } catch {
    throw new Error("the page is damaged or cut short; export it once more");
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
    this.viewer = await wasm_bindgen.WebViewer.open(await contents("scene"));
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
