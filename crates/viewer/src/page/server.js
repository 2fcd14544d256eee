// Client of the HTTP server that renders the pictures.

import { token } from "./address.js";

/** HTTP client; a refused request throws an error with the server's message. */
export const server = {
  token,
  client: crypto.getRandomValues(new Uint32Array(1))[0] + 1,
  scene: null,

  async send(path, parameters, options = {}) {
    const query = new URLSearchParams({ client: this.client, ...parameters });
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
  get(path, parameters, options) {
    return this.send(path, parameters, options);
  },
  post(path, parameters, body) {
    return this.send(path, parameters, { method: "POST", body });
  },

  /** Picture of a request, decoded; its size in bytes, its headers, and the milliseconds of rendering. */
  async picture(parameters, options) {
    const { headers, blob } = await this.get("frame", parameters, options).then(async (response) => ({
      headers: response.headers,
      blob: await response.blob(),
    }));
    const timing = headers.get("server-timing") ?? "";
    const render = [...timing.matchAll(/dur=([\d.]+)/g)].reduce((sum, [, time]) => sum + Number(time), 0);
    return { picture: await createImageBitmap(blob), bytes: blob.size, headers, render };
  },
};
